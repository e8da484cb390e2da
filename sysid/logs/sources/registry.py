"""Registry of sensor kinds from which roll can be made: one a file of this folder, discovered by its file.

Such a file ends in `SOURCE = Source(...)`. A source writes facts of its sensor (whether the zero is known, which
quantity was measured) into the `Roll`.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from sysid.errors import SysidError, did_you_mean
from sysid.logs import sources as package
from sysid.logs.table.choose import Choice, find_column, parse_axis, triple
from sysid.logs.table.clock import MIN_SAMPLES, time_scale, typical_step
from sysid.logs.table.file import LogFile
from sysid.logs.table.found import found_in
from sysid.logs.table.names import (
    ANGLE_UNITS,
    LENGTH_UNITS,
    MAX_RATE,
    RATE_UNITS,
    SPEED_UNITS,
    Column,
    parse_unit,
    unit_kind,
)
from sysid.logs.table.options import LogOptions
from sysid.logs.table.remarks import Remarks, note, warning
from sysid.logs.table.rows import LARGEST
from sysid.noise.sensor import estimate_noise
from sysid.roll import Array, Roll

MIN_MOTION_SHARE = 0.2
"""A column that turns less than this share of another is not the deck's [1]."""
DUPLICATE_CORRELATION = 0.9
"""Correlation [1] from which two columns are one motion: on both sides of a gear, or written twice."""
AVERAGED_ROWS = (1, 4, 16)
"""Rows that are averaged before two rates are compared: the slope of an angle is mostly noise from row to row."""
LENGTHS = {"angle": {unit: LENGTH_UNITS[unit] for unit in ("m", "cm", "mm")}, "rate": SPEED_UNITS}
"""Units of a slide, whose position in m is what an angle in rad is of a hinge. A length is taken where the user names it, or where the
log holds no angle: other columns of a log are lengths too."""
_UNITS = {
    "angle": ("an angle", "rad", {**ANGLE_UNITS, **LENGTHS["angle"]}),
    "rate": ("a rotation rate", "rad/s", {**RATE_UNITS, **SPEED_UNITS}),
}


@dataclass(frozen=True, slots=True)
class Reading:
    """The chosen columns of one log, on a clock that is in order."""

    log: str
    choice: Choice
    time: Array
    """Time [s], shape (n,), strictly increasing."""
    signals: tuple[Array, ...]
    """The chosen columns in the log's units, shape (n,) each."""
    std: Array | None
    """The column of their standard deviation, shape (n,), where there is one."""
    options: LogOptions

    @property
    def counted(self) -> slice:
        """The rows between `LogOptions.start` and `.stop`; all where too few lie there."""
        low = 0 if self.options.start is None else int(np.searchsorted(self.time, self.options.start))
        stop = self.options.stop
        high = None if stop is None else int(np.searchsorted(self.time, stop, "right"))
        return slice(low, high) if self.time[low:high].size >= MIN_SAMPLES else slice(None)

    def as_roll(self, roll: Array, std: Array, origin: str, remarks: Remarks, **more: Any) -> Roll:
        """Return roll and its standard deviation [rad], shape (n,) each, with remarks."""
        return Roll(
            log=self.log, time=self.time, roll=roll, std=std, origin=origin, notes=remarks.notes,
            warnings=remarks.warnings, **more,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """One kind of sensor."""

    name: str
    """As `--source` takes it."""
    order: int
    """The lowest is taken if the columns' names leave it open."""
    quantity: Literal["angle", "rate"] | None
    """Quantity of `--unit`; None for columns without unit."""
    find: Callable[[Sequence[Column], str, float], Sequence[Choice]]
    """Its columns among some, about an axis ('' for any) with a sign: the best by their names first, none where none are
    there."""
    to_roll: Callable[[Reading], Roll]
    """Roll from its columns, with notes and warnings of its own."""
    moving: int = 0
    """Number of its columns, from the first on, that move smoothly, so that a lone sample far from its neighbours is
    an outlier. Accelerations are knocked, and a quaternion's sign is free."""
    unwrap: Callable[[Choice, Array], tuple[Choice, Array]] | None = None
    """Its one column, shape (n,), without jumps by a whole turn, and what these tell of it; None where it does not begin again."""
    compared: bool = False
    """Whether its columns alone tell how fast it turns. Of several that turn differently, the one that moves is the deck's."""
    from_column: Callable[[Column, Sequence[Column], float], Choice] | None = None
    """One column that the user names, beside the others and with a sign; None where one is not enough."""


def known_scale(choice: Choice, quantity: Literal["angle", "rate"]) -> tuple[float, Remarks] | None:
    """Return SI units per unit of a column, and how that is known; None where neither its name nor the user says it."""
    name, (_, si, table) = choice.columns[0], _UNITS[quantity]
    if choice.scale is not None:
        return choice.scale, note("unit", f"one count is {choice.scale:g} {si}, as --unit says")
    if choice.unit in LENGTHS[quantity]:
        what = "position" if quantity == "angle" else "speed"
        return table[choice.unit], note("unit", f"'{name}' is the {what} of a slide in {choice.unit}")
    return None if choice.unit is None else (table[choice.unit], Remarks())


@cache
def sources() -> Mapping[str, Source]:
    """Return every kind of sensor by name, in their order."""
    return MappingProxyType({source.name: source for source in found_in(package, Source)})


def choose_source(
    log: LogFile, columns: Sequence[Column], time: Column | None, options: LogOptions
) -> tuple[Source, Choice]:
    """Choose what to make roll from.

    Names decide; but of two that turn differently the one that moves wins, whatever it is called.

    Raises:
        SysidError: A named column, source or unit does not exist, or the log holds nothing of the kind.
    """
    axis, sign = parse_axis(options.axis) if options.axis else ("", 1.0)
    if options.source not in ("auto", *sources()):
        raise SysidError(
            f"--source '{options.source}': there is no such source.{did_you_mean(options.source, sources())} "
            f"Known: auto, {', '.join(sources())}."
        )
    if options.column is not None:
        column = find_column(log, options.column, columns, "--column")
        source, choice = _named(log, column, columns, sign, options)
        return source, _with_unit(source, choice, options)
    wanted = sources().values() if options.source == "auto" else [sources()[options.source]]
    found = [(s, choice) for s in wanted for choice in s.find(columns, axis, sign)]
    if not found and options.source == "auto" and (only := _only_motion(log, columns, options)):
        source, choice = choose_source(log, columns, time, replace(options, column=only.name))
        doubt = f"no name says angle or rate; '{only.name}' is the only column that moves and taken as roll"
        return source, choice if only.kind in ("length", "speed") else choice.with_remarks(warning(doubt))
    if not found:
        what = "roll, angle or rotation rate" if options.source == "auto" else options.source
        raise SysidError(
            f"{log.path}: no column of {what} among {', '.join(map(repr, log.names[:30]))}"
            + (f" about axis '{options.axis}'" if options.axis else "")
            + ". Name one with --column, and its unit with --unit."
        )
    doubt = min(choice.doubt for _, choice in found)
    source, choice = _that_moves(log, [pair for pair in found if pair[1].doubt == doubt], time, options)
    others = ", ".join(dict.fromkeys(other.name for other, _ in found if other is not source))
    if others:
        choice = choice.with_remarks(note("others", f"the log also holds {others}: choose with --source"))
    return source, _with_unit(source, choice, options)


def _only_motion(log: LogFile, columns: Sequence[Column], options: LogOptions) -> Column | None:
    """Return the only length, or else the only column without a known name, that moves; None where several do.

    Columns that differ by a number alone count as one; bare x, y and z may be of any sensor.
    """
    if triple(columns, "unknown", "xyz"):
        return None
    for kinds in (("length", "speed"), ("unknown",)):
        moving: list[Column] = []
        for column in columns:
            if column.kind in kinds:
                with suppress(SysidError):  # words
                    values = log.read([column.name])[column.name]
                    values = values[np.isfinite(values)]
                    noise = estimate_noise(values).std if values.size > MIN_SAMPLES else np.inf
                    if np.unique(values).size > MIN_SAMPLES and noise < MIN_MOTION_SHARE * values.std():
                        moving.append(column)
        if (
            len({re.sub(r"\d", "", column.name) for column in moving}) == 1
        ):  # of x1 and x2, the one that moves more
            return max(moving, key=lambda column: float(np.nanstd(log.read([column.name])[column.name])))
    return None


def _that_moves(
    log: LogFile, found: Sequence[tuple[Source, Choice]], time: Column | None, options: LogOptions
) -> tuple[Source, Choice]:
    """Return the first of some, or another motion that turns more, where it is as good by its name or the first hardly moves."""
    rivals = [pair for pair in found if pair[0].compared]
    rates = _rates(log, rivals, time, options) if found[0] in rivals and len(rivals) > 1 else []
    if not rates:
        return found[0]
    smooth = [[np.convolve(rate, np.ones(rows) / rows, "valid") for rate in rates] for rows in AVERAGED_ROWS]
    sizes = np.array([[max(float(np.std(rate)), 1e-300) for rate in some] for some in smooth])
    times = np.median(sizes / sizes[:, :1], axis=0)
    alike = np.array([max(_likeness(some[0], some[k]) for some in smooth) for k in range(len(rivals))])
    named = [choice.columns[0] for _, choice in rivals]
    equal = np.array([name in found[0][1].rivals for name in named])
    other = alike <= DUPLICATE_CORRELATION
    if np.any(other & (times * MIN_MOTION_SHARE > 1)):
        best = int(np.argmax(other * times))
        taken = ", ".join(map(repr, rivals[best][1].columns))
        why = f"'{named[0]}' hardly moves while {taken} does: roll is made from the motion. --column '{named[0]}' takes the other"
    elif np.any(other & equal & (times > 1)):
        best = int(np.argmax(other * equal * times))
        why = f"roll is made from '{named[best]}', which turns {times[best]:.2g} times as much as '{named[0]}': --column '{named[0]}' takes that"
    else:
        # One motion written twice, in one unit or in two, is no rival; one on the other side of a gear is.
        degree = ANGLE_UNITS["deg"]
        as_far = np.min([np.abs(times * unit - 1) for unit in (1.0, degree, 1 / degree)], axis=0)
        copy = ~other & (as_far < 1 - DUPLICATE_CORRELATION)
        rival = equal & ~copy & (times > MIN_MOTION_SHARE)
        if not rival.any():
            return found[0]
        k, best = int(np.argmax(rival * times)), 0
        why = (
            f"roll is made from '{named[0]}', but '{named[k]}' is as good by its name and turns {times[k]:.2g} times as much: "
            f"--column '{named[k]}' takes that"
        )
    source, choice = rivals[best]
    return source, choice.with_remarks(warning(why))


def _rates(
    log: LogFile, rivals: Sequence[tuple[Source, Choice]], time: Column | None, options: LogOptions
) -> list[Array]:
    """Return how fast each rival turns [rad/s], shape (n,); nothing where they share too few rows."""
    names = dict.fromkeys(name for _, choice in rivals for name in choice.columns)
    data = log.read([*names, *([time.name] if time else [])])
    sound = np.logical_and.reduce([np.abs(column) < LARGEST for column in data.values()])
    if np.count_nonzero(sound) < MIN_SAMPLES:
        return []
    period = 1 / (options.rate or 1.0)
    if time is not None:
        stamps = data[time.name][sound]
        period = max(typical_step(stamps) * time_scale(stamps, time.unit)[0], 1e-9)
    return [
        _turning(source, choice, np.stack([data[name][sound] for name in choice.columns], axis=1), period)
        for source, choice in rivals
    ]


def _turning(source: Source, choice: Choice, columns: Array, period: float) -> Array:
    """Return how fast columns, shape (n, m), turn about the axis of most motion [rad/s], shape (n,); in doubt angles are in degrees."""
    known = known_scale(choice, source.quantity) if source.quantity else (1.0, Remarks())
    degrees = source.quantity == "angle" or np.abs(columns).max() > MAX_RATE
    columns = columns - np.median(columns, axis=0)
    rate = columns @ np.linalg.eigh(columns.T @ columns)[1][:, -1]
    rate = rate if source.quantity == "rate" else np.gradient(rate) / period
    largest = float(np.percentile(np.abs(rate), 99.9))  # where an angle wraps it does not turn
    return (known[0] if known else ANGLE_UNITS["deg"] if degrees else 1.0) * np.clip(rate, -largest, largest)


def _likeness(one: Array, other: Array) -> float:
    """Return the largest correlation of two rates at any shift of up to a twentieth of the record."""
    from scipy.signal import correlate

    one, other = (np.asarray((rate - rate.mean()) / max(float(rate.std()), 1e-300)) for rate in (one, other))
    near = slice(one.size - 1 - one.size // 20, one.size + one.size // 20)
    return float(np.abs(correlate(one, other)[near]).max()) / one.size


def _named(
    log: LogFile, column: Column, columns: Sequence[Column], sign: float, options: LogOptions
) -> tuple[Source, Choice]:
    """Return the source that one column makes: the user's, else the one of its quantity, else the first."""
    kind = unit_kind(parse_unit(options.unit)) if options.unit else "unknown"
    kind = column.kind if kind == "unknown" else kind
    kind = {"length": "angle", "speed": "rate"}.get(kind, kind)
    single = [source for source in sources().values() if source.from_column is not None]
    chosen = [
        *(source for source in single if source.name == options.source),
        *(source for source in single if source.quantity == kind),
    ]
    if kind == "accel" and not chosen:
        raise SysidError(
            f"{log.path}: '{column.name}' is an acceleration; roll needs an angle, a rotation rate, or all three "
            "axes of accelerometer and gyro (leave --column out)."
        )
    source = (chosen or single)[0]
    assert source.from_column is not None
    return source, source.from_column(column, columns, sign)


def _with_unit(source: Source, choice: Choice, options: LogOptions) -> Choice:
    """Return the choice with the user's unit in place of the name's."""
    if options.unit is None:
        return choice
    if source.quantity is None:
        raise SysidError(
            f"--unit '{options.unit}': roll is made from {', '.join(map(repr, choice.columns))}, which has no unit. "
            "Leave it out, or name another column with --column."
        )
    what, si, table = _UNITS[source.quantity]
    unit = parse_unit(options.unit)
    if unit in table:
        return replace(choice, unit=unit)
    try:
        scale = float(options.unit)
    except ValueError:
        scale = 0.0
    if not 0 < abs(scale) < np.inf:
        raise SysidError(
            f"--unit '{options.unit}': not a unit of {what}. Known: {', '.join(table)}, or the size of one "
            f"count as a number (in {si})."
        )
    return replace(choice, scale=scale)
