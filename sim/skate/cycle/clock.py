"""The cycle that a skateboarder repeats: push, mount, steer, dismount (HUSKY, section III).

Time alone drives it; contacts never switch it. Every policy step is `CONTROL_PERIOD` long, and the
cycle phase Φ runs from 0 to 1 over one cycle. Told to stand, the cycle goes on to the beginning of the next
pushing phase, where one foot can brake, and waits there.
"""

from dataclasses import dataclass
from typing import Any

from sim.skate.arrays import namespace

CONTROL_PERIOD = 0.02
"""Time between two decisions of the policy [s]."""
STILL_SPEED = 0.1
"""Commanded speed below which the robot shall stand instead of skate [m/s]."""


@dataclass(frozen=True, slots=True)
class Clock:
    """Lengths of the four phases of the cycle in policy steps."""

    push: int = 120
    """One foot on the board, the other pushes (40 % of the cycle)."""
    mount: int = 30
    """From pushing to steering (10 %)."""
    steer: int = 135
    """Both feet on the board, side-on, leaning (45 %)."""
    dismount: int = 15
    """From steering to pushing (5 %)."""

    @property
    def period(self) -> int:
        """Length of the cycle in policy steps."""
        return self.push + self.mount + self.steer + self.dismount

    def after(self, step: Any, stands: Any) -> Any:
        """Return the step that follows, shape (...,).

        Args:
            step: Steps since the cycle began, integers, shape (...,).
            stands: Whether the robot is told to stand, shape (...,). In a pushing phase the cycle then jumps to
                the beginning of the next one and stays there.
        """
        waiting_place = -(-step // self.period) * self.period
        return namespace(step).where(stands & self.pushing(step), waiting_place, step + 1)

    def waiting(self, step: Any, stands: Any) -> Any:
        """Return whether the cycle waits because the robot is told to stand, shape (...,)."""
        return stands & (step % self.period == 0)

    def cycle_phase(self, step: Any) -> Any:
        """Return Φ in [0, 1) of integer steps since the cycle began, shape (...,)."""
        return (step % self.period) / self.period

    def pushing(self, step: Any) -> Any:
        """Return whether steps lie in the pushing phase, shape (...,)."""
        return step % self.period < self.push

    def mounting(self, step: Any) -> Any:
        """Return whether steps lie between pushing and steering, shape (...,)."""
        step = step % self.period
        return (step >= self.push) & (step < self.push + self.mount)

    def steering(self, step: Any) -> Any:
        """Return whether steps lie in the steering phase, shape (...,)."""
        step = step % self.period
        return (step >= self.push + self.mount) & (step < self.period - self.dismount)

    def begins_steering(self, step: Any) -> Any:
        """Return whether steps are the first of a steering phase, in which a turn is told, shape (...,)."""
        return step % self.period == self.push + self.mount

    def dismounting(self, step: Any) -> Any:
        """Return whether steps lie between steering and pushing, shape (...,)."""
        return step % self.period >= self.period - self.dismount

    def transition_fraction(self, step: Any) -> Any:
        """Return the way gone within the present transition in (0, 1]; outside one, 0 or 1."""
        step = step % self.period
        mounted = (step - self.push + 1) / self.mount
        dismounted = (step - (self.period - self.dismount) + 1) / self.dismount
        fraction = namespace(mounted).where(step >= self.period - self.dismount, dismounted, mounted)
        return namespace(mounted).clip(fraction, 0.0, 1.0)

    def steering_time_left(self, step: Any) -> Any:
        """Return the time until the steering phase ends [s], zero outside it, shape (...,)."""
        step = step % self.period
        return (self.period - self.dismount - step) * self.steering(step) * CONTROL_PERIOD
