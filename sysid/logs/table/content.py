"""Columns without names: their quantity from the numbers themselves."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from sysid.errors import SysidError
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import Column, Kind
from sysid.roll import Array


def told_by_content(log: LogFile, columns: Sequence[Column], *, clock_alone: bool) -> list[Column]:
    """Return the columns with the quantities that their numbers tell.

    Time is what always increases, unless it counts the rows, in whole numbers one after the other. One column that
    moves is the angle; of two, the angle is the one whose slope the other is.

    Args:
        log: Their numbers.
        columns: As their names have them.
        clock_alone: The user names the motion, so that time alone is looked for.

    Raises:
        SysidError: The numbers leave it open.
    """
    found: dict[str, Kind] = {}
    moving: dict[str, Array] = {}
    for name, values in numbers_of(log).items():
        column = values[np.isfinite(values)]
        if column.size < 2 or column.min() == column.max():
            continue
        if np.all(np.diff(column) > 0):  # what swings goes back
            found[name] = "count" if _counts(column) else "time"
        else:
            moving[name] = column
    if not clock_alone:
        pairs = [(a, b) for a in moving for b in moving if a != b and len(moving) == 2]
        angle, rate = max(
            pairs, key=lambda pair: _is_slope(moving[pair[1]], moving[pair[0]]), default=("", "")
        )
        if len(moving) == 1:
            found |= dict.fromkeys(moving, "angle")
        elif pairs and _is_slope(moving[rate], moving[angle]) > 0.9:
            found |= {angle: "angle", rate: "rate"}
        else:
            raise SysidError(
                f"{log.path}: nothing says which of the columns {', '.join(map(repr, log.names[:12]))} is roll. "
                "Name it with --column (a number counts from 1), and its unit with --unit."
            )
    return [replace(column, kind=found.get(column.name, column.kind)) for column in columns]


def numbers_of(log: LogFile) -> dict[str, Array]:
    """Return the columns that hold numbers, shape (n,) each, in their units; words stand in the others."""
    try:
        return log.read(log.names)
    except SysidError:
        columns: dict[str, Array] = {}
        for name in log.names:
            with suppress(SysidError):
                columns |= log.read([name])
        return columns


def _counts(column: Array) -> bool:
    """Return whether a column, numbers without unit of shape (n,), counts the rows; of some that were lost, it skips the numbers."""
    return bool(np.all(column == np.rint(column))) and float(np.median(np.diff(column))) == 1


def _is_slope(rate: Array, angle: Array) -> float:
    """Return the correlation of a rate with the slope of an angle [1], shape (n,) each; 0 where they have different rows."""
    slope = np.gradient(angle)
    if rate.size != angle.size or slope.std() == 0 or rate.std() == 0:
        return 0.0
    return abs(float(np.corrcoef(slope, rate)[0, 1]))
