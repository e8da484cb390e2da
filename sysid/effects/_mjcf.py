"""What several effects write into a MuJoCo model: tendons, coefficients of a polynomial, motors without an input."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from sysid.effects._algebra import Numbers
from sysid.effects._base import MjsJoint, MjSpec, MujocoSupport, Parameter, Scales, ToMjcf
from sysid.errors import SysidError

FAR = 10.0
"""Tilt that no joint reaches [rad]: a tendon that is slack up to there never pulls on that side."""


def spec_angle(spec: MjSpec, angle: float) -> float:
    """Return an angle [rad] in the unit that the spec's compiler reads: degrees, unless told otherwise."""
    return float(np.degrees(angle)) if spec.compiler.degree else angle


def rest_of(spec: MjSpec, joint: MjsJoint) -> float:
    """Return the joint's springref [rad], whichever unit the spec's compiler reads."""
    return float(np.radians(joint.springref) if spec.compiler.degree else joint.springref)


def add_tendon(spec: MjSpec, joint: MjsJoint, name: str, stiffness: float, slack: Sequence[float]) -> Any:
    """Add a tendon that pulls the joint with so many N*m/rad, slack between two positions [rad], and return it."""
    tendon = spec.add_tendon(name=f"{joint.name}_{name}")
    tendon.wrap_joint(joint.name, 1.0)
    tendon.stiffness[0] = stiffness
    tendon.springlength = list(slack)
    return tendon


def polynomial(effect: str, of: Literal["stiffness", "damping"], power: int, **limits: Any) -> dict[str, Any]:
    """Return fields of an effect whose one parameter is a coefficient of the joint's spring or damping polynomial.

    Args:
        effect: Its name.
        of: Which polynomial.
        power: Which coefficient, 1 to 3.
        limits: As `Parameter` has them.
    """
    unit = f"N*m/rad^{power}" if of == "stiffness" else f"N*m*s^{power}/rad^{power}"
    place = ("first", "second", "third")[power - 1]

    def write(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, exact: bool = True) -> tuple[str, ...]:
        getattr(joint, of)[power - 1] += parameters["coefficient"]
        return (f"{effect}: {place} {of} coefficient {parameters['coefficient']:.6g} {unit}",)

    def read(joint: MjsJoint) -> Sequence[float]:
        value = float(getattr(joint, of)[power - 1])
        return (value,) if value else ()

    def size(scales: Scales) -> float:
        if of == "stiffness":
            return scales.stiffness / scales.amplitude ** (power - 1)
        return scales.torque / scales.rate**power

    means = f"joint {of} polynomial, {place} coefficient"
    return {
        "parameters": (Parameter("coefficient", unit, size, **limits),),
        "mujoco": MujocoSupport(means=means, since="3.7", warp=True),
        "to_mjcf": write,
        "from_mjcf": read,
    }


def refusing(reason: str) -> ToMjcf:
    """Return what refuses to write an effect that a bench of one body cannot have, unless its parameters are all zero."""

    def write(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, exact: bool = True) -> tuple[str, ...]:
        if any(parameters.values()):
            raise SysidError(reason)
        return ()

    return write


def has_passive_motor() -> bool:
    """Return whether this MuJoCo, from 3.12 on, has a motor without an input."""
    import mujoco

    return hasattr(getattr(mujoco, "mjtCtrlInput", None), "mjINPUT_NONE")


def add_passive_motor(spec: MjSpec, joint: MjsJoint, name: str, **constants: Any) -> None:
    """Add a motor without an input to the joint, with these constants of `set_to_dcmotor`."""
    import mujoco

    motor = spec.add_actuator(
        name=f"{joint.name}_{name}", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    motor.set_to_dcmotor(ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE), **constants)
