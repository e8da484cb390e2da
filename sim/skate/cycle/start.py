"""Starts of episodes within the cycle."""

from dataclasses import dataclass

import numpy as np

from sim.skate.cycle.clock import Clock
from sysid.roll import Array

STANDING_PLACE = -0.075
"""Place of the right foot along the deck at the paper's start at rest, from the front marker [m]. In the
canonical poses it is 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """Shares of the episodes that begin rolling in each phase of the cycle; all others begin it at rest.

    Who begins anywhere in a transition learns what follows it before what precedes it.
    """

    pushing: float = 0.125
    mounting: float = 0.125
    steering: float = 0.125
    dismounting: float = 0.125
    speed: tuple[float, float] = (0.2, 1.6)
    """Speed of those that roll [m/s]."""
    position_noise: float = 0.02
    """Half-width of the pelvis' offset beside the board [m]."""
    joint_noise: float = 0.01
    """[rad]."""

    def chances(self, clock: Clock) -> Array:
        """Return the chance of each step of the cycle to be an episode's first, shape (period,); at step 0 it rests.

        Starts leave at least 0.2 s of pushing and 0.5 s of steering.
        """
        step = np.arange(clock.period)
        phases = (
            (step > 0) & clock.pushing(step) & clock.pushing(step + 10),
            clock.mounting(step),
            clock.steering(step) & clock.steering(step + 25),
            clock.dismounting(step),
        )
        chances = np.zeros(clock.period)
        shares = self.pushing, self.mounting, self.steering, self.dismounting
        for share, inside in zip(shares, phases, strict=True):
            chances += share * inside / inside.sum()
        chances[0] = 1 - sum(shares)
        return chances


AT_REST = Start(pushing=0.0, mounting=0.0, steering=0.0, dismounting=0.0)
"""All episodes begin at rest, as in the paper."""
