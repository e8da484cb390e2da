"""Columns without names: their quantity from the numbers themselves."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from sysid.errors import SysidError
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import Column, Kind
from sysid.roll import Array


def name_columns_by_content(log: LogFile, columns: Sequence[Column]) -> list[Column]:
    """Return the columns with the quantities that their numbers tell.

    Time is what always increases, unless it counts the rows, in whole numbers one after the other. Four columns of unit norm are a quaternion w, x, y, z. Three whose norm rests at 9.81 m/s² or 1 g are an accelerometer, three others beside it a gyro. One
    column that moves is the angle; of two, the angle is the one whose slope the other is.

    Raises:
        SysidError: The numbers leave it open.
    """
    found, signals = _told_apart(log)
    moving = list(signals)
    if len({column.size for column in signals.values()}) > 1:
        signals = {}
    found |= _sensors(moving, signals)
    if not any(kind in ("angle", "rate", "quaternion") for kind, _ in found.values()):
        raise SysidError(
            f"{log.path}: nothing says which of the columns {', '.join(map(repr, log.names[:12]))} is roll. "
            "Name it with --column (a number counts from 1), and its unit with --unit."
        )
    return _named(columns, found)


def find_time_by_content(log: LogFile, columns: Sequence[Column]) -> list[Column]:
    """Return the columns with time and the counter of the rows told by their numbers, where the user says which of the others is roll."""
    return _named(columns, _told_apart(log)[0])


def _named(columns: Sequence[Column], found: Mapping[str, tuple[Kind, str]]) -> list[Column]:
    return [
        replace(column, kind=found[column.name][0], axis=found[column.name][1])
        if column.name in found
        else column
        for column in columns
    ]


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


def _told_apart(log: LogFile) -> tuple[dict[str, tuple[Kind, str]], dict[str, Array]]:
    """Return which columns are time or count the rows, and the finite values of those that go up and down, without unit."""
    found: dict[str, tuple[Kind, str]] = {}
    moving: dict[str, Array] = {}
    for name, values in numbers_of(log).items():
        column = values[np.isfinite(values)]
        if column.size < 2 or column.min() == column.max():
            continue
        if np.all(np.diff(column) > 0):  # what swings goes back
            found[name] = ("count" if _counts(column) else "time", "")
        else:
            moving[name] = column
    return found, moving


def _counts(column: Array) -> bool:
    """Return whether a column, numbers without unit of shape (n,), counts the rows; of some that were lost, it skips the numbers."""
    return bool(np.all(column == np.rint(column))) and float(np.median(np.diff(column))) == 1


def _sensors(names: Sequence[str], signals: dict[str, Array]) -> dict[str, tuple[Kind, str]]:
    if len(names) == 1:
        return {names[0]: ("angle", "")}
    if len(signals) == 2:
        first, second = names
        slopes = abs(_slope_correlation(signals[first], signals[second]))
        backwards = abs(_slope_correlation(signals[second], signals[first]))
        if max(slopes, backwards) > 0.9:
            angle, rate = (first, second) if slopes > backwards else (second, first)
            return {angle: ("angle", ""), rate: ("rate", "")}
    found: dict[str, tuple[Kind, str]] = {}
    if len(signals) == 4 and np.allclose(np.sqrt(sum(signals[name] ** 2 for name in names)), 1.0, atol=0.02):
        found = {name: ("quaternion", axis) for name, axis in zip(names, "wxyz", strict=True)}
    if len(signals) == 6:
        for start in (0, 3):
            accel, gyro = names[start : start + 3], names[3 - start : 6 - start]
            norm = float(np.median(np.sqrt(sum(signals[name] ** 2 for name in accel))))
            if 9.0 < norm < 10.6 or 0.92 < norm < 1.08:
                found = {name: ("accel", axis) for name, axis in zip(accel, "xyz", strict=True)}
                found |= {name: ("rate", axis) for name, axis in zip(gyro, "xyz", strict=True)}
    return found


def _slope_correlation(angle: Array, rate: Array) -> float:
    slope = np.gradient(angle)
    if slope.std() == 0 or rate.std() == 0:
        return 0.0
    return float(np.corrcoef(slope, rate)[0, 1])
