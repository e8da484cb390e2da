"""Which columns of a log hold time and roll, in which unit: by name, and by content where the name is silent."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from sysid.errors import SysidError, did_you_mean
from sysid.logs.table.clock import rises
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import Column, Kind, parse_column
from sysid.logs.table.options import LogOptions
from sysid.logs.table.remarks import Remarks, note

AXIS_NAMES = {"roll": "x", "pitch": "y", "yaw": "z", "x": "x", "y": "y", "z": "z"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """The columns of time and roll in a log."""

    columns: tuple[str, ...]
    """One angle or rate; three rates x, y, z; three rates and three accelerations; or a quaternion w, x, y, z."""
    unit: str | None = None
    """Unit of the angle or of the rates; None where neither name nor user says it."""
    accel_unit: str | None = None
    scale: float | None = None
    """Radians (or rad/s) in one count, where the user gave a number as the unit."""
    axis: str = ""
    """Sensor axis that points forward, 'x', 'y' or 'z'; '' to infer it."""
    sign: float = 1.0
    std: str | None = None
    """Column of the angle's own standard deviation."""
    doubt: int = 0
    """How much their words say that these are second-hand: a reference, a goal, a phone's own fusion."""
    rivals: tuple[str, ...] = ()
    """Columns that are as good by their names."""
    remarks: Remarks
    """How the columns were chosen."""

    def with_remarks(self, remarks: Remarks) -> "Choice":
        """Return the choice with more to say."""
        return replace(self, remarks=self.remarks + remarks)


def chosen(columns: Sequence[Column], axis: str, sign: float, how: str, **more: Any) -> Choice:
    """Return columns as a choice, of unit and doubt as the first of them; the note on the signal says `how` it is made."""
    return Choice(
        columns=tuple(column.name for column in columns), unit=columns[0].unit, doubt=columns[0].doubt, axis=axis,
        sign=sign, remarks=note("signal", how), **more,
    )  # fmt: skip


def columns_of(log: LogFile, options: LogOptions) -> tuple[Column | None, list[Column]]:
    """Return the column of time, None where the user gives the rate, and the parsed others.

    Raises:
        SysidError: There is no time, or nothing says what the columns are.
    """
    columns = [parse_column(name, log.units.get(name)) for name in log.names]
    named = [column for column in columns if not re.fullmatch(r"column \d+", column.name)]
    silent = not any(column.kind != "unknown" for column in columns) or (
        len(named) < len(columns) and all(column.kind == "time" for column in named)
    )
    if silent:
        from sysid.logs.table.content import told_by_content

        columns = told_by_content(log, columns, clock_alone=options.column is not None)
    time = time_column(log, columns, options)
    others = [column for column in columns if time is None or column.name != time.name]
    return time, others


def find_column(log: LogFile, wanted: str, columns: Sequence[Column], option: str) -> Column:
    """Return the column that the user means: its name in any case, or its number counted from 1.

    Raises:
        SysidError: There is none.
    """
    text = wanted.strip()
    named = {column.name: column for column in columns}
    in_any_case = {column.name.lower(): column for column in reversed(columns)}
    counted = text.isdigit() and 1 <= int(text) <= len(log.names)
    numbered = log.names[int(text) - 1] if counted else text
    found = named.get(text) or in_any_case.get(text.lower()) or named.get(numbered)
    if found is not None:
        return found
    if numbered in log.names:
        raise SysidError(
            f"{log.path}: {option} '{wanted}' is the column of time. If it is not, name the time with --time-column."
        )
    known = ", ".join(f"'{name}'" for name in log.names[:30])
    raise SysidError(
        f"{log.path}: {option} '{wanted}': there is no such column.{did_you_mean(wanted, log.names)} "
        f"The columns are {known}."
    )


def parse_axis(text: str) -> tuple[str, float]:
    """Return the axis 'x', 'y' or 'z' and the sign of '-y', '+roll', ...

    Raises:
        SysidError: It is no axis.
    """
    name = text.strip().lower()
    sign = -1.0 if name.startswith("-") else 1.0
    axis = AXIS_NAMES.get(name.lstrip("+-"))
    if axis is None:
        raise SysidError(
            f"--axis '{text}': expected x, y, z, roll, pitch or yaw, with a minus sign to flip it."
        )
    return axis, sign


def time_column(log: LogFile, columns: Sequence[Column], options: LogOptions) -> Column | None:
    """Return the column of time; None where the user gives the sampling rate.

    Raises:
        SysidError: There is none.
    """
    if options.rate is not None:
        return None
    if options.time_column is not None:
        return find_column(log, options.time_column, columns, "--time-column")
    times = [column for column in columns if column.kind == "time"]
    # A unit in the name ('seconds_elapsed') beats a bare 'time', which may be the epoch in anything.
    times.sort(key=lambda column: (column.doubt, column.unit is None))
    if not times:
        counts = "".join(f"; {column.name!r} counts the rows" for column in columns if column.kind == "count")
        raise SysidError(
            f"{log.path}: no column of time among {', '.join(map(repr, log.names[:30]))}{counts}. "
            "Name it with --time-column, or give the sampling rate with --rate."
        )
    # One that stands still, or swings, is no clock: a receiver without a satellite, q_s beside q.
    rising = (c for c in times if len(times) == 1 or rises(log.read([c.name])[c.name]))
    return next(rising, times[0])


def std_of(column: Column, columns: Sequence[Column]) -> str | None:
    """Return the column of the same name and unit with 'std' in it."""
    own = column.axis, column.is_roll, column.unit
    stds = (other for other in columns if other.kind == "std")
    return next((s.name for s in stds if (s.axis, s.is_roll, s.unit or column.unit) == own), None)


def triple(columns: Sequence[Column], kind: Kind, axes: str) -> tuple[Column, ...] | None:
    """Return the columns x, y, z (or w, x, y, z) of one sensor: the least doubtful complete set."""
    groups: dict[tuple[int, str, str | None], dict[str, Column]] = {}
    for column in columns:
        is_roll_rate = kind == "rate" and column.is_roll
        if column.kind == kind and column.axis and column.axis in axes and not is_roll_rate:
            groups.setdefault((column.doubt, column.group, column.unit), {}).setdefault(column.axis, column)
    complete = [(key, members) for key, members in groups.items() if len(members) == len(axes)]
    if not complete:
        return None
    # Every axis of ROS's linear_acceleration carries one doubtful word, because phones mean without gravity by it.
    _, members = min(complete, key=lambda item: (item[0][0], len(item[0][1])))
    return tuple(members[axis] for axis in axes)
