"""Parquet tables."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import SysidError, needs_extra
from sysid.logs.formats.registry import Format, starts_with, undamaged
from sysid.logs.table.file import LogFile
from sysid.roll import Array


def open_parquet(path: Path) -> LogFile:
    """Open a Parquet file by its schema; time stamps are seconds.

    Raises:
        SysidError: The reader is not installed, or the file is damaged.
    """
    with needs_extra("parquet", f"{path}: reading Parquet"):
        import pyarrow.parquet as pq

    with undamaged(path, "Parquet file"):
        schema = pq.read_schema(path)

    def read(names: Sequence[str]) -> dict[str, Array]:
        with undamaged(path, "Parquet file"):
            table = pq.read_table(path, columns=list(names))
        return {name: _numbers(path, name, table.column(name)) for name in names}

    clocks = {name: "s" for name, kind in zip(schema.names, schema.types, strict=True) if _is_time(kind)}
    return LogFile(path=path, names=tuple(schema.names), units=clocks, notes=("table: Parquet",), read=read)


def _is_time(kind: Any) -> bool:
    import pyarrow as pa

    return pa.types.is_timestamp(kind) or pa.types.is_duration(kind)


def _numbers(path: Path, name: str, column: Any) -> Array:
    import pyarrow as pa

    if _is_time(column.type):
        ticks = column.cast(pa.int64())
        size = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[column.type.unit]
        return (ticks.to_numpy() - ticks[0].as_py()) * size
    try:
        return column.cast(pa.float64()).to_numpy().astype(np.float64, copy=False)
    except pa.ArrowException as error:
        raise SysidError(
            f"{path}: column '{name}' holds {column.type}, not numbers. Name another with --column."
        ) from error


FORMAT = Format(name="Parquet", order=1, sniff=starts_with(b"PAR1"), open=open_parquet)
