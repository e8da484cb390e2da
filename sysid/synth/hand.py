"""A hand that takes the deck, pushes it over, holds it with a tremor and lets it go."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sysid.roll import Array

_GRID = 0.01
"""Spacing of the spline's knots [s]: nine in a period of the fastest tremor."""


@dataclass(frozen=True, slots=True)
class HandMotion:
    """Prescribed roll of the deck while a hand has it: a quintic spline."""

    begin: float
    """When the hand takes the deck [s]."""
    end: float
    """When it lets go [s]."""
    spline: Any = field(repr=False)
    bend: Any = field(repr=False)
    """Second derivative of `spline`."""

    @property
    def knots(self) -> Array:
        """Knots of the spline [s], shape (m,)."""
        return np.unique(self.spline.t)

    def acceleration(self, time: float) -> float:
        """Return the roll acceleration [rad/s^2] at `time` [s]."""
        return float(self.bend(time))

    def sample(self, times: Array) -> Array:
        """Return roll, rate and acceleration, shape (n, 3), at `times` [s]."""
        return np.column_stack((self.spline(times), self.spline(times, 1), self.bend(times)))


def hand_motion(
    begin: float, start: tuple[float, float], angle: float, *, push: float, hold: float, tremor: float,
    rng: np.random.Generator,
) -> HandMotion:  # fmt: skip
    """Make the hand's motion from the deck's present state to the release.

    Args:
        begin: When the hand takes the deck [s].
        start: Roll [rad] and rate [rad/s] of the deck then.
        angle: Roll to hold [rad].
        push: Time for the way there [s].
        hold: Time for which the deck is held [s].
        tremor: Root mean square of the physiological tremor, 7 to 11 Hz, while held [rad].
    """
    from scipy.interpolate import make_interp_spline

    end = begin + push + hold
    times = np.linspace(begin, end, max(12, round((push + hold) / _GRID)))
    share = np.clip((times - begin) / push, 0.0, 1.0)
    blend = share**3 * (10 - 15 * share + 6 * share**2)
    # The hand stops the deck gently: the start rate fades with the same kind of weight.
    roll = (
        start[0] + (angle - start[0]) * blend + start[1] * push * share * (1 - share) ** 3 * (1 + 3 * share)
    )
    frequencies = 2 * np.pi * rng.uniform(7.0, 11.0, 3)
    phases = rng.uniform(0, 2 * np.pi, 3)
    onset = np.clip((times - begin - 0.7 * push) / (0.5 * push), 0.0, 1.0)
    wobble = np.sin(np.outer(times - begin, frequencies) + phases).sum(axis=1) * np.sqrt(2 / 3)
    roll += tremor * onset**3 * (10 - 15 * onset + 6 * onset**2) * wobble
    # Rate and curvature are fixed at the start; the far end is free.
    spline = make_interp_spline(times, roll, k=5, bc_type=([(1, start[1]), (2, 0.0)], [(2, 0.0), (3, 0.0)]))
    return HandMotion(begin, end, spline, spline.derivative(2))
