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

    Time is what always increases, unless it counts the rows, in whole numbers one after the other. The only column that
    moves is the angle.

    Args:
        log: Their numbers.
        columns: As their names have them.
        clock_alone: The user names the motion, so that time alone is looked for.

    Raises:
        SysidError: The numbers leave it open.
    """
    found: dict[str, Kind] = {}
    moving: list[str] = []
    for name, values in numbers_of(log).items():
        column = values[np.isfinite(values)]
        if column.size < 2 or column.min() == column.max():
            continue
        if np.all(np.diff(column) > 0):  # what swings goes back
            whole = bool(np.all(column == np.rint(column)))
            counts = whole and float(np.median(np.diff(column))) == 1  # it skips the numbers of lost rows
            found[name] = "count" if counts else "time"
        else:
            moving.append(name)
    point = {"x", "y"} <= {column.axis for column in columns if column.name in moving}
    if not clock_alone and not point:
        if len(moving) != 1:
            raise SysidError(
                f"{log.path}: nothing says which of the columns {', '.join(map(repr, log.names[:12]))} is roll. "
                "Name it with --column (a number counts from 1), and its unit with --unit."
            )
        found[moving[0]] = "angle"
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
