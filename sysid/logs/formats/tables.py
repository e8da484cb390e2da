"""Logs in which each sensor has a clock of its own."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sysid.logs.table.file import LogFile
from sysid.roll import Array

TIME = "time (s)"


def sensor_tables(
    path: Path, clocks: Mapping[str, Array], columns: Mapping[str, tuple[str, Array]], note: str
) -> LogFile:
    """Return several sensors as one log; what is read together comes on the clock of the first one that is asked for.

    Args:
        clocks: Time of each sensor [s], shape (n_sensor,).
        columns: Sensor and values of each column.
    """

    def read(names: Sequence[str]) -> dict[str, Array]:
        base, _ = columns[next(name for name in names if name != TIME)]
        clock = clocks[base]
        result: dict[str, Array] = {}
        for name in names:
            if name == TIME:
                result[name] = clock.copy()
                continue
            sensor, values = columns[name]
            if sensor != base:
                order = np.argsort(clocks[sensor], kind="stable")
                values = np.interp(clock, clocks[sensor][order], values[order], left=np.nan, right=np.nan)
            result[name] = values
        return result

    return LogFile(path=path, names=(TIME, *columns), notes=(note,), read=read)
