"""A log as its format gives it: named columns of numbers, read when asked for."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sysid.roll import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFile:
    """A table in a file."""

    path: Path
    names: tuple[str, ...]
    """Of the columns."""
    units: Mapping[str, str] = field(default_factory=dict[str, str])
    """Units of the columns of which the file says them apart from the names."""
    notes: tuple[str, ...]
    """Inferences about the format, as 'table: separated by commas'."""
    read: Callable[[Sequence[str]], dict[str, Array]]
    """Returns whole columns of float64, shape (n,) each, in the log's units; missing values are NaN."""


def held(
    path: Path,
    columns: Mapping[str, Array],
    notes: tuple[str, ...] = (),
    units: Mapping[str, str] | None = None,
) -> LogFile:
    """Return columns in memory, shape (n,) each in the log's units, as a table."""

    def read(names: Sequence[str]) -> dict[str, Array]:
        return {name: columns[name].copy() for name in names}

    known = {name: unit for name, unit in (units or {}).items() if name in columns}
    return LogFile(path=path, names=tuple(columns), units=known, notes=notes, read=read)
