"""Gains of a position servo."""

from typing import Any

from sysid.effects._algebra import Algebra, Numbers, Value, Values
from sysid.effects._base import Actuation, DriveEffect, MujocoSupport, Parameter
from sysid.effects._mjcf import on_actuators


def act(m: Algebra, actuation: Actuation, parameters: Values) -> Value:
    """Return kp (u - q) - kd v [N*m]."""
    error = actuation.input - actuation.angle
    return parameters["kp"] * error - parameters["kd"] * actuation.rate


def change(actuator: Any, parameters: Numbers) -> str:
    """Write both gains of a position actuator."""
    kp, kd = parameters["kp"], parameters["kd"]
    actuator.gainprm[0] = kp
    actuator.biasprm[1], actuator.biasprm[2] = -kp, -kd
    return f"kp {kp:.6g}, kv {kd:.6g}"


EFFECT = DriveEffect(
    name="servo-gains",
    title="gains of the servo",
    family="gains",
    parameters=(
        Parameter("kp", "N*m/rad", low=0.0, high=50.0, starts=(1.0,), neutral=None),
        Parameter("kd", "N*m*s/rad", low=0.0, high=50.0, default=0.0, held=True),
    ),
    law="τ = kp (u - q) - kd q̇",
    source="PD control",
    does="The joint follows its command faster or slower, and overshoots more or less.",
    look_alikes=("torque-constant", "armature"),
    experiment="Hold the joint against a known weight: its droop is weight over kp.",
    mujoco=MujocoSupport(means="kp and kv of the position actuator"),
    to_mjcf=on_actuators(change),
    example=(20.0, 0.5),
    stage=0,
    sources=("command",),
    act=act,
)  # fmt: skip
