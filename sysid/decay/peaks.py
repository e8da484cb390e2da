"""Peaks of a free decay, and the logarithmic decrement from them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sysid.quantity import Quantity
from sysid.releases.clear import CLEAR_AMPLITUDE
from sysid.releases.extrema import smooth_signal
from sysid.roll import Array, Release

WINDOW = 0.7
"""Half-width of the local fit at a peak, in radians of ω_n: a cubic is right to 0.1 % there."""


@dataclass(frozen=True, slots=True)
class Peak:
    """One turning point of a free decay."""

    number: int
    """Half-cycles since the release; 0 is the release itself, after a hold."""
    time: float
    """[s] on the log's clock."""
    time_std: float
    """[s]"""
    roll: float
    """Measured roll [rad]."""
    amplitude: float
    """Distance from the rest angle [rad], positive."""
    std: float
    """Standard deviation of `roll` [rad]; the rest angle's own is common to all peaks of a release."""


def find_peaks(release: Release, rest: float, omega_n: float, omega_d: float, noise: float) -> list[Peak]:
    """Find the turning points of a free decay with sub-sample timing.

    Between two passages through the rest angle, a cubic is fitted to the samples about the extreme one.
    The peaks end at the first one below `CLEAR_AMPLITUDE` standard deviations, as later ones may be noise.

    Args:
        release: The free decay; its roll without drift.
        rest: Rest angle [rad].
        omega_n: Natural frequency, for the width of the local fits [rad/s].
        omega_d: Frequency of the oscillation, for the numbers of the half-cycles [rad/s].
        noise: Standard deviation of one sample [rad], positive.
    """
    signal = smooth_signal(release.time, release.roll, noise)
    offset = np.interp(release.time, signal.time, signal.roll) - rest
    peaks = [_held_peak(release, rest, noise)] if release.hold > 0 else []
    passages = np.flatnonzero(np.diff(np.sign(offset)) != 0)
    half = math.pi / omega_d
    for begin, end in pairwise([0, *(passages + 1).tolist(), len(offset)]):
        index = begin + int(np.argmax(np.abs(offset[begin:end])))
        at_edge = index - begin < 1 or end - index <= 1
        if at_edge or release.time[index] - release.start < 0.5 * half:
            continue  # the trace enters or leaves in the middle of this swing, or this is the release itself
        peak = _local_peak(release, index, rest, omega_n, noise)
        number = round((peak.time - (peaks[-1].time if peaks else peak.time)) / half)
        number = peaks[-1].number + number if peaks else 1
        if peak.amplitude < CLEAR_AMPLITUDE * peak.std:
            break
        if not peaks or number > peaks[-1].number:
            peaks.append(replace(peak, number=number))
    return peaks


def log_decrement_two_peaks(peaks: Sequence[Peak], rest_std: float = 0.0) -> Quantity | None:
    """Return the classic δ = ln(A₁/A₂) of the first peak and the next one on the same side.

    If the next one is lost in noise, the peak on the other side counts: δ = 2 ln(A₁/A₂). None without a second
    peak.
    """
    for step, side, name in ((2, -1.0, "same"), (1, 1.0, "other")) if peaks else ():
        first, second = peaks[0], next((one for one in peaks if one.number == peaks[0].number + step), None)
        if second is None or second.amplitude >= first.amplitude:
            continue
        delta = 2 / step * math.log(first.amplitude / second.amplitude)
        # An error of the rest angle has the same sign in both peaks of a side, the opposite sign else.
        common = (1 / first.amplitude + side / second.amplitude) * rest_std
        own = math.hypot(first.std / first.amplitude, second.std / second.amplitude)
        std = 2 / step * math.hypot(own, common)
        return Quantity(delta, std, "1", f"first peak and the next one on the {name} side")
    return None


def _held_peak(release: Release, rest: float, noise: float) -> Peak:
    """Return peak 0: the angle at which the deck was held, with the hand's tremor; without its samples the first one of the decay."""
    held = release.roll[:1] if release.held is None else release.held.roll
    level, tremor = float(np.mean(held)), math.sqrt(max(float(np.var(held)) - noise**2, 0.0))
    step = float(np.median(np.diff(release.time)))
    return Peak(
        0, release.start, step, level, abs(level - rest), math.hypot(noise / math.sqrt(len(held)), tremor)
    )


def _local_peak(release: Release, index: int, rest: float, omega_n: float, noise: float) -> Peak:
    """Return the extremum of a cubic through the samples about `index`."""
    width = WINDOW / omega_n
    since = release.time - release.time[index]
    near, order = np.abs(since) <= width, 3
    if np.count_nonzero(near) < 5:  # a slow sensor: the three nearest samples and their parabola
        near, order = np.isin(np.arange(len(since)), np.argsort(np.abs(since))[:3]), 2
        width = max(width, float(np.abs(since[near]).max()))
    powers = np.vander(since[near] / width, order + 1, increasing=True)
    inverse = np.asarray(np.linalg.pinv(powers), dtype=np.float64)
    c: Array = inverse @ release.roll[near]
    bend = 2 * c[2]
    top = float(np.clip(-c[1] / bend if bend else 0.0, -1, 1))
    if order == 3:  # one Newton step for the cubic term
        slope, curve = c[1] + 2 * c[2] * top + 3 * c[3] * top**2, 2 * c[2] + 6 * c[3] * top
        top = float(np.clip(top - slope / curve if curve else top, -1, 1))
    at = top ** np.arange(order + 1)
    by_time = np.arange(order + 1) * top ** np.maximum(np.arange(order + 1) - 1, 0)
    value, value_std = float(c @ at), noise * float(np.linalg.norm(at @ inverse))
    time_std = noise * float(np.linalg.norm(by_time @ inverse)) / max(abs(bend), 1e-12) * width
    time = float(release.time[index]) + top * width
    return Peak(1, time, max(time_std, 1e-3 * width), value, abs(value - rest), max(value_std, 1e-12))
