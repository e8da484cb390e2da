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
    known = np.flatnonzero(np.isfinite(signal.roll))
    time, roll = signal.time, signal.roll.copy()
    deviations = [signal.std.copy(), signal.own.copy()]
    missing = np.diff(known) - 1
    short = np.flatnonzero((missing > 0) & (missing <= min(MAX_GAP, pace / 8)))
    if len(short) and len(known) >= 4:
        straight = np.interp(time, time[known], roll[known])
        for at in short:
            gap = slice(known[at] + 1, known[at + 1])
            near = known[max(0, min(at - 1, len(known) - 4)) :][:4]
            roll[gap] = np.polynomial.Polynomial.fit(time[near], roll[near], 3)(time[gap])
            # Where the deck was let go in the gap, the cubic is no better than the chord.
            for std in deviations:
                std[gap] = np.hypot(std[known[at : at + 2]].max(), np.abs(roll[gap] - straight[gap]))
    keep = np.isfinite(roll)
    std, own = (one[keep] for one in deviations)
    filled = Signal(time[keep], roll[keep], std, own, signal.index[keep])
    return filled, int(keep.sum()) - len(known), int((~keep).sum())
