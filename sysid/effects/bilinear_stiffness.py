"""A spring that is stiffer on one side."""

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect
from sysid.effects._mjcf import UNREACHABLE_TILT, add_tendon, rest_of


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return -b |x| [N*m]: the stiffness is k + b with the right edge down, k - b with the left."""
    return -parameters["difference"] * m.abs(motion.tilt)


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Leave the softer spring in the joint and write the rest as a tendon that pulls on the stiffer side only."""
    difference, rest = parameters["difference"], rest_of(spec, joint)
    joint.stiffness[0] -= abs(difference)
    slack = (rest - UNREACHABLE_TILT, rest) if difference > 0 else (rest, rest + UNREACHABLE_TILT)
    add_tendon(spec, joint, "bilinear", 2 * abs(difference), slack)
    side = "right" if difference > 0 else "left"
    return (
        f"bilinear-stiffness: {2 * abs(difference):.6g} N*m/rad more with the {side} edge down, as a tendon",
    )


EFFECT = TorqueEffect(
    name="bilinear-stiffness",
    title="one side stiffer than the other",
    family="asymmetry",
    parameters=(Parameter("difference", "N*m/rad", low=-0.95, high=0.95, starts=(0.1, -0.1)),),
    law="τ = -b |x|; the stiffness is k + b at positive angles and k - b at negative ones",
    formula="{difference} |φ|",
    source="piecewise linear oscillator, Shaw and Holmes, J. Sound and Vibration 90 (1983)",
    does="Half swings to one side are wider and longer than to the other by the same share at every amplitude.",
    look_alikes=("asymmetric-stiffness", "one-sided-stop", "offset", "preload", "sensor-bias"),
    experiment=(
        "Release from {3°} and {12°} to either side. Two springs: half swings differ by the same share at both angles. "
        "One bent spring: they differ by more at {12°}."
    ),
    mujoco=MujocoSupport(means="softer spring in the joint, the rest as a tendon slack on one side"),
    to_mjcf=to_mjcf,
    example=(3.0,),
    torque=torque,
)
