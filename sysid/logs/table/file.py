"""A log as its format gives it: named columns of numbers, read when asked for."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from sysid.roll import Array


class LogFile(Protocol):
    """A table in a file."""

    @property
    def path(self) -> Path:
        """The file."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        ...

    @property
    def units(self) -> tuple[str | None, ...]:
        """Units of the columns where the file says them apart from the names."""
        ...

    @property
    def has_header(self) -> bool:
        """Whether the names are the file's own."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What was inferred about the format, as 'table: separated by commas'."""
        ...

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Return whole columns of float64, shape (n,) each, in the log's units; missing values are NaN."""
        ...
