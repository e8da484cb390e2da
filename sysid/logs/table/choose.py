"""Which columns of a log hold time and roll, in which unit: by name, and by content where the name is silent."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from sysid.errors import HuskyError, did_you_mean
from sysid.logs.formats.registry import LogFile
from sysid.logs.table.names import ANGLE_UNITS, RATE_UNITS, Column, Kind, parse_column, parse_unit, unit_kind
from sysid.roll import Array, Origin

if TYPE_CHECKING:
    from sysid.logs import LogOptions

AXIS_NAMES = {"roll": "x", "pitch": "y", "yaw": "z", "x": "x", "y": "y", "z": "z"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """Where roll and time are in a log."""

    source: Origin
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
    """Words that say that these are second-hand: a reference, a goal, a phone's own fusion."""
    time: str | None = None
    time_unit: str | None = None
    notes: list[str] = field(default_factory=list[str])
    warnings: list[str] = field(default_factory=list[str])


def choose_columns(log: LogFile, options: "LogOptions") -> Choice:
    """Choose what to read.

    Raises:
        HuskyError: A named column does not exist, or nothing in the log can be taken for roll or for time.
    """
    columns = [parse_column(name, unit) for name, unit in zip(log.names, log.units, strict=True)]
    if not any(column.kind != "unknown" for column in columns) and options.column is None:
        from sysid.logs.table.content import name_columns_by_content

        columns = name_columns_by_content(log, columns)
    time = _time_column(log, columns, options)
    columns = [column for column in columns if time is None or column.name != time.name]
    choice = _signal(log, columns, options)
    choice = _with_unit(choice, options)
    if time is not None:
        choice = replace(choice, time=time.name, time_unit=time.unit)
    return choice


def find_column(log: LogFile, wanted: str, columns: Sequence[Column], option: str) -> Column:
    """Return the column that the user means: its name in any case, or its number counted from 1.

    Raises:
        HuskyError: There is none.
    """
    text = wanted.strip()
    for column in columns:
        if column.name == text:
            return column
    for column in columns:
        if column.name.lower() == text.lower():
            return column
    if text.isdigit() and 1 <= int(text) <= len(log.names):
        name = log.names[int(text) - 1]
        text = name
        for column in columns:
            if column.name == name:
                return column
    if text in log.names:
        raise HuskyError(
            f"{log.path}: {option} '{wanted}' is the column of time. If it is not, name the time with --time-column."
        )
    known = ", ".join(f"'{name}'" for name in log.names[:30])
    raise HuskyError(
        f"{log.path}: {option} '{wanted}': there is no such column.{did_you_mean(wanted, log.names)} "
        f"The columns are {known}."
    )


def parse_axis(text: str) -> tuple[str, float]:
    """Return the axis 'x', 'y' or 'z' and the sign of '-y', '+roll', ...

    Raises:
        HuskyError: It is no axis.
    """
    name = text.strip().lower()
    sign = -1.0 if name.startswith("-") else 1.0
    axis = AXIS_NAMES.get(name.lstrip("+-"))
    if axis is None:
        raise HuskyError(
            f"--axis '{text}': expected x, y, z, roll, pitch or yaw, with a minus sign to flip it."
        )
    return axis, sign


def _time_column(log: LogFile, columns: Sequence[Column], options: "LogOptions") -> Column | None:
    if options.rate is not None:
        return None
    if options.time_column is not None:
        return find_column(log, options.time_column, columns, "--time-column")
    times = [column for column in columns if column.kind == "time"]
    # A unit in the name ('seconds_elapsed') beats a bare 'time', which may be the epoch in anything.
    times.sort(key=lambda column: (column.doubt, column.unit is None))
    if not times:
        raise HuskyError(
            f"{log.path}: no column of time among {', '.join(map(repr, log.names[:30]))}. "
            "Name it with --time-column, or give the sampling rate with --rate."
        )
    return times[0]


def _signal(log: LogFile, columns: Sequence[Column], options: "LogOptions") -> Choice:
    axis, sign = parse_axis(options.axis) if options.axis else ("", 1.0)
    if options.column is not None:
        return _named_signal(
            log, find_column(log, options.column, columns, "--column"), columns, axis, sign, options
        )
    finders = {"angle": _angle, "imu": _imu, "gyro": _gyro, "quaternion": _quaternion}
    wanted = list(finders) if options.source == "auto" else [options.source]
    found = [choice for name in wanted if (choice := finders[name](columns, axis, sign)) is not None]
    if not found:
        what = "roll, angle or rotation rate" if options.source == "auto" else options.source
        raise HuskyError(
            f"{log.path}: no column of {what} among {', '.join(map(repr, log.names[:30]))}"
            + (f" about axis '{options.axis}'" if options.axis else "")
            + ". Name one with --column, and its unit with --unit."
        )
    choice = min(found, key=lambda candidate: candidate.doubt)
    if len(found) > 1:
        others = ", ".join(other.source for other in found if other is not choice)
        choice.notes.append(f"the log also holds {others}: choose with --source")
    return choice


def _named_signal(
    log: LogFile, column: Column, columns: Sequence[Column], axis: str, sign: float, options: "LogOptions"
) -> Choice:
    kind = unit_kind(parse_unit(options.unit)) if options.unit else "unknown"
    kind = kind if kind in ("angle", "rate") else column.kind
    if kind == "rate" or options.source == "gyro":
        unit = column.unit if unit_kind(column.unit) == "rate" else None
        notes = [f"rate from '{column.name}', integrated"]
        return Choice(source="gyro", columns=(column.name,), unit=unit, sign=sign, notes=notes)
    if kind == "accel":
        raise HuskyError(
            f"{log.path}: '{column.name}' is an acceleration; roll needs an angle, a rotation rate, or all three "
            "axes of accelerometer and gyro (leave --column out)."
        )
    unit = column.unit if unit_kind(column.unit) == "angle" else None
    return Choice(
        source="angle",
        columns=(column.name,),
        unit=unit,
        sign=sign,
        std=_std_of(column, columns),
        notes=[f"roll from '{column.name}'"],
    )


def _angle(columns: Sequence[Column], axis: str, sign: float) -> Choice | None:
    angles = [c for c in columns if c.kind == "angle" and (not axis or (c.axis or "x") == axis)]
    if not angles:
        return None

    def rank(column: Column) -> tuple[object, ...]:
        aside = not axis and column.axis in ("y", "z")
        return (
            column.doubt,
            aside,
            not column.is_roll,
            column.unit != "rad",
            column.unit is None,
            len(column.name),
        )

    angles.sort(key=rank)
    best = angles[0]
    rivals = [c.name for c in angles[1:]]
    why = f" rather than {', '.join(map(repr, rivals[:4]))}: {_why(best, angles[1])}" if rivals else ""
    choice = Choice(
        source="angle",
        columns=(best.name,),
        unit=best.unit,
        sign=sign,
        doubt=best.doubt,
        std=_std_of(best, columns),
        notes=[f"roll from '{best.name}'{why}"],
    )
    if not axis and best.axis in ("y", "z"):
        choice.warnings.append(
            f"'{best.name}' is the only angle and taken as roll, though its name says otherwise"
        )
    return choice


def _why(best: Column, other: Column) -> str:
    if other.doubt > best.doubt:
        return f"'{other.name}' is not named as the plain measurement"
    if best.is_roll and not other.is_roll:
        return "its name says roll"
    if other.axis in ("y", "z") and best.axis not in ("y", "z"):
        return "the other turns about another axis"
    if best.unit == "rad" and other.unit != "rad":
        return "it is in rad, which needs no conversion"
    return "it has the plainest name"


def _std_of(column: Column, columns: Sequence[Column]) -> str | None:
    """Return the column of the same name and unit with 'std' in it."""
    for other in columns:
        same = (
            other.axis == column.axis
            and other.is_roll == column.is_roll
            and (other.unit or column.unit) == column.unit
        )
        if other.kind == "std" and same:
            return other.name
    return None


def _triple(columns: Sequence[Column], kind: Kind, axes: str) -> tuple[Column, ...] | None:
    """Return the columns x, y, z (or w, x, y, z) of one sensor: the least doubtful complete set."""
    groups: dict[tuple[int, str, str | None], dict[str, Column]] = {}
    for column in columns:
        if (
            column.kind == kind
            and column.axis
            and column.axis in axes
            and not (kind == "rate" and column.is_roll)
        ):
            groups.setdefault((column.doubt, column.group, column.unit), {}).setdefault(column.axis, column)
    complete = [(key, members) for key, members in groups.items() if len(members) == len(axes)]
    if not complete:
        return None
    # Every axis of ROS's linear_acceleration carries one doubtful word, because phones mean without gravity by it.
    _, members = min(complete, key=lambda item: (item[0][0], len(item[0][1])))
    return tuple(members[axis] for axis in axes)


def _imu(columns: Sequence[Column], axis: str, sign: float) -> Choice | None:
    gyro, accel = _triple(columns, "rate", "xyz"), _triple(columns, "accel", "xyz")
    if gyro is None or accel is None:
        return None
    return Choice(
        source="imu",
        columns=tuple(column.name for column in (*gyro, *accel)),
        unit=gyro[0].unit,
        accel_unit=accel[0].unit,
        doubt=gyro[0].doubt,
        axis=axis,
        sign=sign,
        notes=[
            f"roll from gyro '{gyro[0].name}'... and accelerometer '{accel[0].name}'..., smoothed together"
        ],
    )


def _gyro(columns: Sequence[Column], axis: str, sign: float) -> Choice | None:
    gyro = _triple(columns, "rate", "xyz")
    if gyro is not None:
        return Choice(
            source="gyro",
            columns=tuple(column.name for column in gyro),
            unit=gyro[0].unit,
            doubt=gyro[0].doubt,
            axis=axis,
            sign=sign,
            notes=[f"roll from gyro '{gyro[0].name}'..., integrated"],
        )
    rates = [c for c in columns if c.kind == "rate" and (not axis or (c.axis or "x") == axis)]
    if not rates:
        return None
    rates.sort(key=lambda c: (c.doubt, c.axis in ("y", "z"), not c.is_roll, c.unit is None))
    return Choice(
        source="gyro",
        columns=(rates[0].name,),
        unit=rates[0].unit,
        doubt=rates[0].doubt,
        sign=sign,
        notes=[f"roll from the rate '{rates[0].name}', integrated"],
    )


def _quaternion(columns: Sequence[Column], axis: str, sign: float) -> Choice | None:
    quaternion = _triple(columns, "quaternion", "wxyz")
    if quaternion is None:
        return None
    return Choice(
        source="quaternion",
        columns=tuple(column.name for column in quaternion),
        doubt=quaternion[0].doubt,
        axis=axis,
        sign=sign,
        notes=[f"roll from the orientation '{quaternion[0].name}'..., taken as sensor to earth"],
    )


def _with_unit(choice: Choice, options: "LogOptions") -> Choice:
    """Return the choice with the user's unit in place of the name's."""
    if options.unit is None:
        return choice
    table = ANGLE_UNITS if choice.source == "angle" else RATE_UNITS
    unit = parse_unit(options.unit)
    if unit in table and choice.source != "quaternion":
        return replace(choice, unit=unit)
    try:
        scale = float(options.unit)
    except ValueError:
        scale = 0.0
    if not 0 < abs(scale) < np.inf or choice.source == "quaternion":
        what = "an angle" if choice.source == "angle" else "a rotation rate"
        raise HuskyError(
            f"--unit '{options.unit}': not a unit of {what}. Known: {', '.join(table)}, or the size of one "
            f"count as a number (in {'rad' if choice.source == 'angle' else 'rad/s'})."
        )
    return replace(choice, scale=scale)


def angle_scale(angle: Array, choice: Choice, name: str) -> float:
    """Return radians per unit of the angle, adding to the choice's notes or warnings how that is known."""
    if choice.scale is not None:
        choice.notes.append(f"one count is {choice.scale:g} rad, as --unit says")
        return choice.scale
    if choice.unit is not None:
        return ANGLE_UNITS[choice.unit]
    reach = float(np.max(np.abs(angle - np.median(angle))))
    unit = "deg" if reach > np.pi else "rad"
    why = f"'{name}' names no unit; taken as {unit}, because it reaches {reach:.3g} from its median"
    if 0.9 < reach < 30:
        choice.warnings.append(f"{why}. That can be wrong: say it with --unit")
    else:
        choice.notes.append(why)
    return ANGLE_UNITS[unit]
