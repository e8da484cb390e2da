"""Elements of a MuJoCo model that several effects write: tendons, polynomials, motors without an input."""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, Scales, ToMjcf
from sysid.errors import SysidError

UNREACHABLE_TILT = 10.0
"""Tilt beyond the range of all joints [rad]: a tendon that is slack up to it never pulls on that side."""


def spec_angle(spec: MjSpec, angle: float) -> float:
    """Return an angle [rad] in the unit that the spec's compiler reads: degrees, unless told otherwise."""
    return float(np.degrees(angle)) if spec.compiler.degree else angle


def rest_of(spec: MjSpec, joint: MjsJoint) -> float:
    """Return the joint's springref [rad]."""
    return float(np.radians(joint.springref) if spec.compiler.degree else joint.springref)


def add_tendon(spec: MjSpec, joint: MjsJoint, name: str, stiffness: float, slack: Sequence[float]) -> Any:
    """Add and return a tendon of a stiffness [N*m/rad] on the joint, slack between two positions [rad]."""
    tendon = spec.add_tendon(name=f"{joint.name}_{name}")
    tendon.wrap_joint(joint.name, 1.0)
    tendon.stiffness[0] = stiffness
    tendon.springlength = list(slack)
    return tendon


def add_hinged_body(
    parent: Any, joint: MjsJoint, name: str, pos: Sequence[float], *, inertia: float, stiffness: float,
    damping: float,
) -> Any:  # fmt: skip
    """Add a body of an inertia [kg*m^2] on a hinge with the joint's axis, its spring and its damper in SI, and return the hinge."""
    import mujoco

    body = parent.add_body(name=f"{joint.name}_{name}", pos=list(pos))
    body.explicitinertial, body.mass, body.inertia = True, 1e-3, [inertia] * 3
    body.ipos = [0.0, 0.0, 0.0]  # the default of MjSpec is the position of the body
    hinge = body.add_joint(name=f"{joint.name}_{name}_joint", axis=list(joint.axis))
    hinge.type = mujoco.mjtJoint.mjJNT_HINGE
    hinge.stiffness[0], hinge.damping[0] = stiffness, damping
    return hinge


def set_friction(holder: Any, torque: float) -> None:
    """Give a joint or a tendon dry friction [N*m], its constraint hardened.

    MuJoCo's default friction constraint yields near the turning points. It dissipates 85 to 93 % of the true loss at these
    frequencies, and creeps instead of sticking. A time constant of 2 ms and an impedance of 0.9999 make both right to 0.1 %.
    """
    holder.frictionloss = torque
    holder.solref_friction = [0.002, 1.0]
    holder.solimp_friction = [0.9999, 0.9999, 0.001, 0.5, 2.0]


def polynomial(effect: str, of: Literal["stiffness", "damping"], power: int, **limits: Any) -> dict[str, Any]:
    """Return fields of an effect of one parameter, a coefficient of the joint's spring or damper: its torque and its MJCF.

    The spring has x, x² and x³, the damper v, v|v| and v³, each with a negative sign.
    """
    unit = f"N*m/rad^{power}" if of == "stiffness" else f"N*m*s^{power}/rad^{power}"
    place = ("first", "second", "third")[power - 1]

    def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
        x, v = motion.tilt, motion.rate
        powers = (x, x**2, x**3) if of == "stiffness" else (v, v * m.abs(v), v**3)
        return -parameters["coefficient"] * powers[power - 1]

    def write(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
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
        "torque": torque,
        "mujoco": MujocoSupport(means=means),
        "to_mjcf": write,
        "from_mjcf": read,
    }


def refusing(reason: str) -> ToMjcf:
    """Return a writer that refuses an effect on a bench of one body, unless its parameters are all zero."""

    def write(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
        if any(parameters.values()):
            raise SysidError(reason)
        return ()

    return write


def add_passive_motor(spec: MjSpec, joint: MjsJoint, name: str, *, native: bool, **constants: Any) -> None:
    """Add an undriven motor with these constants of `set_to_dcmotor` to the joint.

    Its input is a voltage of zero, in MuJoCo from 3.11 on; `native` leaves the input out from 3.12 on.
    """
    import mujoco

    motor = spec.add_actuator(
        name=f"{joint.name}_{name}", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    # MuJoCo 3.11 requires a constant above zero, also of a motor with friction only.
    motor.set_to_dcmotor(**{"motorconst": [mujoco.mjMINVAL] * 2, "resistance": 1.0, **constants})
    if native and hasattr(mujoco, "mjtCtrlInput"):
        motor.ctrlspec = int(mujoco.mjtCtrlInput.mjINPUT_NONE)


def actuators_of(spec: MjSpec, joint: MjsJoint) -> list[Any]:
    """Return the actuators of a spec that act on a joint."""
    import mujoco

    kinds = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    return [one for one in spec.actuators if one.trntype in kinds and one.target == joint.name]


def on_actuators(change: Callable[[Any, Numbers], str]) -> ToMjcf:
    """Return the writer of an effect of an actuator; `change(actuator, parameters)` changes it and describes the change."""

    def write(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
        found = actuators_of(spec, joint)
        if not found:
            values = ", ".join(f"{name} {value:.6g}" for name, value in parameters.items())
            return (f"joint '{joint.name}' has no actuator in the model, so {values} is not written",)
        return tuple(f"actuator '{one.name}': {change(one, parameters)}" for one in found)

    return write
