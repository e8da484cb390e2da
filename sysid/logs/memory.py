"""Logs in memory: arrays and data frames as the table that a file would be."""

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sysid.errors import SysidError
from sysid.logs.sources.registry import LENGTHS
from sysid.logs.table.file import LogFile, held
from sysid.logs.table.frame import columns_of_frame
from sysid.logs.table.names import parse_unit, unit_kind
from sysid.roll import Array

SI_UNITS = {"angle": "rad", "rate": "rad/s"}
"""Units of arrays that name none."""


def table_of_arrays(
    time: npt.ArrayLike,
    *,
    angle: npt.ArrayLike | None,
    rate: npt.ArrayLike | None,
    unit: str | None,
    name: str,
) -> LogFile:
    """Return time and one signal as a table.

    Args:
        time: [s], shape (n,); numpy dates are counted from the first.
        angle: In `unit`, shape (n,).
        rate: In `unit`, shape (n,), instead of the angle.
        unit: 'rad' or 'rad/s' if None.
        name: Of the log; made from the numbers if empty.

    Raises:
        SysidError: Both signals or none, a shape that does not fit, or a unit of another kind.
    """
    if (angle is None) == (rate is None):
        raise SysidError(
            "from_arrays takes the signal that was measured: angle=… or rate=…, one of them. An encoder measures the angle, "
            "a gyro the rate."
        )
    kind, given = ("angle", angle) if angle is not None else ("rate", rate)
    unit = SI_UNITS[kind] if unit is None else unit
    standard = parse_unit(unit) or unit
    if unit_kind(standard) != kind and standard not in LENGTHS[kind]:
        wanted = "rad, deg, m or mm" if kind == "angle" else "rad/s, deg/s or m/s"
        raise SysidError(f"unit {unit!r} of {kind}=…: expected {wanted}.")
    columns = {"time": _column(time, "time"), kind: _column(given, kind)}
    if len(columns["time"]) != len(columns[kind]):
        raise SysidError(
            f"time has {len(columns['time'])} samples and {kind} has {len(columns[kind])}: give a time for each sample."
        )
    return _table(columns, {"time": "s", kind: standard}, name)


def table_of_frame(frame: object, name: str) -> LogFile:
    """Return the columns of a data frame as a table.

    Raises:
        SysidError: It is no data frame, or holds no numbers.
    """
    import pandas as pd

    if not isinstance(frame, pd.DataFrame):
        raise SysidError(f"from_dataframe takes a pandas DataFrame; this is a {type(frame).__name__}.")
    return _table(*columns_of_frame(frame), name)


def _column(values: npt.ArrayLike | None, name: str) -> Array:
    """Return one column, shape (n,), as float64; dates as seconds since the first."""
    try:
        array = np.asarray(values)
        if array.dtype.kind == "M":
            array = (array - array[0]) / np.timedelta64(1, "s")
        array = array.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise SysidError(f"{name} is no array of numbers ({error}).") from error
    if array.ndim != 1 or array.size == 0:
        raise SysidError(f"{name} has the shape {array.shape}; expected one dimension, a number a sample.")
    return array


def _table(columns: Mapping[str, Array], units: Mapping[str, str], name: str) -> LogFile:
    """Return columns as a table; its made name is one and the same for the same numbers."""
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(column).tobytes() for column in columns.values()))
    return held(Path(name or f"arrays-{digest.hexdigest()[:8]}"), columns, units=units)
