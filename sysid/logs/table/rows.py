"""Which rows of a log are measurements: those with numbers that are neither glitches nor placeholders."""

import re
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from sysid.logs.table.clock import MIN_SAMPLES
from sysid.logs.table.remarks import Remarks, note, warning
from sysid.roll import Array

LARGEST = float(np.iinfo(np.uint64).max)
"""Beyond it a signal or a time stamp is damage: no counter of a logger holds more [the log's unit]."""
MAX_RANGE_RATIO = 3.0
"""A value this many times the others' range away from them is a glitch. A first swing after a hold is at most once
that range away."""
GLITCH_SHARE, GLITCH_ROWS = 500, 3
"""More than one row in so many that lies far from the others, and more rows on end, were measured."""
STAND_IN = re.compile("-?9{3,}")
"""Numbers that loggers write where there is no measurement: -999, 99999."""


def measured_rows(
    signals: Mapping[str, Array], stamps: Array | None
) -> tuple[npt.NDArray[np.intp] | None, Remarks]:
    """Return the rows, out of n, that are measurements in every signal, None for all; and what the others are.

    Signals and time stamps, where there are any, are of shape (n,) each, in the log's units.
    """
    columns = [*signals.values(), *([] if stamps is None else [stamps])]
    count = columns[0].size
    # One pass without a copy for the usual case; NaN makes both comparisons false.
    sound = np.ones(count, dtype=np.bool_)
    remarks = Remarks()
    if count and not all(column.min() > -LARGEST and column.max() < LARGEST for column in columns):
        sound = np.logical_and.reduce([np.abs(column) < LARGEST for column in columns])
        remarks += warning(f"{np.count_nonzero(~sound)} of {count} rows without a number in them: dropped")
    for name, column in signals.items():
        far = _far(column[sound] if remarks.warnings else column)
        if far.size:
            far = np.flatnonzero(sound)[far]
            shown = ", ".join(f"{value:.6g}" for value in np.unique(column[far])[:3])
            remarks += warning(
                f"{far.size} of {count} rows of '{name}' lie far from all others ({shown}): glitches, or a logger's "
                "sign for no measurement; dropped"
            )
            sound[far] = False
    return (np.flatnonzero(sound) if remarks.warnings else None), remarks


def on_common_rows(data: Mapping[str, Array], stamps: Array | None) -> tuple[dict[str, Array], Remarks]:
    """Return the columns, shape (n,) each in the log's units, with those of sensors that write rows of their own brought together.

    If hardly a row holds all of them, each is interpolated to the rows of the first.
    """
    finite = {name: np.isfinite(column) for name, column in data.items()}
    together = np.logical_and.reduce(list(finite.values()))
    alone = min(np.count_nonzero(rows) for rows in finite.values())
    if alone < MIN_SAMPLES or 2 * np.count_nonzero(together) >= alone:
        return dict(data), Remarks()
    at = np.arange(together.size, dtype=np.float64) if stamps is None else stamps
    if not np.all(np.diff(at) >= 0):
        return dict(data), Remarks()
    first = next(iter(finite.values()))
    joined = {
        name: np.where(first, np.interp(at, at[rows], data[name][rows], left=np.nan, right=np.nan), np.nan)
        for name, rows in finite.items()
    }
    return joined, note("rows", f"sensors have rows of their own: brought to those of '{next(iter(data))}'")


def _far(signal: Array) -> npt.NDArray[np.intp]:
    """Return the rows of a signal, shape (n,), that lie far from all others, for a moment or with one stand-in value."""
    none = np.zeros(0, dtype=np.intp)
    most = max(MIN_SAMPLES, signal.size // GLITCH_SHARE)
    if signal.size < 4 * most:
        return none
    ends = float(signal.min()), float(signal.max())
    missing = np.zeros(signal.size, dtype=np.bool_)
    for value in ends:
        if STAND_IN.fullmatch(f"{value:.17g}"):
            missing |= signal == value
    rest = signal[~missing] if missing.any() else signal
    if 2 * rest.size < signal.size:
        return none
    low, high = np.percentile(rest[::most], (1, 99))
    reach = MAX_RANGE_RATIO * (high - low)
    if not missing.any() and low - reach <= ends[0] and ends[1] <= high + reach:
        return none  # the usual case: a few hundred values show it
    ordered = np.partition(rest, (most, rest.size - 1 - most))
    low, high = float(ordered[most]), float(ordered[-1 - most])
    if low == high:  # at rest for nearly all of the time
        low, high = float(rest.min()), float(rest.max())
    reach = MAX_RANGE_RATIO * (high - low)
    far = (signal < low - reach) | (signal > high + reach)
    # Far rows with few others between them belong together: a fast swing passes the middle in a row or two.
    joined = np.convolve(far, np.ones(GLITCH_ROWS + 1), "full") > 0
    edges = np.flatnonzero(np.diff(np.concatenate(([False], joined, [False])).astype(np.int8)))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        rows = slice(start, end - GLITCH_ROWS)
        if rows.stop - start > GLITCH_ROWS and not missing[rows][far[rows]].all():
            far[rows] = False
    return np.flatnonzero(far)
