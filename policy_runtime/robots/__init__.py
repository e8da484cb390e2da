"""Robots that the runtime can drive: in plain MuJoCo, or the real one over its network interface."""

from dataclasses import dataclass
from typing import Protocol

from sysid.roll import Array

PD_PERIOD = 0.002
"""Time between two steps of the joint servos [s]: 500 Hz."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotState:
    """What a robot knows of itself."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class JointCommand:
    """What the joint servos shall do: torque = stiffness (position - q) - damping q̇."""

    position: Array
    """[rad], shape (23,)."""
    stiffness: Array
    """[N*m/rad], shape (23,)."""
    damping: Array
    """[N*m*s/rad], shape (23,)."""


class Robot(Protocol):
    """One robot with position servos."""

    def read(self) -> RobotState:
        """Return the latest state."""
        ...

    def send(self, command: JointCommand) -> None:
        """Set what the servos do from now on."""
        ...

    def step(self) -> None:
        """Let one period of the servos (`PD_PERIOD`) pass."""
        ...

    def close(self) -> None:
        """Let go of the robot."""
        ...
