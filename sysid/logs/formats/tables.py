"""Logs in which each sensor has a clock of its own."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from sysid.errors import SysidError
from sysid.logs.table.clock import time_scale
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import MAX_RATE, parse_column, sensor_of
from sysid.roll import Array

T = TypeVar("T")
TIME = "time (s)"
MAX_ELEMENTS = 128
"""Elements of an array that is a robot's state; longer ones are pictures, scans or clouds."""
VALUE = ("value", "val", "values", "data")
"""Names of the one quantity of a table whose own name says more."""
GYRO = re.compile(r"gyr|angular.?(vel|rate)", re.I)
"""Names of the gyro's table: phones measure in rad/s."""
MOTION = re.compile(
    rf"{GYRO.pattern}|acc|orient|attitude|grav|motion|raw|rotation|angle|roll|tilt|encod|joint", re.I
)
"""Names of the tables of motion sensors; a GPS or a microphone beside them is left alone."""


def sensor_tables(
    path: Path, clocks: Mapping[str, Array], columns: Mapping[str, tuple[str, Array]], note: str
) -> LogFile:
    """Return several sensors as one log; columns that are read together come on the clock of the first one asked for.

    Args:
        clocks: Time of each sensor [s], shape (n_sensor,).
        columns: Sensor and values of each column; a sensor may have no clock.
    """

    def read(names: Sequence[str]) -> dict[str, Array]:
        base = next((columns[name][0] for name in names if name != TIME), next(iter(clocks), ""))
        result: dict[str, Array] = {}
        for name in names:
            if name == TIME:
                continue
            sensor, values = columns[name]
            if sensor != base:
                if sensor not in clocks or base not in clocks:
                    raise SysidError(
                        f"{path}: '{name}' has no time of its own. Read it alone, with --column and --rate."
                    )
                order = np.argsort(clocks[sensor], kind="stable")
                values = np.interp(clocks[base], clocks[sensor][order], values[order], np.nan, np.nan)
            result[name] = values.copy()
        if TIME in names:
            if base not in clocks:
                raise SysidError(
                    f"{path}: '{names[0]}' has no time of its own. Give its sampling rate with --rate."
                )
            result[TIME] = clocks[base].copy()
        return result

    own = (TIME,) if clocks else ()
    return LogFile(path=path, names=(*own, *columns), notes=(note,), read=read)


def merge_logs(path: Path, logs: Mapping[str, LogFile], kind: str) -> LogFile:
    """Return logs of one sensor each, by its name, as one.

    Raises:
        SysidError: None of them has a column of time.
    """
    tables: dict[str, tuple[Array, dict[str, Array]]] = {}
    for stem, table in logs.items():
        columns = [parse_column(name, table.units.get(name)) for name in table.names]
        times = sorted((c for c in columns if c.kind == "time"), key=lambda c: c.unit is None)
        if not times:
            continue
        values = table.read([times[0].name, *(c.name for c in columns if c.kind != "time")])
        clock = values.pop(times[0].name)
        finite = np.isfinite(clock)
        if np.count_nonzero(finite) < 2:
            continue
        scale, _ = time_scale(clock[finite], times[0].unit)
        fast = any(np.nanmax(np.abs(column), initial=0.0) > MAX_RATE for column in values.values())
        tables[stem] = (
            clock[finite] * scale,
            {_full_name(stem, name, fast=fast): column[finite] for name, column in values.items()},
        )
    if not tables:
        raise SysidError(
            f"{path}: holds no table of a motion sensor (Gyroscope.csv, Accelerometer.csv, ...)."
        )
    _add_gravity(tables)
    columns = {name: (stem, column) for stem, (_, data) in tables.items() for name, column in data.items()}
    clocks = {stem: clock for stem, (clock, _) in tables.items()}
    return sensor_tables(path, clocks, columns, f"table: {kind} with {', '.join(tables)}")


def _full_name(stem: str, name: str, *, fast: bool) -> str:
    """Put the sensor's name before a bare axis; what the phone fused itself counts as second-hand.

    Numbers that are too `fast` for rad/s are not a phone's.
    """
    sensor, column = sensor_of(stem), parse_column(name)
    if name.lower() in VALUE:
        return stem
    if re.search(r"orient|attitude", stem, re.I):
        return f"{sensor} fused {name}"
    if column.kind == "unknown" and column.axis:
        name = f"{sensor} {name}"
    bare = name.startswith(f"{sensor} ") and column.unit is None
    return f"{name} (rad/s)" if bare and GYRO.search(stem) and not fast else name


def motion_first(tables: Iterable[T], name: Callable[[T], str] = str) -> list[T]:
    """Return the tables of motion sensors by their names; all without such a name."""
    listed = list(tables)
    return [table for table in listed if MOTION.search(name(table))] or listed


def _add_gravity(tables: dict[str, tuple[Array, dict[str, Array]]]) -> None:
    """Make sure that the accelerometer that will be taken holds gravity.

    Sensor Logger's plain accelerometer has gravity taken off and in a file of its own. A total acceleration
    beside it is taken instead, else the two are added.
    """
    gravity = next((tables.pop(stem) for stem in list(tables) if stem.lower() == "gravity"), None)
    accels = [stem for stem in tables if "acc" in stem.lower()]
    total = [stem for stem in accels if re.search("total|uncalibrated", stem, re.I)]
    for stem in accels:
        clock, data = tables[stem]
        if total and stem not in total:
            del tables[stem]
        elif gravity is not None and 2 * _norm(data) < _norm(gravity[1]):
            felt = {parse_column(name).axis: values for name, values in gravity[1].items()}
            for name in data:
                if (axis := parse_column(name).axis) in felt:
                    data[name] = data[name] + np.interp(clock, gravity[0], felt[axis], np.nan, np.nan)


def _norm(data: Mapping[str, Array]) -> float:
    return float(np.nanmedian(np.sqrt(sum(values**2 for values in data.values()))))
