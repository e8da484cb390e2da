"""Reads any log or film into one `Roll`.

Inferences (column, unit, axis, clock) go into `Roll.notes`, faults of the log into `Roll.warnings`. `LogOptions`
override every inference.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats.own_clock import with_own_clocks, with_whole_clock
from sysid.logs.formats.registry import open_log
from sysid.logs.gates import refuse_with_numbers
from sysid.logs.sources.registry import Reading, choose_source
from sysid.logs.table.choose import Choice, columns_of, find_column
from sysid.logs.table.clock import MIN_SAMPLES, Clock, even_clock, repair_clock, usual_step
from sysid.logs.table.file import LogFile
from sysid.logs.table.free import free_rows, telling_column
from sysid.logs.table.names import Column
from sysid.logs.table.options import LogOptions
from sysid.logs.table.remarks import Remarks
from sysid.logs.table.rows import measured_motion, measured_rows, on_common_rows
from sysid.roll import Array, Roll
from sysid.video.options import VideoOptions, is_film

RATES = 1e-3, 1e8
"""Sampling rates that something records with [Hz]."""


def read_roll(path: Path, options: LogOptions | None = None) -> Roll:
    """Read any log or film as roll against time.

    Raises:
        SysidError: The file cannot be read, holds no roll, or holds too little to be a measurement.
    """
    options = options or LogOptions()
    if options.rate is not None and not RATES[0] <= options.rate <= RATES[1]:
        raise SysidError(f"--rate {options.rate:g}: expected hertz from {RATES[0]:g} to {RATES[1]:g}.")
    if not path.exists():
        raise SysidError(f"{path}: there is no such file.")
    if not (path.is_file() or path.is_dir()):
        raise SysidError(
            f"{path}: is a pipe or a device, and a log is read more than once. Write it into a file first."
        )
    if is_film(path):
        from sysid.video_roll import roll_from_video

        return roll_from_video(path, replace(options.video or VideoOptions(), rate=options.rate))
    return roll_of_table(open_log(path), options)


def roll_of_table(table: LogFile, options: LogOptions) -> Roll:
    """Turn named columns, of a file or in memory, into roll against time.

    Raises:
        SysidError: They hold no roll, or too little to be a measurement.
    """
    path, log = table.path, with_own_clocks(with_whole_clock(table))
    if options.column is None:
        refuse_with_numbers(log)
    time, columns = columns_of(log, options)
    source, choice = choose_source(log, columns, time, options)
    also = [find_column(log, name, columns, "--input").name for name in options.also]
    tells = telling_column(columns, choice.columns[0])
    says = () if tells is None else (tells[1],)
    names = [name for name in (*choice.columns, time and time.name, choice.std, *also, *says) if name]
    data = log.read(list(dict.fromkeys(names)))
    try:
        clock, cleaned = _clean(choice, time, data, options)
        if source.unwrap is not None:
            first = choice.columns[0]
            choice, clock.columns[first] = source.unwrap(choice, clock.columns[first])
        if not options.keep_outliers:
            motion = {name: clock.columns[name] for name in choice.columns[: source.moving]}
            kept, outliers = measured_motion(motion, clock.time, choice.unit, rates=source.quantity == "rate")
            cleaned += outliers
            if kept is not None:
                clock.select(kept)
        data = clock.columns
        signals, std = tuple(data[name] for name in choice.columns), data[choice.std] if choice.std else None
        roll = _checked(source.to_roll(Reading(str(path), choice, clock.time, signals, std, options)))
    except SysidError as error:
        raise SysidError(f"{path}: {error}") from None
    kept = np.searchsorted(clock.time, roll.time)  # a source may leave out samples
    extra = {name: data[name][kept] for name in also}
    free = None
    if tells is not None:
        free, said = free_rows(*tells, data[tells[1]][kept], roll.time, data[choice.columns[0]][kept])
        cleaned += said
    rate = 1 / usual_step(roll.time)
    sampling = f"samples: {roll.time.size} in {roll.time[-1] - roll.time[0]:.4g} s at {rate:.4g} Hz"
    return replace(
        roll,
        extra=extra,
        free=free,
        notes=(*log.notes, *choice.remarks.notes, *cleaned.notes, *roll.notes, *clock.notes, sampling),
        warnings=(*clock.warnings, *cleaned.warnings, *choice.remarks.warnings, *roll.warnings),
    )


def _clean(
    choice: Choice, time: Column | None, data: dict[str, Array], options: LogOptions
) -> tuple[Clock, Remarks]:
    """Drop rows without numbers and repair the clock."""
    stamps = data.pop(time.name) if time else None
    measured = [name for name in (*choice.columns, choice.std) if name]
    common, joined = on_common_rows({name: data[name] for name in measured}, stamps)
    data |= common
    signals = {name: data[name] for name in choice.columns}
    rows = signals[choice.columns[0]].size
    kept, dropped = measured_rows(signals, stamps)
    count = rows if kept is None else kept.size
    if stamps is not None and time is not None and not np.isfinite(stamps).any():
        raise SysidError(
            f"the column of time '{time.name}' is empty. Name another with --time-column, or give --rate."
        )
    if count < MIN_SAMPLES:
        raise SysidError(
            f"{count} of {rows} rows hold numbers in {', '.join(map(repr, choice.columns))}; "
            f"at least {MIN_SAMPLES} are needed. Is it the right file and column?"
        )
    if kept is not None:
        data = {name: column[kept] for name, column in data.items()}
        stamps = stamps if stamps is None else stamps[kept]
    lively = max(choice.columns, key=lambda name: float(np.std(data[name][:200_000])))
    if data[lively].min() == data[lively].max():
        raise SysidError(
            f"{', '.join(map(repr, choice.columns))} never changes (always {data[lively][0]:g}): the sensor was dead, "
            "or it is the wrong column. Name another with --column."
        )
    if stamps is None or time is None:
        clock = even_clock(np.arange(rows) if kept is None else kept, options.rate or 1.0, data)
    else:
        clock = repair_clock(stamps, data, lively, time.unit, time.name, computed=choice.std is not None)
    return clock, joined + dropped


def _checked(roll: Roll) -> Roll:
    """Return a roll that computing with is safe for, with no standard deviation below rounding.

    Raises:
        SysidError: It does not move, or overflowed.
    """
    reach = float(np.ptp(roll.roll))
    if not np.isfinite(reach) or not np.diff(roll.time).min() > 0:
        raise SysidError(
            "its numbers are too large or too close to compute with. Is the unit right? See --unit, --rate."
        )
    if reach == 0:
        raise SysidError("roll never changes about this axis. Choose another with --axis or --column.")
    smallest = 1e-9 * reach
    return roll if roll.std.min() >= smallest else replace(roll, std=np.maximum(roll.std, smallest))
