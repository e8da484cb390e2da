"""A clock that a table writes in two columns: whole seconds, and the rest of each."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.logs.table.file import LogFile
from sysid.logs.table.names import TIME_UNITS, Column, parse_column, stem_of_clock
from sysid.roll import Array


def with_whole_clock(log: LogFile) -> LogFile:
    """Return a log in which one column [s] stands for whole seconds and the fraction beside them; the log itself where it has none."""
    columns = [parse_column(name, log.units.get(name)) for name in log.names]
    pair = _pair(columns)
    if pair is None:
        return log
    whole, part = pair
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


def _pair(columns: Sequence[Column]) -> tuple[Column, Column] | None:
    """Return the columns of whole seconds and of the rest of each, by their names."""
    times = [column for column in columns if column.kind == "time"]
    whole = [column for column in times if column.unit == "s"]
    parts = [column for column in times if column.unit in ("ms", "us", "ns")]
    pairs = ((one, other) for one in whole for other in parts if stem_of_clock(one) == stem_of_clock(other))
    return next(pairs, None)
