"""Rows of a log that measured a motion: all but lone outliers."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from sysid.logs.table.remarks import Remarks, warning
from sysid.noise.outliers import lone_outliers
from sysid.roll import Array, shown
from sysid.shown import MOST_SHOWN
from sysid.text import count


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
