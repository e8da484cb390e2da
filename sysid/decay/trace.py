"""One release as the linear fit uses it: the signal, its weights, and the correlation of its errors.

A sensor's noise is another one in each sample; a film's error lasts (`sysid.noise.lasting`), as an
autoregression of order 1. Whitened, it leaves

    (x_i - ρ_i x_(i-1)) / √(1 - ρ_i²),  ρ_i = e^(-(t_i - t_(i-1)) / τ)

of each sample.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sysid.noise.lasting import kept_after, own_std
from sysid.roll import Array, Release

HAND_LEAVES = 0.08
"""Share of the first amplitude after which a hand has surely left the deck."""


@dataclass(frozen=True, slots=True)
class Trace:
    """One release as the fit sees it."""

    time: Array
    """Time on the log's clock [s], shape (n,)."""
    measured: Array
    """Roll [rad] or roll rate [rad/s], shape (n,)."""
    weight: Array
    """Inverse standard deviation, relative to the median, shape (n,)."""
    known_std: float = 0.0
    """Median standard deviation where it is known beforehand [rad]; 0 where the residuals tell it."""
    ar1: Array | None = None
    """ρ, the share of each sample's error that it has from the one before, shape (n,); None where errors do not last."""

    def whiten(self, values: Array) -> Array:
        """Return values, shape (n,) or (n, p), in typical deviations (dimensionless) and without what the sample before tells of them."""
        scaled = (values.T * self.weight).T
        if self.ar1 is None:
            return scaled
        before = np.concatenate([np.zeros_like(scaled[:1]), scaled[:-1]])
        return ((scaled.T - self.ar1 * before.T) / np.sqrt(1 - self.ar1**2)).T


def traces_of(releases: Sequence[Release]) -> tuple[list[Trace], Literal["roll", "rate"]]:
    """Return the signal to fit: the roll, or the rate where the roll is only a gyro's integral.

    White noise of a gyro becomes a random walk in its integral; in the rate it stays white, and the
    gyro's offset is one constant.
    """
    rate = all(release.measured == "rate" for release in releases)
    return [_trace(release, rate=rate) for release in releases], "rate" if rate else "roll"


def with_ar1_errors(trace: Trace, omega: float) -> Trace:
    """Return a film's trace with errors that last, of a board that swings at `omega` [rad/s]; others as they are."""
    if not trace.known_std:
        return trace
    return replace(trace, ar1=np.concatenate([[0.0], kept_after(np.diff(trace.time), omega)]))


def head(trace: Trace, span: float) -> Trace:
    """Return the first `span` seconds of a trace, at least 8 samples."""
    count = max(8, int(np.searchsorted(trace.time, trace.time[0] + span)))
    ar1 = None if trace.ar1 is None else trace.ar1[:count]
    return Trace(trace.time[:count], trace.measured[:count], trace.weight[:count], trace.known_std, ar1)


def _trace(release: Release, *, rate: bool) -> Trace:
    measured, std = release.roll, own_std(release)
    if rate and release.rate is not None:
        measured = release.rate
        std = np.ones_like(measured) if release.rate_std is None else release.rate_std
    begin = _hand_has_left(release)
    measured, std, time = measured[begin:], std[begin:], release.time[begin:]
    typical = float(np.median(std))
    weight = typical / std if typical > 0 and np.all(std > 0) else np.ones_like(measured)
    return Trace(time, measured, weight, typical if release.errors_last else 0.0)


def _hand_has_left(release: Release) -> int:
    """Return the index of the first sample at which the deck has surely been let go."""
    way = np.abs(release.roll - release.roll[0])
    enough = max(HAND_LEAVES * release.amplitude, 3.0 * float(np.median(own_std(release))))
    moved = np.flatnonzero(way > enough)
    # Of many close samples the first beyond a threshold is the one that noise has pushed there: leave it out.
    begin = int(moved[0]) + (moved[0] > 3) if len(moved) else 0
    return begin if len(release.time) - begin > 8 else 0
