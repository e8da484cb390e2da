"""Parquet tables."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats.registry import Format, starts_with
from sysid.roll import Array


@dataclass(frozen=True, slots=True)
class ParquetTable:
    """A Parquet file; only the columns that are asked for are read."""

    path: Path
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    """Seconds for time stamps; None for numbers."""
    notes: tuple[str, ...] = ("Parquet table",)
    has_header: bool = True

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Return whole columns, shape (n,) each, in the log's units; missing values as NaN, time stamps as seconds.

        Raises:
            SysidError: A column holds something else than numbers, or the file is damaged.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            table = pq.read_table(self.path, columns=list(names))
        except (pa.ArrowException, OSError) as error:
            raise SysidError(f"{self.path}: damaged Parquet file ({_first_line(error)}).") from error
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
            raise SysidError(
                f"{self.path}: column '{name}' holds {column.type}, not numbers. Name another with --column."
            ) from error


def open_parquet(path: Path) -> ParquetTable:
    """Open a Parquet file by its schema.

    Raises:
        SysidError: It is damaged.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise SysidError(
            f"{path}: reading Parquet needs an extra: pip install 'husky-sysid[parquet]' (missing: {error.name})."
        ) from error
    try:
        schema = pq.read_schema(path)
    except (pa.ArrowException, OSError) as error:
        raise SysidError(f"{path}: not a readable Parquet file ({_first_line(error)}).") from error
    clocks = [pa.types.is_timestamp(kind) or pa.types.is_duration(kind) for kind in schema.types]
    return ParquetTable(path, tuple(schema.names), tuple("s" if clock else None for clock in clocks))


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]


FORMAT = Format(name="Parquet", order=1, sniff=starts_with(b"PAR1"), open=open_parquet)
