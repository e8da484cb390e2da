"""A motor limited by the current of its driver."""

from typing import Any

from sysid.effects._algebra import Algebra, Numbers, Value, Values
from sysid.effects._base import Actuation, DriveEffect, MujocoSupport, Parameter
from sysid.effects._mjcf import on_actuators


def act(m: Algebra, actuation: Actuation, parameters: Values) -> Value:
    """Return the torque within ±L [N*m]."""
    most = parameters["torque"]
    return m.maximum(-most, m.minimum(most, actuation.torque))


def change(actuator: Any, parameters: Numbers) -> str:
    """Write the range of force."""
    actuator.forcelimited = True
    actuator.forcerange = [-parameters["torque"], parameters["torque"]]
    return f"forcerange ±{parameters['torque']:.6g}"


EFFECT = DriveEffect(
    name="current-limit",
    title="torque limit of the actuator",
    family="saturation",
    parameters=(
        Parameter("torque", "N*m", low=0.02, high=1.0, starts=(0.3, 0.5, 0.7, 0.85, 0.95), neutral=None),
    ),
    law="τ → clip(τ, ±L)",
    source="current limit of a driver",
    does="Large commands move the joint no faster than middling ones.",
    look_alikes=("servo-gains", "quadratic-damping"),
    experiment="Command steps of growing size: from some size on the first acceleration stays the same.",
    mujoco=MujocoSupport(means="forcerange of the actuator"),
    to_mjcf=on_actuators(change),
    example=(2.0,),
    stage=1,
    act=act,
)  # fmt: skip
