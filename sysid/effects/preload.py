"""A constant torque, e.g. bushings tightened unevenly."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, MujocoSupport, Parameter, TorqueEffect

if TYPE_CHECKING:
    import mujoco

SOFT = 1e-6
"""Stiffness of the tendon that pulls [N*m/rad]: the torque changes by this much per radian."""


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return T [N*m]."""
    del m, states
    return parameters["torque"] + 0 * motion.tilt


def to_mjcf(
    spec: "mujoco.MjSpec", joint: "mujoco.MjsJoint", parameters: Mapping[str, float], *, exact: bool = True
) -> tuple[str, ...]:
    """Pull with a very long, very soft tendon: a constant torque that adds no actuator."""
    del exact
    tendon = spec.add_tendon(name=f"{joint.name}_preload")
    tendon.wrap_joint(joint.name, 1.0)
    tendon.stiffness[0] = SOFT
    length = parameters["torque"] / SOFT
    tendon.springlength = [length, length]
    return (f"preload: a tendon that pulls with {parameters['torque']:.6g} N*m whatever the tilt",)


EFFECT = TorqueEffect(
    name="preload",
    title="constant torque",
    role="shift",
    parameters=(
        Parameter(name="torque", unit="N*m", size=lambda s: s.torque, low=-1.0, high=1.0, starts=(0.01,)),
    ),
    law="τ = +T",
    source="statics",
    does="The deck rests at T/k instead of at zero; with a linear spring the decay only moves.",
    look_alikes=("offset", "sensor-bias"),
    experiment="Tilt the floor by 2° or change the spring: a preload moves the rest angle by T/k, a bias not.",
    mujoco=MujocoSupport(means="fixed tendon, very soft and very long", since="3.0", warp=True),
    to_mjcf=to_mjcf,
    example=(0.3,),
    torque=torque,
    same_as=("rest_angle", "offset", "sensor-bias"),
)
