"""Which rows of a log are measurements: those with numbers that are neither glitches nor placeholders."""

import re
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from sysid.logs.table.clock import MIN_SAMPLES
from sysid.logs.table.remarks import Remarks, note, warning
from sysid.roll import Array

LARGEST, LARGEST_STAMP = 1e12, 1e21
"""Beyond these a signal or a time stamp is damage, not a number [the log's unit]; nanoseconds since 1970 are 1.8e18."""
MAX_RANGE_RATIO = 3.0
"""A value this many times the others' range away from them is a glitch. A first swing after a hold is at most once
that range away."""
GLITCHES, GLITCH_SHARE = 10, 1 / 500
"""More rows than these, and than this share of all, that lie far from the others are a motion, or a broken sensor."""
GLITCH_ROWS = 3
"""A glitch lasts no longer; what stays away for longer was measured."""
SAMPLE = 5000
"""As many values tell whether any may lie far from the others."""
STAND_IN = re.compile("-?9{3,}")
"""Numbers that loggers write where there is no measurement: -999, 99999."""


def measured_rows(
    signals: Mapping[str, Array], stamps: Array | None
) -> tuple[npt.NDArray[np.intp] | None, Remarks]:
    """Return the rows, out of n, that are measurements in every signal, None for all; and what the others are.

    Signals and time stamps, where there are any, are of shape (n,) each, in the log's units.
    """
    limits = [
        *((column, LARGEST) for column in signals.values()),
        *(((stamps, LARGEST_STAMP),) if stamps is not None else ()),
    ]
    count = limits[0][0].size
    # One pass without a copy for the usual case; NaN makes both comparisons false.
    sound = np.ones(count, dtype=np.bool_)
    remarks = Remarks()
    if count and not all(-limit < column.min() and column.max() < limit for column, limit in limits):
        for column, limit in limits:
            sound &= np.abs(column) < limit
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
    count = signal.size
    most = max(GLITCHES, int(GLITCH_SHARE * count))
    if count < 10 * most:
        return none
    low, high = float(signal.min()), float(signal.max())
    inner = np.percentile(signal[:: max(1, count // SAMPLE)], (1, 99))
    stand_ins = [value for value in (low, high) if STAND_IN.fullmatch(f"{value:.17g}")]
    if not stand_ins and max(inner[0] - low, high - inner[1]) <= MAX_RANGE_RATIO * (inner[1] - inner[0]):
        return none  # the usual case: a few thousand values show it
    missing = np.zeros(count, dtype=np.bool_)
    for value in stand_ins:
        missing |= signal == value
    rest = signal[~missing] if missing.any() else signal
    if rest.size < max(10 * most, count // 2):
        return none
    low, high = _dense_range(rest, most)
    far = (signal < low) | (signal > high)
    if not far.any():
        return none
    edges = np.flatnonzero(np.diff(np.concatenate(([False], far, [False])).astype(np.int8)))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        if end - start > GLITCH_ROWS and not missing[start:end].all():
            far[start:end] = False
    reach = MAX_RANGE_RATIO * (high - low)
    far &= (signal < low - reach) | (signal > high + reach)
    return np.flatnonzero(far)


def _dense_range(signal: Array, most: int) -> tuple[float, float]:
    """Return least and largest value without up to `most` at either end that lie far from all that are between."""
    count = signal.size
    ordered = np.partition(signal, (most, count - 1 - most))
    low, high = float(ordered[most]), float(ordered[count - 1 - most])
    below, above = np.sort(ordered[:most])[::-1].tolist(), np.sort(ordered[count - most :]).tolist()
    grown = True
    while grown and high > low:
        grown = False
        for tail in (below, above):
            while tail and max(low - tail[0], tail[0] - high) <= MAX_RANGE_RATIO * (high - low):
                low, high, grown = min(low, tail[0]), max(high, tail[0]), True
                tail.pop(0)
    return (low, high) if high > low else (float(signal.min()), float(signal.max()))
