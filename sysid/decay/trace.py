"""One release as the linear fit uses it: the measured signal, its weights, and the correlation of its errors.

A sensor's noise is another one in each sample. A film's error lasts (`sysid.noise.lasting`), as an autoregression of order 1,
and whitening leaves of each sample

    (x_i - ρ_i x_(i-1)) / √(1 - ρ_i²),  ρ_i = e^(-(t_i - t_(i-1)) / τ)

A coarse sensor with less noise than one step repeats a value until the joint has passed the next step. Only the passage is a
measurement: there the signal lies midway between two values.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sysid.noise.lasting import kept_after, own_std
from sysid.noise.sensor import quantisation_step
from sysid.roll import Array, Release

HAND_LEAVES = 0.08
"""Share of the first amplitude after which a hand has surely left the deck."""
FEWEST = 8
"""Samples of a trace."""


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
    passages: tuple[float, float] = (0.0, 0.0)
    """Sample time [s] and step [rad or rad/s] of a coarse sensor whose passages were taken; 0 where each sample counts."""

    def whiten(self, values: Array) -> Array:
        """Return values, shape (n,) or (n, p), in typical deviations (dimensionless) and without what the sample before tells of them."""
        scaled = (values.T * self.weight).T
        if self.ar1 is None:
            return scaled
        before = np.concatenate([np.zeros_like(scaled[:1]), scaled[:-1]])
        return ((scaled.T - self.ar1 * before.T) / np.sqrt(1 - self.ar1**2)).T

    def __getitem__(self, rows: slice) -> "Trace":
        """Return some samples in a row."""
        ar1 = None if self.ar1 is None else self.ar1[rows]
        return replace(
            self, time=self.time[rows], measured=self.measured[rows], weight=self.weight[rows], ar1=ar1
        )


def traces_of(
    releases: Sequence[Release], *, whole: bool = False
) -> tuple[list[Trace], Literal["roll", "rate"]]:
    """Return the signal that was measured: the rate where a gyro measured it, else the roll.

    White noise of a gyro becomes a random walk in its integral. In the rate it stays white, and the gyro's offset is one constant.

    Args:
        whole: Begin with the release itself where the deck was held: the fast start of an overdamped joint.
    """
    rate = all(release.rate is not None for release in releases)
    traces = [_trace(release, rate=rate, whole=whole and release.hold > 0) for release in releases]
    return traces, "rate" if rate else "roll"


def with_ar1_errors(trace: Trace, omega: float) -> Trace:
    """Return a film's trace with errors that last, of a joint that swings at `omega` [rad/s]; others as they are."""
    if not trace.known_std:
        return trace
    return replace(trace, ar1=np.concatenate([[0.0], kept_after(np.diff(trace.time), omega)]))


def head(trace: Trace, span: float) -> Trace:
    """Return the first `span` seconds of a trace, at least 8 samples."""
    return trace[: max(FEWEST, int(np.searchsorted(trace.time, trace.time[0] + span)))]


def _trace(release: Release, *, rate: bool, whole: bool) -> Trace:
    measured, std = release.roll, own_std(release)
    if rate and release.rate is not None:
        measured = release.rate
        std = np.ones_like(measured) if release.rate_std is None else release.rate_std
    begin = 0 if whole else _hand_has_left(release)
    measured, std, time = measured[begin:], std[begin:], release.time[begin:]
    typical = float(np.median(std))
    weight = typical / std if typical > 0 and np.all(std > 0) else np.ones_like(measured)
    trace = Trace(time, measured, weight, typical if release.errors_last else 0.0)
    return _passages(trace)


def _passages(trace: Trace) -> Trace:
    """Return when a coarse, silent sensor passed from one value to the next; other traces as they are.

    Silent means that hardly any step is taken back at once: with noise as large as a step, half of them are.
    """
    steps = np.diff(trace.measured)
    step, moves = quantisation_step(steps), np.flatnonzero(steps)
    if not step or trace.known_std or len(moves) > len(steps) / 2:
        return trace
    back = np.count_nonzero(steps[moves][1:] * steps[moves][:-1] < 0)
    swings = max(1, np.count_nonzero(np.diff(np.sign(trace.measured - np.median(trace.measured)))))
    if back > 0.1 * len(moves) + 2 * swings or len(moves) < 3 * FEWEST:
        return trace
    middle = 0.5 * (trace.measured[moves] + trace.measured[moves + 1])
    when = 0.5 * (trace.time[moves] + trace.time[moves + 1])
    return Trace(when, middle, np.ones(len(moves)), passages=(float(np.median(np.diff(trace.time))), step))


def _hand_has_left(release: Release) -> int:
    """Return the index of the first sample at which the deck has surely been let go."""
    way = np.abs(release.roll - release.roll[0])
    enough = max(HAND_LEAVES * release.amplitude, 3.0 * float(np.median(own_std(release))))
    moved = np.flatnonzero(way > enough)
    # Of many close samples the first beyond a threshold is the one that noise has pushed there: leave it out.
    begin = int(moved[0]) + (moved[0] > 3) if len(moved) else 0
    return begin if len(release.time) - begin > FEWEST else 0
