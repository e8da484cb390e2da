"""Logs in which each sensor has a clock of its own."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from sysid.errors import SysidError
from sysid.logs.table.clock import time_scale
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import ACCEL_UNITS, parse_column, sensor_of
from sysid.roll import Array

TIME = "time (s)"
MAX_ELEMENTS = 128
"""Elements of an array that is a robot's state; longer ones are pictures, scans or clouds."""
VALUE = ("value", "val", "values", "data")
"""Names of the one quantity of a table whose own name says more."""
PLAIN_VALUE = re.compile(r"(?<=.)[./](values?|data)$", re.I)
"""The same at the end of a path."""
GYRO = re.compile(r"gyr|angular.?(vel|rate)", re.I)
"""Names of the gyro's table: phones measure in rad/s."""
MOTION = re.compile(rf"{GYRO.pattern}|acc|orient|attitude|grav|motion|raw|rotation", re.I)
"""Names of the tables of motion sensors; a GPS or a microphone beside them is left alone."""


def sensor_tables(
    path: Path, clocks: Mapping[str, Array], columns: Mapping[str, tuple[str, Array]], note: str
) -> LogFile:
    """Return several sensors as one log; columns that are read together come on the clock of the first one asked for.

    Args:
        clocks: Time of each sensor [s], shape (n_sensor,).
        columns: Sensor and values of each column; '' for a sensor without a clock.
    """

    def read(names: Sequence[str]) -> dict[str, Array]:
        base = next((columns[name][0] for name in names if name != TIME), next(iter(clocks), ""))
        result: dict[str, Array] = {}
        for name in names:
            sensor, values = (base, clocks.get(base, np.zeros(0))) if name == TIME else columns[name]
            if sensor != base:
                if not sensor or not base:
                    raise SysidError(
                        f"{path}: '{name}' has no time of its own. Read it alone, with --column and --rate."
                    )
                order = np.argsort(clocks[sensor], kind="stable")
                values = np.interp(
                    clocks[base], clocks[sensor][order], values[order], left=np.nan, right=np.nan
                )
            result[name] = values.copy()
        if TIME in result and not base:
            raise SysidError(
                f"{path}: '{names[0]}' has no time of its own. Give its sampling rate with --rate."
            )
        return result

    return LogFile(path=path, names=(TIME, *columns), notes=(note,), read=read)


def log_of_vectors(path: Path, kind: str, vectors: Mapping[str, Array]) -> LogFile:
    """Return the vectors of a file as one log, each on the clock of its length whose name is most like its own.

    The vectors are of shape (n,), of any length each, in the units of the file.

    Raises:
        SysidError: There is no vector.
    """
    named = {
        PLAIN_VALUE.sub("", name): np.asarray(v, np.float64) for name, v in vectors.items() if len(v) > 1
    }
    if not named:
        raise SysidError(f"{path}: no vector of numbers among {', '.join(vectors) or 'nothing'}.")
    parsed = {name: parse_column(name) for name in named}
    clocks = [name for name in named if parsed[name].kind == "time"]
    owner: dict[str, str] = {}
    for name in named:
        same = [clock for clock in clocks if len(named[clock]) == len(named[name])]
        owner[name] = max(same, key=lambda clock: len(_shared(clock, name)), default="")
    used = dict.fromkeys(clock for name, clock in owner.items() if clock and name not in clocks)
    note = f"table: {kind} file with {', '.join(named)}"
    if len(used) > 1:
        scaled = {clock: named[clock] * time_scale(named[clock], parsed[clock].unit)[0] for clock in used}
        columns = {name: (owner[name], named[name]) for name in named if name not in clocks}
        return sensor_tables(path, scaled, columns, note)

    def read(names: Sequence[str]) -> dict[str, Array]:
        if len({len(named[name]) for name in names}) > 1:
            raise SysidError(
                f"{path}: {', '.join(f'{name!r} has {len(named[name])} values' for name in names)}. Name the time of the "
                "same length with --time-column, or give --rate."
            )
        return {name: named[name].copy() for name in names}

    longest = len(named[next(iter(used), max(named, key=lambda name: len(named[name])))])
    first = sorted(named, key=lambda name: len(named[name]) != longest)
    return LogFile(path=path, names=tuple(first), notes=(note,), read=read)


def _shared(one: str, other: str) -> str:
    """Return the beginning that two names share."""
    return one[: next((n for n, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), len(one))]


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
        values = table.read(
            [times[0].name, *(c.name for c in columns if c.kind != "time" and c.name not in table.dates)]
        )
        clock = values.pop(times[0].name)
        finite = np.isfinite(clock)
        if np.count_nonzero(finite) < 2:
            continue
        scale, _ = time_scale(clock[finite], times[0].unit)
        tables[stem] = (
            clock[finite] * scale,
            {_full_name(stem, name): column[finite] for name, column in values.items()},
        )
    if not tables:
        raise SysidError(
            f"{path}: holds no table of a motion sensor (Gyroscope.csv, Accelerometer.csv, ...)."
        )
    _add_gravity(tables)
    columns = {name: (stem, column) for stem, (_, data) in tables.items() for name, column in data.items()}
    clocks = {stem: clock for stem, (clock, _) in tables.items()}
    return sensor_tables(path, clocks, columns, f"table: {kind} with {', '.join(tables)}")


def _full_name(stem: str, name: str) -> str:
    """Put the sensor's name before a bare axis; what the phone fused itself counts as second-hand."""
    sensor, column = sensor_of(stem), parse_column(name)
    if name.lower() in VALUE:
        return stem
    if re.search(r"orient|attitude", stem, re.I):
        return f"{sensor} fused {name}"
    if column.kind == "unknown" and column.axis:
        name = f"{sensor} {name}"
    bare = name.startswith(f"{sensor} ") and column.unit is None
    return f"{name} (rad/s)" if bare and GYRO.search(stem) else name


def motion_first(sensors: Iterable[str]) -> list[str]:
    """Return the sensors of motion among some names; all without such a name."""
    names = list(map(str, sensors))
    return [name for name in names if MOTION.search(name)] or names


def _add_gravity(tables: dict[str, tuple[Array, dict[str, Array]]]) -> None:
    """Make sure that the accelerometer that will be taken holds gravity.

    Sensor Logger's plain accelerometer has gravity taken off and in a file of its own. A total acceleration
    beside it is taken instead, else the two are added.
    """
    accels = {
        stem: names
        for stem, (_, data) in tables.items()
        if re.search("acc", stem, re.I) and len(names := _axes(data)) == 3
    }
    whole = [stem for stem, names in accels.items() if _holds_gravity(tables[stem][1], names)]
    bare = [stem for stem in accels if stem not in whole]
    gravity = next((stem for stem in tables if re.fullmatch("gravity", stem, re.I)), None)
    if not whole and bare and gravity is not None:
        clock, data = tables[bare[0]]
        other_clock, other = tables[gravity]
        for mine, its in zip(accels[bare[0]], _axes(other), strict=False):
            data[mine] = data[mine] + np.interp(clock, other_clock, other[its], left=np.nan, right=np.nan)
        bare = bare[1:]
    for stem in bare if whole else ():
        del tables[stem]
    if gravity is not None:
        del tables[gravity]


def _axes(data: Mapping[str, Array]) -> list[str]:
    found = {parse_column(name).axis: name for name in data if parse_column(name).axis in ("x", "y", "z")}
    return [found[axis] for axis in "xyz" if axis in found]


def _holds_gravity(data: Mapping[str, Array], names: Sequence[str]) -> bool:
    norm = float(np.nanmedian(np.sqrt(sum(data[name] ** 2 for name in names))))
    return any(0.8 < norm * unit / ACCEL_UNITS["g"] < 1.25 for unit in (1.0, ACCEL_UNITS["g"]))
