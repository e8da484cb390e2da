"""One release as the linear fit uses it: the measured signal, its weights, and the correlation of its errors.

The noise of a sensor is independent from sample to sample. The error of a film is correlated (`sysid.noise.lasting`), as an
autoregression of order 1. Whitening gives `(x_i - ρ_i x_(i-1)) / √(1 - ρ_i²)` with `ρ_i = e^(-(t_i - t_(i-1)) / τ)`.

A coarse sensor with less noise than one step repeats a value until the joint has passed the next step. Only this passage is a
measurement: the signal is then midway between two values.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sysid.noise.lasting import kept_after, own_std
from sysid.noise.sensor import quantisation_step
from sysid.releases.find import FEWEST_SAMPLES
from sysid.roll import Array, Release

HAND_LEAVES = 0.08
"""A hand has left the deck after this share of the first amplitude."""


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
    """Median standard deviation if it is known beforehand [rad]; 0 if the residuals give it."""
    ar1: Array | None = None
    """ρ, the correlation of each sample's error with the one before, shape (n,); None for independent errors."""
    passages: tuple[float, float] = (0.0, 0.0)
    """Sample time [s] and step [rad or rad/s] of a coarse sensor whose passages are fitted; 0 if each sample is fitted."""

    def whiten(self, values: Array) -> Array:
        """Return weighted and whitened values, shape (n,) or (n, p), in their unit."""
        scaled = (values.T * self.weight).T
        if self.ar1 is None:
            return scaled
        before = np.concatenate([np.zeros_like(scaled[:1]), scaled[:-1]])
        return ((scaled.T - self.ar1 * before.T) / np.sqrt(1 - self.ar1**2)).T

    def __getitem__(self, rows: slice) -> "Trace":
        """Return a range of samples."""
        ar1 = None if self.ar1 is None else self.ar1[rows]
        return replace(
            self, time=self.time[rows], measured=self.measured[rows], weight=self.weight[rows], ar1=ar1
        )


def traces_of(
    releases: Sequence[Release], *, whole: bool = False
) -> tuple[list[Trace], Literal["roll", "rate"]]:
    """Return the measured signal: the rate of a gyro, else the roll.

    White noise of a gyro becomes a random walk in its integral. In the rate it stays white, and the gyro's offset is one constant.

    Args:
        whole: Begin with the release itself if the deck was held: the fast start of an overdamped joint.
    """
    rate = all(release.rate is not None for release in releases)
    traces = [_trace(release, rate=rate, whole=whole and release.hold > 0) for release in releases]
    return traces, "rate" if rate else "roll"


def with_ar1_errors(trace: Trace, omega: float) -> Trace:
    """Return a film's trace with correlated errors, of a joint that swings at `omega` [rad/s]; others unchanged."""
    if not trace.known_std:
        return trace
    return replace(trace, ar1=np.concatenate([[0.0], kept_after(np.diff(trace.time), omega)]))


def head(trace: Trace, span: float) -> Trace:
    """Return the first `span` seconds of a trace, at least 8 samples."""
    return trace[: max(FEWEST_SAMPLES, int(np.searchsorted(trace.time, trace.time[0] + span)))]


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
    """Return the passages of a coarse, noiseless sensor from one value to the next; other traces unchanged.

    Without noise hardly any step is reversed at once; with noise as large as a step, half of them are.
    """
    steps = np.diff(trace.measured)
    step, moves = quantisation_step(steps), np.flatnonzero(steps)
    if not step or trace.known_std or len(moves) > len(steps) / 2:
        return trace
    back = np.count_nonzero(steps[moves][1:] * steps[moves][:-1] < 0)
    swings = max(1, np.count_nonzero(np.diff(np.sign(trace.measured - np.median(trace.measured)))))
    if back > 0.1 * len(moves) + 2 * swings or len(moves) < 3 * FEWEST_SAMPLES:
        return trace
    middle = 0.5 * (trace.measured[moves] + trace.measured[moves + 1])
    when = 0.5 * (trace.time[moves] + trace.time[moves + 1])
    return Trace(when, middle, np.ones(len(moves)), passages=(float(np.median(np.diff(trace.time))), step))


def _hand_has_left(release: Release) -> int:
    """Return the index of the first sample after the hand has left."""
    way = np.abs(release.roll - release.roll[0])
    enough = max(HAND_LEAVES * release.amplitude, 3.0 * float(np.median(own_std(release))))
    moved = np.flatnonzero(way > enough)
    # With many close samples, noise decides which one is first beyond the threshold: leave it out.
    begin = int(moved[0]) + (moved[0] > 3) if len(moved) else 0
    return begin if len(release.time) - begin > FEWEST_SAMPLES else 0
