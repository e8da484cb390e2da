"""The data fitted of each release: which signal, from when, and until when."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypedDict

import numpy as np

from sysid.roll import Array, Release

Bias = Literal["shared", "per-release"]
"""Sensor zero: one for all releases (it is then part of the rest angle), or one for each."""


class SignalOptions(TypedDict):
    """A choice of signal, as the fitting functions take it."""

    use_rate: bool
    bias: Bias


def signal_of(releases: Sequence[Release]) -> SignalOptions:
    """Return which signal of some releases to fit.

    Of a gyro the rate is fitted. A roll that is integrated from it drifts, and a roll fused with an accelerometer has slow errors that
    look like motion. The zero of a gyro, as of any drifting roll, differs from release to release.
    """
    drifting = any(release.zero == "drifting" for release in releases)
    gyro = all(release.rate is not None for release in releases)
    return {"use_rate": drifting and gyro, "bias": "per-release" if drifting else "shared"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """The fitted data of one release."""

    release: Release
    time: Array
    """Since the release [s], shape (n,)."""
    signal: Array
    """Measured roll [rad], or roll rate [rad/s] if `is_rate`, shape (n,)."""
    is_rate: bool
    std: float
    """Noise of the signal, one number [rad or rad/s]."""


def measured_rest(records: Sequence[Record]) -> float:
    """Return the roll at which the deck rests, as the releases have it [rad]; 0 where rates are fitted."""
    return 0.0 if records[0].is_rate else float(np.median([r.release.rest for r in records]))


def read_at_rest(record: Record, rest_angle: float, bias: Bias) -> float:
    """Return what the sensor reads while the joint rests at an angle [rad], from which motion counts; 0 of a rate.

    A zero of the release's own may be anywhere, as that of an encoder on a pendulum: there the release says it.
    """
    return measured_rest([record]) if record.is_rate or bias == "per-release" else rest_angle


def make_records(releases: Sequence[Release], std: float, *, rate: bool) -> tuple[Record, ...]:
    """Return the signals to fit, the measured rate or the roll, without the long rest at their ends.

    `std` is the noise floor of that signal [rad or rad/s].
    """
    records: list[Record] = []
    for release in releases:
        measured = release.rate if rate and release.rate is not None else release.roll
        end = _end_of_motion(release, measured, std)
        begin = _onset(release)
        time = release.time[begin:end] - release.time[0]
        records.append(Record(release=release, time=time, signal=measured[begin:end], is_rate=rate, std=std))
    return tuple(records)


LETTING_GO = 0.004
"""For how long a hand still drags while it lets go [s]."""
UNSURE_START = 0.002
"""How well the instant of a release from a hold is known at best [s]: samples and noise may hide more."""


def _onset(release: Release) -> int:
    """Return the first sample without a hand on the deck.

    A finger that slides off rounds the start just as a filter in the sensor would. The motion still begins at
    the release, where rubber and sliders are as the hold left them; roll and rate there are fitted.
    """
    if release.hold <= 0:
        return 0
    return first_from(release.time - release.time[0], LETTING_GO)


def first_from(time: Array, instant: float) -> int:
    """Return the index of the first sample at or after an instant [s] of times [s], shape (n,), to the microsecond.

    The last bits of a clock decide nothing.
    """
    return int(np.searchsorted(np.round(time, 6), instant))


def _end_of_motion(release: Release, signal: Array, std: float) -> int:
    """Return how many samples to keep: the motion, and as long again of the rest after it.

    A long rest would outweigh the motion. In the last tenth of a release that came to rest, or was caught, a hand may already touch the
    deck: it is left out.
    """
    n = len(signal)
    if release.end == "log":
        return n
    quiet = min(n, max(16, int(0.9 * n)))
    level = float(np.median(signal[int(0.7 * quiet) : quiet]))
    window = max(1, n // 100)
    smooth = np.convolve(signal[:quiet] - level, np.ones(window) / window, mode="same")
    moving = np.flatnonzero(np.abs(smooth[: quiet - window]) > 5.0 * std / np.sqrt(window))
    last = int(moving[-1]) if len(moving) else quiet
    return min(quiet, 2 * last + 16)
