"""Clocks that a table writes in ways of its own: in two columns, or one before each signal."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.logs.formats.tables import sensor_tables
from sysid.logs.table.clock import MIN_SAMPLES, rises, time_scale
from sysid.logs.table.content import numbers_of
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import TIME_UNITS, parse_column, stem_of_clock
from sysid.roll import Array


def with_own_clocks(log: LogFile) -> LogFile:
    """Return a table of t1, x1, t2, x2, ... as sensors with clocks of their own; other logs as they are."""
    columns = [parse_column(name, log.units.get(name)) for name in log.names]
    starts = [
        n for n, c in enumerate(columns) if c.kind == "time" or re.fullmatch(r"t\W?\d+", c.name.lower())
    ]
    widths = np.diff([*starts, len(columns)])
    if len(starts) < 2 or starts[0] != 0 or widths.min() < 2 or widths.max() > widths.min():
        return log
    data = numbers_of(log)
    clocks: dict[str, Array] = {}
    sensors: dict[str, tuple[str, Array]] = {}
    for begin, width in zip(starts, widths, strict=True):
        clock, *values = columns[begin : begin + width]
        if clock.name not in data:
            return log
        rows = np.isfinite(data[clock.name])
        times = data[clock.name][rows]
        if times.size < MIN_SAMPLES or not rises(times):
            return log
        clocks[clock.name] = times * time_scale(times, clock.unit)[0]
        sensors |= {
            column.name: (clock.name, data[column.name][rows]) for column in values if column.name in data
        }
    return sensor_tables(
        log.path, clocks, sensors, f"table: each of {', '.join(sensors)} with a clock of its own"
    )


def with_whole_clock(log: LogFile) -> LogFile:
    """Return a log in which one column [s] stands for whole seconds and the fraction beside them; the log itself where it has none."""
    times = [c for c in (parse_column(name, log.units.get(name)) for name in log.names) if c.kind == "time"]
    pairs = (
        (whole, part)
        for whole in times
        for part in times
        if whole.unit == "s"
        and part.unit in ("ms", "us", "ns")
        and stem_of_clock(whole) == stem_of_clock(part)
    )
    whole, part = next(pairs, (None, None))
    if whole is None or part is None:
        return log
    values = log.read([whole.name, part.name])
    seconds, fraction = values[whole.name], values[part.name] * TIME_UNITS[part.unit or "s"]
    if (
        np.nanmin(fraction) < 0
        or np.nanmax(fraction) >= 1
        or not np.all((seconds == np.rint(seconds)) | np.isnan(seconds))
    ):
        return log
    joined = f"{whole.name} + {part.name}"

    def read(names: Sequence[str]) -> dict[str, Array]:
        own = [name for name in names if name != joined]
        data = log.read(own) if own else {}
        return {name: seconds + fraction if name == joined else data[name] for name in names}

    names = tuple(
        joined if name == whole.name else name for name in log.names
    )  # users count them in the file
    return replace(log, names=names, units={**log.units, joined: "s"}, read=read)
