"""Tables in which each row says which sensor or topic it is of."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sysid.logs.formats.tables import VALUE, merge_logs, motion_first
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import parse_column
from sysid.roll import Array

SENSOR = ("sensor", "sensor name", "sensor_name", "sensortype", "sensor_type", "topic", "variable", "type", "name", "signal",
          "channel")  # fmt: skip
"""Names of the column of sensors."""


def sensor_column(names: Sequence[str]) -> str | None:
    """Return the column that says whose each row is, beside bare axes or values; None without one."""
    bare = [
        name
        for name in names
        if name.lower() in VALUE or (parse_column(name).axis and parse_column(name).kind == "unknown")
    ]
    return next((name for name in names if bare and name.strip().lower() in SENSOR), None)


def by_sensor(path: Path, table: LogFile, sensors: npt.NDArray[np.str_], column: str) -> LogFile:
    """Return a long table as the tables of its sensors, merged.

    Args:
        path: The file.
        table: The whole of it.
        sensors: The sensor of each row, shape (n,), without unit.
        column: The column that they come from.
    """
    logs: dict[str, LogFile] = {}
    names = tuple(name for name in table.names if name != column)
    whole = cache(table.read)  # all sensors have the same columns
    for sensor in motion_first(np.unique(sensors)):
        rows = np.flatnonzero(sensors == sensor)

        def read(wanted: Sequence[str], rows: npt.NDArray[np.intp] = rows) -> dict[str, Array]:
            return {name: values[rows] for name, values in whole(tuple(wanted)).items()}

        logs[str(sensor)] = replace(table, names=names, read=read)
    return merge_logs(path, logs, f"rows of each '{column}'")
