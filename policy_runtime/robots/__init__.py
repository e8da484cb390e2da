"""Robots that the runtime can drive: in plain MuJoCo, or the real one over its network interface."""

import math
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.robot.g1 import JOINTS, servos
from sysid.roll import Array

PD_PERIOD = 0.002
"""Time between two steps of the joint servos [s]: 500 Hz."""
SERVO_STEPS = round(CONTROL_PERIOD / PD_PERIOD)
"""Servo periods in one policy step."""
ARM, BEGIN = "start", "A"
"""Buttons of the handset that let the robot move to the start pose, and the policy begin."""
STAND = "X"
"""Button of the handset that commands a stop; `BEGIN` ends it."""
STOPS = ({"select"}, {"L2", "B"})
"""Buttons of the handset that stop the robot; the second pair is the factory's own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotState:
    """State that a robot measures."""

    time: float
    """Clock of the robot [s]; it stands still when the sensors do."""
    age: float
    """Time since the last message from the robot [s]; 0 in simulation."""
    quaternion: Array
    """Orientation of the pelvis wxyz, shape (4,)."""
    angular_velocity: Array
    """Of the pelvis in its own frame [rad/s], shape (3,)."""
    joint_position: Array
    """[rad], shape (23,)."""
    joint_velocity: Array
    """[rad/s], shape (23,)."""
    joint_torque: Array
    """As measured or estimated by the motors [N*m], shape (23,)."""
    buttons: frozenset[str] = frozenset()
    """Buttons of the handset that are pressed."""

    @property
    def inclination(self) -> float:
        """Angle between the pelvis' z axis and the vertical [rad]."""
        _, x, y, _ = self.quaternion.tolist()
        return math.acos(min(1.0, max(-1.0, 1 - 2 * (x * x + y * y))))


@dataclass(frozen=True, slots=True, kw_only=True)
class JointCommand:
    """Command to the joint servos: torque = stiffness (position - q) - damping q̇."""

    position: Array
    """[rad], shape (23,)."""
    stiffness: Array
    """[N*m/rad], shape (23,)."""
    damping: Array
    """[N*m*s/rad], shape (23,)."""

    @classmethod
    def brake(cls) -> Self:
        """Return the command of damping alone."""
        zeros = np.zeros(len(JOINTS))
        return cls(position=zeros, stiffness=zeros, damping=servos().damping)

    @classmethod
    def hold(cls, position: Array) -> Self:
        """Return the command that asks for joint angles [rad], shape (23,), with the robot's gains."""
        return cls(position=position, stiffness=servos().stiffness, damping=servos().damping)


class Robot(Protocol):
    """One robot with position servos."""

    def read(self) -> RobotState:
        """Return the latest state."""
        ...

    def send(self, command: JointCommand) -> None:
        """Set the command of the servos from now on."""
        ...

    def step(self) -> None:
        """Let one period of the servos (`PD_PERIOD`) pass."""
        ...
