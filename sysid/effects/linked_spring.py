"""Springs of a model that act on the joint through tendons and carried joints: known, hence not fitted."""

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect
from sysid.effects._mjcf import add_tendon


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return -k (φ - high) above high, -k (φ - low) below low, else 0 [N*m]."""
    above, below = motion.roll - parameters["high"], parameters["low"] - motion.roll
    return -parameters["stiffness"] * (m.maximum(above, 0.0) - m.maximum(below, 0.0))


def slope(parameters: Numbers, roll: float) -> float:
    """Return its stiffness at a roll [N*m/rad]; 0 while it is slack."""
    return 0.0 if parameters["low"] < roll < parameters["high"] else parameters["stiffness"]


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Add a spring tendon to a bench's joint; a model of the robot has its own."""
    stiffness, low, high = parameters["stiffness"], parameters["low"], parameters["high"]
    add_tendon(spec, joint, "linked_spring", stiffness, [low, high])
    return (f"linked-spring: tendon of {stiffness:.6g} N*m/rad, slack from {low:.4g} to {high:.4g} rad",)


EFFECT = TorqueEffect(
    name="linked-spring",
    title="springs beside the joint's own",
    family="hardening",
    role="record",
    parameters=(
        Parameter("stiffness", "N*m/rad", low=-1e3, high=1e3, held=True),
        *(Parameter(name, "rad", low=-1e3, high=1e3, held=True) for name in ("low", "high")),
    ),
    law="τ = -k (φ - high) above high, -k (φ - low) below low, else 0, from a model",
    source="MuJoCo's passive spring forces along the arc of the joint",
    does="Adds a known stiffness, which gives the other torques a scale.",
    look_alikes=("stiffness of the record",),
    experiment="Take the tendon off: the change is its own spring.",
    mujoco=MujocoSupport(means="fixed tendon with a stiffness"),
    to_mjcf=to_mjcf,
    example=(4.0, -0.02, 0.05),
    torque=torque,
    grounded=True,
    identifiable_from_decay=False,
    slope=slope,
)
