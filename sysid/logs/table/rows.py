"""Which rows of a log are measurements: those with numbers that are neither placeholders nor lone outliers."""

import re
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from sysid.logs.table.clock import MIN_SAMPLES
from sysid.logs.table.remarks import Remarks, note, warning
from sysid.noise.outliers import lone_outliers
from sysid.roll import Array, shown
from sysid.shown import MOST_SHOWN
from sysid.text import count

LARGEST = float(np.iinfo(np.uint64).max)
"""Beyond it a signal or a time stamp is damage: no counter of a logger holds more [the log's unit]."""
MAX_RANGE_RATIO = 3.0
"""A value this many times the others' range away from them was not measured."""
STAND_IN = re.compile("-?9{3,}")
"""Numbers that loggers write where there is no measurement: -999, 99999."""


def measured_rows(
    signals: Mapping[str, Array], stamps: Array | None
) -> tuple[npt.NDArray[np.intp] | None, Remarks]:
    """Return the rows, out of n, that are measurements in every signal, None for all; and what the others are.

    Signals and time stamps, where there are any, are of shape (n,) each, in the log's units.
    """
    columns = [*signals.values(), *([] if stamps is None else [stamps])]
    rows = columns[0].size
    # One pass without a copy for the usual case; NaN makes both comparisons false.
    sound = np.ones(rows, dtype=np.bool_)
    remarks = Remarks()
    if rows and not all(column.min() > -LARGEST and column.max() < LARGEST for column in columns):
        sound = np.logical_and.reduce([np.abs(column) < LARGEST for column in columns])
        remarks += warning(f"{np.count_nonzero(~sound)} of {rows} rows without a number in them: dropped")
    for name, column in signals.items():
        missing = np.flatnonzero(sound)[_stand_ins(column[sound] if remarks.warnings else column)]
        if missing.size:
            values = ", ".join(f"{value:.6g}" for value in np.unique(column[missing]))
            remarks += warning(
                f"{missing.size} of {rows} rows of '{name}' hold a logger's sign for no measurement ({values}): dropped"
            )
            sound[missing] = False
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


def measured_motion(
    signals: Mapping[str, Array], time: Array, unit: str | None, *, rates: bool
) -> tuple[npt.NDArray[np.intp] | None, Remarks]:
    """Return the rows, out of n, that are no outlier in any signal, None for all; and where and how far off the others are.

    Args:
        signals: Angles without wraps or rates, in the log's unit, shape (n,) each.
        time: Strictly increasing [s], shape (n,).
        unit: Their unit, where it is known.
        rates: Whether they are rates.
    """
    out, remarks = np.zeros(time.size, dtype=np.bool_), Remarks()
    for name, signal in signals.items():
        distance = lone_outliers(time, signal, rate=rates)
        rows = np.flatnonzero(distance)
        if rows.size:
            told = [f"{distance[row]:+.3g} at {shown(float(time[row]))}" for row in rows[:MOST_SHOWN]]
            told += [f"and {rows.size - MOST_SHOWN} more"] if rows.size > MOST_SHOWN else []
            remarks += warning(
                f"{count(rows.size, 'lone sample')} of '{name}' far beside the neighbours "
                f"({', '.join(told)}{f'; {unit}' if unit else ''}): no motion does that, left out. "
                "--keep-outliers keeps such samples"
            )
            out[rows] = True
    return (np.flatnonzero(~out) if out.any() else None), remarks


def _stand_ins(signal: Array) -> npt.NDArray[np.intp]:
    """Return the rows of a signal, shape (n,), that hold a stand-in value far from all others."""
    ends = (float(signal.min()), float(signal.max())) if signal.size else ()
    missing = np.isin(signal, [value for value in ends if STAND_IN.fullmatch(f"{value:.17g}")])
    rest = signal[~missing]
    if not missing.any() or not rest.size:
        return np.zeros(0, dtype=np.intp)
    far = np.abs(signal - np.median(rest)) > MAX_RANGE_RATIO * np.ptp(rest)
    return np.flatnonzero(missing & far)
