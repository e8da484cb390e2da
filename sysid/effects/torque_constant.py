"""Torque of a motor for each unit of its input."""

from typing import Any

from sysid.effects._algebra import Algebra, Numbers, Value, Values
from sysid.effects._base import Actuation, DriveEffect, MujocoSupport, Parameter
from sysid.effects._mjcf import on_actuators


def act(m: Algebra, actuation: Actuation, parameters: Values) -> Value:
    """Return c u [N*m]."""
    return parameters["gain"] * actuation.input


def change(actuator: Any, parameters: Numbers) -> str:
    """Write the gain of a motor."""
    actuator.gainprm[0] = parameters["gain"]
    return f"gain {parameters['gain']:.6g}"


EFFECT = DriveEffect(
    name="torque-constant",
    title="torque for each unit of the input",
    family="gains",
    parameters=(Parameter("gain", "N*m per unit", lambda s: s.torque, low=-50.0, high=50.0, starts=(1.0,), neutral=None),),
    law="τ = c u; u in N·m, A or V",
    source="definition of a torque constant; behind a gear of ratio N it is N times the motor's",
    does="All motion is larger or smaller, as if inertia, damping and friction were all wrong by one factor.",
    look_alikes=("armature", "inertia"),
    experiment="Hold a known weight still: its moment over the input is the constant.",
    mujoco=MujocoSupport(means="gain of the motor"),
    to_mjcf=on_actuators(change),
    example=(1.2,),
    stage=0,
    sources=("torque", "force", "current", "voltage"),
    act=act,
)  # fmt: skip
