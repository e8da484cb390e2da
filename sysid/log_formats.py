"""File formats: each becomes a `LogFile`, named columns of numbers that are read when asked for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from sysid.errors import HuskyError
from sysid.log_csv import open_csv
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
        """What was inferred about the format."""
        ...

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Return whole columns of float64; missing values are NaN."""
        ...


@dataclass(frozen=True, slots=True)
class LoadedTable:
    """A table that is already in memory."""

    path: Path
    columns: Mapping[str, Array]
    notes: tuple[str, ...] = ()
    has_header: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.columns)

    @property
    def units(self) -> tuple[str | None, ...]:
        """No units apart from the names."""
        return (None,) * len(self.columns)

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Return whole columns."""
        return {name: np.asarray(self.columns[name], dtype=np.float64) for name in names}


@dataclass(frozen=True, slots=True)
class ParquetTable:
    """A Parquet file; only the columns that are asked for are read."""

    path: Path
    names: tuple[str, ...]
    notes: tuple[str, ...] = ("Parquet table",)
    has_header: bool = True

    @property
    def units(self) -> tuple[str | None, ...]:
        """No units apart from the names."""
        return (None,) * len(self.names)

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Return whole columns, missing values as NaN, time stamps as seconds.

        Raises:
            HuskyError: A column holds something else than numbers, or the file is damaged.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            table = pq.read_table(self.path, columns=list(names))
        except (pa.ArrowException, OSError) as error:
            raise HuskyError(f"{self.path}: damaged Parquet file ({_first_line(error)}).") from error
        return {name: self._numbers(name, table.column(name)) for name in names}

    def _numbers(self, name: str, column: Any) -> Array:
        import pyarrow as pa

        if pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type):
            ticks = column.cast(pa.int64())
            size = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[column.type.unit]
            return (ticks.to_numpy() - ticks[0].as_py()) * size
        try:
            return column.cast(pa.float64()).to_numpy().astype(np.float64, copy=False)
        except pa.ArrowException as error:
            raise HuskyError(
                f"{self.path}: column '{name}' holds {column.type}, not numbers. Name another with --column."
            ) from error


def _open_parquet(path: Path) -> ParquetTable:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        schema = pq.read_schema(path)
    except (pa.ArrowException, OSError) as error:
        raise HuskyError(f"{path}: not a readable Parquet file ({_first_line(error)}).") from error
    return ParquetTable(path, tuple(schema.names))


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]


def open_log(path: Path) -> LogFile:
    """Open a log by its ending and first bytes.

    Raises:
        HuskyError: The file cannot be opened or is of no known format.
    """
    try:
        with path.open("rb") as file:
            magic = file.read(16)
    except IsADirectoryError:
        from sysid.log_phone import open_folder

        return open_folder(path)
    except OSError as error:
        raise HuskyError(f"{path}: cannot be opened ({error.strerror}).") from error
    if magic.startswith(b"PAR1") or path.suffix.lower() in (".parquet", ".pq"):
        return _open_parquet(path)
    return open_csv(path)
