"""One release as the fit of a decay sees it: what is fitted, how much each sample tells, and how long errors last.

A sensor's noise is another one in each sample. What a film's angle is off by is not: compression leaves out
motion too small to be drawn, a pattern of pixels shifts an edge, and either lasts until the deck has moved on.
Samples that share an error tell less than their number says. An error that fades as e^(-t/τ) leaves only

    (x_i - ρ_i x_(i-1)) / √(1 - ρ_i²),  ρ_i = e^(-(t_i - t_(i-1)) / τ)

of each sample as news (Ornstein and Uhlenbeck's process, exact at any sampling).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sysid.roll import Array, Release

HAND_LEAVES = 0.08
"""Share of the first amplitude after which a hand has surely left the deck."""
LASTS = 1 / 8
"""Time constant of a film's errors, in periods: they follow the motion, which has four independent values in one."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One release as the fit sees it."""

    time: Array
    """Time on the log's clock [s], shape (n,)."""
    measured: Array
    """Roll [rad] or roll rate [rad/s], shape (n,)."""
    weight: Array
    """Inverse standard deviation, relative to the median, shape (n,)."""
    stated: float = 0.0
    """Median standard deviation where it is known beforehand [rad]; 0 where the residuals tell it."""
    kept: Array | None = None
    """ρ, the share of each sample's error that it has from the one before, shape (n,); None where errors do not last."""

    def news(self, values: Array) -> Array:
        """Return what each sample adds to those before it, in typical deviations: of values (n,) or (n, p)."""
        scaled = (values.T * self.weight).T
        if self.kept is None:
            return scaled
        before = np.concatenate([np.zeros_like(scaled[:1]), scaled[:-1]])
        return ((scaled.T - self.kept * before.T) / np.sqrt(1 - self.kept**2)).T


def traces_of(releases: Sequence[Release]) -> tuple[list[Trace], Literal["roll", "rate"]]:
    """Return what to fit: the roll, or the rate where the roll is only a gyro's integral.

    White noise of a gyro becomes a random walk in its integral; in the rate it stays white, and the
    gyro's offset is one constant.
    """
    rate = all(release.origin == "gyro" and release.rate is not None for release in releases)
    return [_trace(release, rate=rate) for release in releases], "rate" if rate else "roll"


def lasting(trace: Trace, omega: float) -> Trace:
    """Return a film's trace with errors that last, of a board that swings at `omega` [rad/s]; others as they are."""
    if not trace.stated:
        return trace
    return replace(trace, kept=np.concatenate([[0.0], kept_after(np.diff(trace.time), omega)]))


def kept_after(step: Array, omega: float) -> Array:
    """Return the share of a film's error that is left after some time [s], of a board that swings at `omega` [rad/s]."""
    return np.exp(-step * omega / (2 * math.pi * LASTS))


def own_std(release: Release) -> Array:
    """Return the deviations that are not common to all samples [rad], shape (n,); all of them where that is not known."""
    return release.std if release.own_std is None else release.own_std


def head(trace: Trace, span: float) -> Trace:
    """Return the first `span` seconds of a trace, at least 8 samples."""
    count = max(8, int(np.searchsorted(trace.time, trace.time[0] + span)))
    kept = None if trace.kept is None else trace.kept[:count]
    return Trace(trace.time[:count], trace.measured[:count], trace.weight[:count], trace.stated, kept)


def _trace(release: Release, *, rate: bool) -> Trace:
    measured, std = release.roll, own_std(release)
    if rate and release.rate is not None:
        measured = release.rate
        std = np.ones_like(measured) if release.rate_std is None else release.rate_std
    begin = _hand_has_left(release)
    measured, std, time = measured[begin:], std[begin:], release.time[begin:]
    typical = float(np.median(std))
    weight = typical / std if typical > 0 and np.all(std > 0) else np.ones_like(measured)
    return Trace(time, measured, weight, typical if release.origin == "video" else 0.0)


def _hand_has_left(release: Release) -> int:
    """Return the index of the first sample at which the deck has surely been let go."""
    way = np.abs(release.roll - release.roll[0])
    enough = max(HAND_LEAVES * release.amplitude, 3.0 * float(np.median(own_std(release))))
    moved = np.flatnonzero(way > enough)
    # Of many close samples the first beyond a threshold is the one that noise has pushed there: leave it out.
    begin = int(moved[0]) + (moved[0] > 3) if len(moved) else 0
    return begin if len(release.time) - begin > 8 else 0
