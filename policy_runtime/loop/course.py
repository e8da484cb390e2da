"""The course: where a ride shall be heading after all turns asked for, and how to hold it with the IMU alone.

A policy turns from where it points, so errors add up: straight on, the heading drifts over the
cycles. In the second half of each pushing phase the robot always faces ahead in the same way. The mean yaw of
the pelvis there tells the drift, and the next turn corrects it.
"""

import math

from policy_runtime.loop.commands import TURN_RANGE
from policy_runtime.robots import RobotState
from sim.skate import rotation
from sim.skate.arrays import wrap_angle
from sim.skate.cycle.clock import Clock


class Course:
    """Adds up the turns asked for; with `hold`, asks for those that keep to the sum."""

    def __init__(self, *, hold: bool = False) -> None:
        """Start straight on; `hold` corrects the heading errors of earlier turns."""
        self._hold = hold
        self.asked = 0.0
        """Sum of the turns asked for since the start [rad]."""
        self._cosine = self._sine = 0.0
        self._first: float | None = None
        self._last_step = -1

    def follow(self, state: RobotState, step: int, turn: float) -> float | None:
        """Take one policy step; return the turn for the policy where steering begins, else None [rad]."""
        clock = Clock()
        position = step % clock.period
        if step == self._last_step:
            return None  # the cycle stands still
        self._last_step = step
        if position == 0:
            self._cosine = self._sine = 0.0
        if clock.push // 2 <= position < clock.push:
            yaw = float(rotation.yaw(state.quaternion))
            self._cosine += math.cos(yaw)
            self._sine += math.sin(yaw)
        if not clock.begins_steering(step):
            return None
        self.asked += turn
        if not self._hold or not (self._cosine or self._sine):
            return turn
        heading = math.atan2(self._sine, self._cosine)
        self._first = heading if self._first is None else self._first
        missing = float(wrap_angle(self.asked - (heading - self._first)))
        return min(max(missing, TURN_RANGE[0]), TURN_RANGE[1])
