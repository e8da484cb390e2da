"""The noise floor of releases: the standard deviation of what a sensor adds."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import comb

import numpy as np

from sysid.errors import SysidError
from sysid.noise.sensor import quantisation_step
from sysid.quantity import Z95
from sysid.roll import Array, Release

_ORDERS = (4, 6, 8, 10)
"""Even difference orders; a higher one removes more of the motion but is a little noisier."""
_CONFIRMED = 1.02
"""Ratio up to which two orders agree; their common noise cancels in it."""
_NEIGHBOURS = comb(4 * _ORDERS[-1], 2 * _ORDERS[-1]) / comb(2 * _ORDERS[-1], _ORDERS[-1]) ** 2
"""Σ ρ² of differences of the highest order: so many of them say as much as one independent sample."""


FROM_SCATTER = "estimated from the sample-to-sample scatter"
"""How a noise floor was found that no smooth motion can have made."""


@dataclass(frozen=True, slots=True)
class NoiseFloor:
    """Standard deviation of the sensor noise, and how it was found."""

    std: float
    """[rad], or [rad/s] for a rate."""
    how: str
    relative_std: float = 0.0
    """Standard deviation of `std` itself, as a share of it: few samples tell little about their noise."""

    @property
    def highest(self) -> float:
        """Upper end of the 95 % interval of `std`."""
        return self.std * (1 + Z95 * self.relative_std)

    @property
    def lowest(self) -> float:
        """Lower end of the 95 % interval of `std`."""
        return self.std * max(0.0, 1 - Z95 * self.relative_std)


def difference_std(signal: Array) -> float:
    """Return the noise of a sampled smooth motion from its high-order differences.

    Differences of order m suppress a motion of frequency f by (2 sin πf/f_s)^m and keep white noise,
    whose m-th difference has variance C(2m, m) σ². Taken is the lowest order that the next one confirms:
    the smallest of all orders would be too low by chance, and the first that hardly falls too high.
    Kinks of the motion are few, so where they rule, a robust spread (median absolute deviation) is taken.

    Args:
        signal: Evenly sampled, shape (n,), n > 16.

    Returns:
        Standard deviation in the signal's unit. It holds for noise that is independent from sample to
        sample; a smoothing sensor has more noise than this shows.
    """
    estimates = [_order_std(signal, order) for order in _ORDERS if len(signal) - order >= 8]
    for estimate, following in pairwise(estimates):
        if estimate <= _CONFIRMED * following:
            return estimate
    return estimates[-1] if estimates else float("inf")


def _order_std(signal: Array, order: int) -> float:
    differences = np.diff(signal, order)
    spread = float(np.sqrt(np.mean(differences**2)))
    robust = 1.4826 * float(np.median(np.abs(differences - np.median(differences))))
    if robust > 0 and spread > 1.3 * robust:  # a few kinks or outliers, not the noise
        spread = robust
    return spread / float(np.sqrt(comb(2 * order, order)))


def noise_floor(releases: Sequence[Release], *, rate: bool = False) -> NoiseFloor:
    """Estimate the sensor noise of some releases.

    From differences, pooled over all samples: a motion is smooth, white noise is not. Two kinds of sensor
    need more. One that smooths (a filter, a fusion of sensors) has noise that differences do not show; the
    spread at rest shows it. One with coarse steps shows no noise at all while it stands still; a
    twelfth of the step squared is the least that counts.

    Raises:
        SysidError: No release has the dozen samples that differences take.
    """
    squares, still, count, resting = 0.0, 0.0, 0, 0
    for release in releases:
        signal = _signal(release, rate=rate)
        spread = difference_std(signal)
        if np.isfinite(spread):  # else too short for differences, and the others must do
            squares += len(signal) * spread**2
            count += len(signal)
        if release.end == "rest":
            tail = signal[int(0.65 * len(signal)) : int(0.9 * len(signal))]
            wander = _without_swing(tail)
            power = np.abs(np.fft.rfft(wander)) ** 2
            if power.max(initial=0.0) < 0.25 * power.sum():  # else one frequency rules: it still swings
                still += float(np.sum(wander**2))
                resting += len(tail)
    if not count:
        longest = max(len(release.time) for release in releases)
        raise SysidError(
            f"the longest release has {longest} samples, too few to tell noise from motion. Record at a higher rate, "
            "until the deck rests."
        )
    std = float(np.sqrt(squares / count))
    unit = "rad/s" if rate else "rad"
    level = pooled_step(releases, rate=rate)
    if level / np.sqrt(12) > std:
        return NoiseFloor(level / float(np.sqrt(12)), f"from the sensor's steps of {level:.3g} {unit}")
    spread = float(np.sqrt(still / resting)) if resting > 50 else 0.0
    if spread > 1.2 * std:
        return NoiseFloor(
            spread,
            f"from the spread at rest; the sensor smooths (sample to sample it moves by {std:.2g} {unit} only)",
            float(np.sqrt(0.5 / resting)),
        )
    return NoiseFloor(
        std,
        f"{FROM_SCATTER} of {count} samples",
        float(np.sqrt(0.5 * _NEIGHBOURS / max(count - _ORDERS[-1] * len(releases), 8))),
    )


def _without_swing(tail: Array) -> Array:
    """Return a stretch at rest without its trend and without what is left of the swing that faded before.

    The swing is a sine whose amplitude falls smoothly, at the frequency that has the most power.
    """
    t = np.linspace(-1, 1, len(tail))
    wander = tail - np.polyval(np.polyfit(t, tail, 1), t)
    size = 8 * len(tail)
    peak = int(np.argmax(np.abs(np.fft.rfft(wander, size))))
    phase = 2 * np.pi * peak / size * np.arange(len(tail))
    sine = [shape * t**power for shape in (np.cos(phase), np.sin(phase)) for power in range(3)]
    table = np.column_stack([np.ones_like(t), t, *sine])
    rest = tail - table @ np.linalg.lstsq(table, tail, rcond=None)[0]
    # White noise loses as many of its degrees of freedom as the table has columns.
    return rest * np.sqrt(len(tail) / max(len(tail) - table.shape[1], 1))


def _signal(release: Release, *, rate: bool) -> Array:
    return release.rate if rate and release.rate is not None else release.roll


def pooled_step(releases: Sequence[Release], *, rate: bool) -> float:
    """Return the quantisation step of the sensor behind some releases [rad or rad/s], 0 where none can be seen."""
    return quantisation_step(np.concatenate([np.diff(_signal(release, rate=rate)) for release in releases]))
