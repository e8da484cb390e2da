"""Left and right springs that differ."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, MujocoSupport, Parameter, TorqueEffect

if TYPE_CHECKING:
    import mujoco


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return -b x² [N*m]: the same sign on both sides."""
    del m, states
    return -parameters["coefficient"] * motion.tilt**2


def to_mjcf(
    spec: "mujoco.MjSpec", joint: "mujoco.MjsJoint", parameters: Mapping[str, float], *, exact: bool = True
) -> tuple[str, ...]:
    """Write the second coefficient of the joint's spring polynomial, which MuJoCo keeps even."""
    del spec, exact
    joint.stiffness[1] += parameters["coefficient"]
    return (f"asymmetric-stiffness: second stiffness coefficient {parameters['coefficient']:.6g} N*m/rad^2",)


def from_mjcf(joint: "mujoco.MjsJoint") -> Sequence[float]:
    """Return what the joint's attribute says."""
    return (float(joint.stiffness[1]),) if joint.stiffness[1] else ()


EFFECT = TorqueEffect(
    name="asymmetric-stiffness",
    title="left and right springs differ",
    family="asymmetry",
    parameters=(
        Parameter(
            name="coefficient",
            unit="N*m/rad^2",
            size=lambda s: s.stiffness / s.amplitude,
            low=-0.9,
            high=0.9,
            starts=(0.05, -0.05),
        ),
    ),
    law="τ = -b x²; b > 0 is stiffer with the right edge down",
    formula="{coefficient} φ²",
    source="Nayfeh and Mook, Nonlinear Oscillations (1979), quadratic nonlinearity",
    does="Swings to one side are wider and longer than to the other; the middle drifts with amplitude.",
    look_alikes=("offset", "preload", "sensor-bias"),
    experiment="Release once from each side, and from 3° and 12°: only unequal springs treat them unequally.",
    mujoco=MujocoSupport(means="joint stiffness polynomial, second coefficient", since="3.7", warp=True),
    to_mjcf=to_mjcf,
    from_mjcf=from_mjcf,
    example=(25.0,),
    torque=torque,
)
