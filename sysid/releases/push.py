"""Where a hand lets go that pushes the deck on its way instead of opening: later than the deck leaves its hold.

The free motion is told from the pushed one where later swings are a linear decay to the noise and the beginning is not.
A joint that is not linear shows it in later swings too; one with a memory, or behind a filter, adds an exponential to
the beginning; and neither a stop nor friction holds the deck back, as a hand does that is slower than the spring. None of
them is cut.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sysid.least_squares import Normal, minimise
from sysid.noise.floor import noise_floor
from sysid.roll import Array, Release

LATEST = 0.75
"""A hand has left this many periods after the deck left its hold: what follows is free."""
EARLIEST = 0.03
"""Nor is a beginning shorter than this many periods cut: a release is found that well."""
SWINGS = 8.0
"""Periods of a decay that are looked at."""
BLOCK, STEP = 0.12, 0.02
"""Periods over which residuals are pooled, and by which the start moves on; the first that are noise may hold the hand's last."""
MOST_DAMPED = 0.2
"""Damping ratio over which too little of a decay is left after a hand to tell it from one."""
LEAST = 40
"""Samples after the latest hand without which a release is left as it is."""
LAG = 0.05
"""A hand holds the deck back by more than this many periods."""
SLOPE = 1e-6
"""Relative change of a pole over which the slope of the residuals is taken [1]."""
AT_NOISE = 1.15
"""Residuals up to this multiple of the noise floor are noise."""
WORST = 1.15
"""Residuals of the beginning are noise up to this multiple of what the worst later stretch as long has."""
MEMORIES = np.geomspace(0.02, 1.0, 12)
"""Times of the exponentials that a beginning is held against, in periods."""


@dataclass(frozen=True, slots=True)
class _Poles:
    """Of a linear decay, shared by all releases of a log."""

    decay: float
    """[1/s]"""
    omega: float
    """Damped [rad/s]."""

    @property
    def period(self) -> float:
        return 2 * math.pi / self.omega

    def basis(self, time: Array) -> Array:
        """Return what a decay is a sum of, shape (n, 3): its own value and slope at time 0, and a level."""
        envelope = np.exp(-self.decay * time)
        cosine, sine = np.cos(self.omega * time), np.sin(self.omega * time) / self.omega
        return np.column_stack((envelope * (cosine + self.decay * sine), envelope * sine, np.ones_like(time)))


def without_push(releases: Sequence[Release], pace: float) -> list[Release]:
    """Let each release begin where the hand has left; unchanged where its beginning follows the decay, or none does.

    Args:
        releases: Of one log, each from when the deck leaves its hold.
        pace: 10 to 90 % time of a swing [s].
    """
    held = [release for release in releases if release.hold > 0]
    poles = _late_poles(held, pace)
    if poles is None or poles.decay > MOST_DAMPED * poles.omega:
        return list(releases)
    span = LATEST * poles.period, SWINGS * poles.period
    held = [one for one in held if len(_window(one.time - one.start, one.roll, *span)[0]) >= LEAST]
    free = {release.number: _free_from(release, poles) for release in held}
    late = [release for release in held if free[release.number] > 0]
    if not late:
        return list(releases)
    explained = _by_an_exponential(late, poles) <= WORST
    slowed = all(_lag(release, poles, free[release.number] + BLOCK * poles.period) > LAG for release in late)
    if explained or not slowed:
        return list(releases)
    return [
        _cut(release, free[release.number] + BLOCK * poles.period) if release in late else release
        for release in releases
    ]


def _by_an_exponential(releases: Sequence[Release], poles: _Poles) -> float:
    """Return what `_worst` leaves of the beginnings beside the exponential of one time that explains them best [1]."""

    def left(memory: float) -> float:
        worst = [_worst(one, poles, STEP * poles.period, math.exp(memory) * poles.period) for one in releases]
        return max(worst)

    times, least = np.log(MEMORIES), math.inf
    for _ in range(4):  # to half a percent
        values = [left(time) for time in times]
        best, least = int(np.argmin(values)), min(values)
        times = np.linspace(times[max(best - 1, 0)], times[min(best + 1, len(times) - 1)], 9)
    return least


def _cut(release: Release, start: float) -> Release:
    """Return a release without its beginning [s], in which a hand moved it: it starts from no hold."""
    return replace(release[release.time - release.start >= start], hold=0.0)


def _late_poles(releases: Sequence[Release], pace: float) -> _Poles | None:
    """Return the poles of the decays after any hand; None where they are not linear to the noise."""
    signals = [(release.time - release.start, _measured(release)) for release in releases]

    def residual(point: Array, swings: float) -> Array:
        poles = _Poles(*np.exp(point))
        return np.concatenate(
            [_residual(poles, *_window(t, y, LATEST * period, swings * period)) for t, y in signals]
        )

    def normal(point: Array, swings: float) -> Normal:
        here = residual(point, swings)
        slopes = np.column_stack(
            [(residual(point + step, swings) - here) / SLOPE for step in SLOPE * np.eye(2)]
        )
        return Normal(float(here @ here) / 2, slopes.T @ here, slopes.T @ slopes)

    omega = math.pi * 0.59 / pace
    period = 2 * math.pi / omega
    size = 2 * LATEST * period
    signals = [(t, y) for t, y in signals if t[-1] > size and np.count_nonzero(t < size) >= 12]
    if not signals:
        return None
    starts = [np.log((zeta * omega * f, omega * f)) for zeta in (0.02, 0.1, 0.4) for f in (0.85, 1.0, 1.15)]
    point = min(starts, key=lambda start: float(np.sum(residual(start, 3.0) ** 2)))
    for swings in (3.0, SWINGS):
        point = minimise(partial(normal, swings=swings), point, point - 2.0, point + 2.0, iterations=40).point
    spread = float(np.sqrt(np.mean(residual(point, SWINGS) ** 2)))
    floor = noise_floor(releases, rate=releases[0].measured == "rate").highest
    return _Poles(*np.exp(point)) if spread <= AT_NOISE * floor else None


def _worst(release: Release, poles: _Poles, start: float, memory: float | None = None) -> float:
    """Return the largest residual of the first swing from a start on, over what later swings have, pooled [1].

    Args:
        release: From when the deck left its hold.
        poles: Of the decay.
        start: From then on [s].
        memory: Of an exponential beside the decay [s].
    """
    time, measured, period = release.time - release.start, _measured(release), poles.period
    block = max(4, int(np.searchsorted(time, BLOCK * period)))

    def pooled(begin: float, memory: float | None) -> Array:
        left = _residual(poles, *_window(time, measured, begin, SWINGS * period), memory)
        return np.mean(left[: len(left) // block * block].reshape(-1, block) ** 2, axis=1)

    late, early = pooled(LATEST * period, None), pooled(start, memory)[: round(LATEST / BLOCK)]
    return float(np.sqrt(early.max() / late.max())) if len(late) > 3 and len(early) else 0.0


def _free_from(release: Release, poles: _Poles) -> float:
    """Return how long after its beginning a release follows the decay [s]; 0 where it does at once."""
    for start in np.arange(0.0, LATEST, STEP) * poles.period:
        if _worst(release, poles, start) <= WORST:
            return 0.0 if start <= EARLIEST * poles.period else float(start)
    return LATEST * poles.period


def _lag(release: Release, poles: _Poles, start: float) -> float:
    """Return how far the decay is behind one from rest that began with the release, in periods from -0.5 to 0.5.

    Args:
        release: From when the deck left its hold.
        poles: Of the decay.
        start: From when on it is followed [s].
    """
    time, measured = _window(release.time - release.start, _measured(release), start, SWINGS * poles.period)
    value, slope, _ = np.linalg.lstsq(poles.basis(time - start), measured, rcond=None)[0]
    if release.measured == "rate":
        value, slope = -(slope + 2 * poles.decay * value) / (poles.decay**2 + poles.omega**2), value
    side = math.copysign(1.0, float(release.roll[0]) - release.rest)
    phase = math.atan2(-side * (slope + poles.decay * value), side * value * poles.omega)
    behind = (poles.omega * start - phase - math.atan2(poles.decay, poles.omega)) / (2 * math.pi)
    return behind - round(behind)


def _residual(poles: _Poles, time: Array, measured: Array, memory: float | None = None) -> Array:
    """Return what the best decay leaves, with an exponential beside it where it has a memory [s], shape (n,)."""
    time = time - time[0]
    basis = poles.basis(time)
    if memory is not None:
        basis = np.column_stack((basis, np.exp(-time / memory)))
    return measured - basis @ np.linalg.lstsq(basis, measured, rcond=None)[0]


def _window(time: Array, measured: Array, start: float, end: float) -> tuple[Array, Array]:
    """Return a stretch of a signal."""
    inside = slice(*np.searchsorted(time, (start, end)))
    return time[inside], measured[inside]


def _measured(release: Release) -> Array:
    """Return what has independent errors, shape (n,)."""
    return release.rate if release.measured == "rate" and release.rate is not None else release.roll
