"""A constant torque, e.g. bushings tightened unevenly."""

from sysid.effects._algebra import Algebra, Numbers, States, Value, Values
from sysid.effects._base import JointState, MjsJoint, MjSpec, MujocoSupport, Parameter, TorqueEffect
from sysid.effects._mjcf import add_tendon

SOFT = 1e-6
"""Stiffness of the tendon [N*m/rad]: its torque changes by this much per radian."""


def torque(m: Algebra, motion: JointState, parameters: Values, states: States) -> Value:
    """Return T [N*m]."""
    return parameters["torque"] + 0 * motion.tilt


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Pull with a very long, very soft tendon: a constant torque without an actuator."""
    length = parameters["torque"] / SOFT
    add_tendon(spec, joint, "preload", SOFT, (length, length))
    return (f"preload: a tendon that pulls with {parameters['torque']:.6g} N*m at every tilt",)


EFFECT = TorqueEffect(
    name="preload",
    title="constant torque",
    family="rest",
    also_called=("bias torque", "static torque"),
    role="shift",
    parameters=(Parameter("torque", "N*m", low=-100.0, high=100.0, starts=(0.01,)),),
    law="τ = +T",
    source="statics",
    does="The joint rests at T/k instead of at zero; with a linear spring the decay only moves.",
    look_alikes=("offset", "sensor-bias"),
    experiment="Tilt the floor by 2° or change the spring: a preload moves the rest angle by T/k, a bias not.",
    mujoco=MujocoSupport(means="fixed tendon, very soft and very long"),
    to_mjcf=to_mjcf,
    example=(0.3,),
    torque=torque,
    same_as=("rest_angle", "offset", "sensor-bias"),
)
