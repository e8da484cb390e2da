"""Drag that grows with the square of the rate."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, MujocoSupport, Parameter, TorqueEffect

if TYPE_CHECKING:
    import mujoco


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return -c v|v| [N*m]."""
    del states
    return -parameters["coefficient"] * motion.rate * m.abs(motion.rate)


def to_mjcf(
    spec: "mujoco.MjSpec", joint: "mujoco.MjsJoint", parameters: Mapping[str, float], *, exact: bool = True
) -> tuple[str, ...]:
    """Write the second coefficient of the joint's damping polynomial."""
    del spec, exact
    joint.damping[1] += parameters["coefficient"]
    return (f"quadratic-damping: second damping coefficient {parameters['coefficient']:.6g} N*m*s^2/rad^2",)


def from_mjcf(joint: "mujoco.MjsJoint") -> Sequence[float]:
    """Return what the joint's attribute says."""
    return (float(joint.damping[1]),) if joint.damping[1] else ()


EFFECT = TorqueEffect(
    name="quadratic-damping",
    title="quadratic damping",
    family="drag",
    parameters=(
        Parameter(
            name="coefficient",
            unit="N*m*s^2/rad^2",
            size=lambda s: s.torque / s.rate**2,
            low=0.0,
            high=5.0,
            starts=(0.05, 0.5),
        ),
    ),
    law="τ = -c v|v|",
    formula="{coefficient} φ̇|φ̇|",
    source="Froude 1874; ITTC 7.5-02-07-04.5, roll decay: p₁ + p₂|v|",
    does="The damping ratio falls in proportion to amplitude: fast decay at first, slow later.",
    look_alikes=("cubic-damping",),
    experiment="Release from 3°, 7° and 12°: damping rises with amplitude for v|v|, with its square for v³.",
    mujoco=MujocoSupport(means="joint damping polynomial, second coefficient", since="3.7", warp=True),
    to_mjcf=to_mjcf,
    from_mjcf=from_mjcf,
    example=(0.06,),
    torque=torque,
    decay_signs=(("growing loss", 1),),
)
