"""Damping that grows with the cube of the rate."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, MujocoSupport, Parameter, TorqueEffect

if TYPE_CHECKING:
    import mujoco


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return -c v³ [N*m]."""
    del m, states
    return -parameters["coefficient"] * motion.rate**3


def to_mjcf(
    spec: "mujoco.MjSpec", joint: "mujoco.MjsJoint", parameters: Mapping[str, float], *, exact: bool = True
) -> tuple[str, ...]:
    """Write the third coefficient of the joint's damping polynomial."""
    del spec, exact
    joint.damping[2] += parameters["coefficient"]
    return (f"cubic-damping: third damping coefficient {parameters['coefficient']:.6g} N*m*s^3/rad^3",)


def from_mjcf(joint: "mujoco.MjsJoint") -> Sequence[float]:
    """Return what the joint's attribute says."""
    return (float(joint.damping[2]),) if joint.damping[2] else ()


EFFECT = TorqueEffect(
    name="cubic-damping",
    title="cubic damping",
    family="drag",
    parameters=(
        Parameter(
            name="coefficient",
            unit="N*m*s^3/rad^3",
            size=lambda s: s.torque / s.rate**3,
            low=0.0,
            high=10.0,
            starts=(0.05, 0.5),
        ),
    ),
    law="τ = -c v³",
    formula="{coefficient} φ̇³",
    source="Dalzell, J. Ship Research 22 (1978): cubic in place of quadratic roll damping",
    does="The damping ratio falls with the square of the amplitude; small swings are damped linearly.",
    look_alikes=("quadratic-damping",),
    experiment="Release from 3°, 7° and 12°: damping rises with amplitude for v|v|, with its square for v³.",
    mujoco=MujocoSupport(means="joint damping polynomial, third coefficient", since="3.7", warp=True),
    to_mjcf=to_mjcf,
    from_mjcf=from_mjcf,
    example=(0.02,),
    torque=torque,
    decay_signs=(("growing loss", 2),),
)
