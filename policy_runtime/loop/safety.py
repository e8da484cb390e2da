"""Safety checks of every tick, which end a run and give the reason in words."""

import math
from dataclasses import dataclass

import numpy as np

from policy_runtime.robots import STOPS, RobotState
from sim.skate.robot.g1 import JOINTS, servos
from sysid.roll import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Beyond these the robot is stopped."""

    joint_low: Array
    """Lower end of each joint's range [rad], shape (23,)."""
    joint_high: Array
    """[rad], shape (23,)."""
    joint_margin: float = 0.05
    """How far beyond its range a joint may be measured [rad]."""
    tilt: float = math.radians(60)
    """Greatest inclination of the pelvis [rad]."""
    link_timeout: float = 0.1
    """Longest time without a message from the robot, or with the same state repeated [s]."""
    torque_share: float = 0.98
    """Share of a motor's torque limit that counts as being at the limit."""
    torque_time: float = 0.5
    """Longest time at the torque limit without a break [s]."""


class Guard:
    """Watches successive states, and keeps conditions that last longer than a tick."""

    def __init__(self, limits: Limits, period: float) -> None:
        """Start watching, with so much time between two checks [s]."""
        self._limits, self._period = limits, period
        self._effort = servos().effort
        self._loaded = limits.torque_share * self._effort
        self._last_time = -math.inf
        self._stale = 0.0
        self._at_limit = np.zeros(len(JOINTS))

    def check(self, state: RobotState) -> str | None:
        """Return why the robot must stop, or None."""
        limits = self._limits
        if any(buttons <= state.buttons for buttons in STOPS):
            return f"handset: {' and '.join(sorted(state.buttons))} pressed"
        if state.age > limits.link_timeout:
            return f"lost link: no message from the robot for {state.age * 1e3:.0f} ms"
        for name in ("quaternion", "angular_velocity", "joint_position", "joint_velocity", "joint_torque"):
            if not finite(getattr(state, name)):
                return f"not finite: {name.replace('_', ' ')} is {getattr(state, name)}"
        self._stale = self._stale + self._period if state.time <= self._last_time else 0.0
        self._last_time = max(self._last_time, state.time)
        if self._stale > limits.link_timeout:
            return f"stale observation: the robot has repeated the same state for {self._stale * 1e3:.0f} ms"
        if state.inclination > limits.tilt:
            return (
                f"tilt: the pelvis leans {math.degrees(state.inclination):.0f}°, "
                f"limit {math.degrees(limits.tilt):.0f}°"
            )
        return self._check_joints(state) or self._check_torques(state)

    def _check_joints(self, state: RobotState) -> str | None:
        limits = self._limits
        beyond = np.maximum(limits.joint_low - state.joint_position, state.joint_position - limits.joint_high)
        worst = int(beyond.argmax())
        if beyond[worst] > limits.joint_margin:
            return (
                f"joint limit: {JOINTS[worst]} at {state.joint_position[worst]:.3f} rad is {beyond[worst]:.3f} rad "
                f"beyond its range, --joint-margin {limits.joint_margin:g}"
            )
        return None

    def _check_torques(self, state: RobotState) -> str | None:
        self._at_limit = (self._at_limit + self._period) * (np.abs(state.joint_torque) >= self._loaded)
        worst = int(self._at_limit.argmax())
        if self._at_limit[worst] > self._limits.torque_time:
            return (
                f"torque limit: {JOINTS[worst]} has been at its {self._effort[worst]:.0f} N·m "
                f"for {self._at_limit[worst]:.1f} s"
            )
        return None


def finite(numbers: Array) -> bool:
    """Return whether all numbers are finite; the square of the length, mostly enough to tell, is quick."""
    return math.isfinite(numbers.dot(numbers)) or bool(np.isfinite(numbers).all())
