"""Frames that show nothing: short gaps are filled in from their neighbours, long ones left out."""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.types import Rows

MAX_GAP = 3
"""Lost frames in a row that are interpolated over."""


@dataclass(frozen=True, slots=True)
class Signal:
    """Angle and deviation against time, NaN where the board was not seen."""

    time: Array
    """[s], shape (n,), as all others."""
    roll: Array
    """[rad]."""
    std: Array
    """Standard deviation [rad]."""
    own: Array
    """Share of `std` that is a frame's own [rad]."""
    index: Rows
    """Number of the tracked frame of each."""


def fill_gaps(signal: Signal, pace: float) -> tuple[Signal, int, int]:
    """Interpolate over gaps shorter than an eighth of the period, leave out others; count both.

    Args:
        signal: What was seen.
        pace: Frames in one period.
    """
    good = np.isfinite(signal.roll)
    first, last = np.flatnonzero(good)[[0, -1]]
    inside = slice(first, last + 1)
    time, roll, good = signal.time[inside], signal.roll[inside].copy(), good[inside]
    deviations = [signal.std[inside].copy(), signal.own[inside].copy()]
    index = signal.index[inside]
    turns = np.flatnonzero(np.diff(np.concatenate([[True], good, [True]]).astype(int)))
    gaps = list(zip(turns[::2], turns[1::2], strict=True))
    short = [(a, b) for a, b in gaps if b - a <= min(MAX_GAP, pace / 8)]
    if short and good.sum() >= 4:
        from scipy.interpolate import CubicSpline  # slow to start, and seldom needed

        spline = CubicSpline(time[good], roll[good])
        straight = np.interp(time, time[good], roll[good])
        for a, b in short:
            roll[a:b] = spline(time[a:b])
            # Where the deck was let go in the gap, the cubic is no better than the chord.
            for std in deviations:
                std[a:b] = np.hypot(max(std[a - 1], std[b]), np.abs(roll[a:b] - straight[a:b]))
    keep = np.isfinite(roll)
    dropped = len(signal.roll) - int(keep.sum())
    filled = int(keep.sum() - good.sum())
    std, own = (std[keep] for std in deviations)
    return Signal(time[keep], roll[keep], std, own, index[keep]), filled, dropped
