"""A delay of the command."""

from typing import Any

from sysid.effects._algebra import Numbers
from sysid.effects._base import DriveEffect, MujocoSupport, Parameter
from sysid.effects._mjcf import on_actuators

STEP = 5e-4
"""Shortest step of a simulation for which the buffer is made [s]."""


def change(actuator: Any, parameters: Numbers) -> str:
    """Write the delay to the nearest 0.5 ms, with a buffer that holds its commands at such steps."""
    steps = round(max(parameters["time"], 0.0) / STEP)
    if steps == 0:
        return "no delay"
    # MuJoCo rounds up to whole steps: rounding errors must not add one.
    time = steps * STEP - STEP / 100
    actuator.delay, actuator.nsample = time, steps + 2
    return f"delay {time:.6g} s, in whole steps of the simulation"


EFFECT = DriveEffect(
    name="delay",
    title="delay of the command",
    family="delay",
    parameters=(Parameter("time", "s", low=0.0, high=3.0, starts=(0.02, 0.1, 0.3)),),
    law="u(t) → u(t - T)",
    source="bus, control period and driver",
    does="The joint follows late by the same time at every speed; under feedback it also rings.",
    look_alikes=("armature", "lowpass"),
    experiment="Command a step and look at the first milliseconds: nothing moves until the delay is over.",
    mujoco=MujocoSupport(means="delay and nsample of the actuator"),
    to_mjcf=on_actuators(change),
    example=(0.01,),
    stage=-1,
    late="time",
)  # fmt: skip
