"""Parquet tables, and data sets of LeRobot made of them."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import SysidError, needs_extra
from sysid.logs.formats.registry import Format, refuse_larger, undamaged
from sysid.logs.formats.tables import MAX_ELEMENTS
from sysid.logs.table.file import LogFile
from sysid.roll import Array

INFO = "meta/info.json"
"""File of a LeRobot data set with the names of its lists' elements."""


def open_parquet(path: Path) -> LogFile:
    """Open a Parquet file, or the folder of a LeRobot data set, by its schema; time stamps are seconds.

    A list column becomes a column an element, with the names of the data set's `info.json`.

    Raises:
        SysidError: The reader is not installed, or a file is damaged or too large.
    """
    with needs_extra("parquet", f"{path}: reading Parquet"):
        import pyarrow as pa
        import pyarrow.parquet as pq

    parts = sorted(path.glob("data/**/*.parquet")) if path.is_dir() else [path]
    with undamaged(path, "Parquet file"):
        refuse_larger(path, sum(_size(pq.read_metadata(part)) for part in parts))
        schema = pq.read_schema(parts[0])
        known = _element_names(path)
        columns: dict[str, tuple[str, int | None]] = {}
        for name, kind in zip(schema.names, schema.types, strict=True):
            if pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
                first = pq.ParquetFile(parts[0]).read_row_group(0, columns=[name]).column(0)[0].as_py() or []
                names = known.get(name, [])
                if len(first) <= MAX_ELEMENTS and not isinstance(next(iter(first), None), list):
                    said = names if len(names) == len(first) else [str(n) for n in range(len(first))]
                    columns |= {f"{name}.{label}": (name, n) for n, label in enumerate(said)}
            else:
                columns[name] = name, None

    def read(names: Sequence[str]) -> dict[str, Array]:
        wanted = list(dict.fromkeys(columns[name][0] for name in names))
        with undamaged(path, "Parquet file"):
            table = pa.concat_tables([pq.read_table(part, columns=wanted) for part in parts])
            return {
                name: _numbers(path, name, table.column(columns[name][0]), columns[name][1]) for name in names
            }

    clocks = {name: "s" for name, kind in zip(schema.names, schema.types, strict=True) if _is_time(kind)}
    note = "table: Parquet" + (f", {len(parts)} files of a LeRobot data set" if path.is_dir() else "")
    return LogFile(path=path, names=tuple(columns), units=clocks, notes=(note,), read=read)


def _size(metadata: Any) -> float:
    """Return the bytes of a file as numbers: packed, a billion equal rows take a few."""
    stored = sum(metadata.row_group(n).total_byte_size for n in range(metadata.num_row_groups))
    return max(stored, 8 * metadata.num_rows)


def _element_names(path: Path) -> Mapping[str, Sequence[str]]:
    """Return the names of the elements of list columns, where a data set's `info.json` is above the file."""
    for folder in (path, *path.resolve().parents[:4]):
        with suppress(OSError, ValueError, AttributeError, RecursionError):
            features = json.loads((folder / INFO).read_text(encoding="utf-8"))["features"]
            return {key: list(_leaves(value.get("names"))) for key, value in features.items()}
    return {}


def _leaves(value: Any) -> Iterator[str]:
    """Yield the texts of nested lists and dictionaries; {"motors": [...]} is a list of motors."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict) and all(isinstance(item, int) for item in value.values()):
        yield from sorted(value, key=lambda key: value[key])
    elif isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from _leaves(item)


def _is_time(kind: Any) -> bool:
    import pyarrow as pa

    return pa.types.is_timestamp(kind) or pa.types.is_duration(kind)


def _numbers(path: Path, name: str, column: Any, element: int | None) -> Array:
    import pyarrow as pa
    from pyarrow import compute

    if element is not None:
        column = compute.call_function("list_element", [column, pa.scalar(element)])
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


FORMAT = Format(
    name="Parquet", order=1, open=open_parquet,
    sniff=lambda path, head: head.startswith(b"PAR1") or (path / INFO).is_file(),
)  # fmt: skip
