"""Parquet tables, and data sets of LeRobot made of them."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import needs_extra
from sysid.logs.formats.registry import Format, refuse_larger, undamaged
from sysid.logs.formats.tables import MAX_ELEMENTS
from sysid.logs.table.file import LogFile, held
from sysid.logs.table.frame import columns_of_frame

INFO = "meta/info.json"
"""File of a LeRobot data set with the names of its lists' elements."""


def open_parquet(path: Path) -> LogFile:
    """Open a Parquet file, or the folder of a LeRobot data set; time stamps are seconds since the first.

    A list column becomes a column an element, with the names of the data set's `info.json`.

    Raises:
        SysidError: The reader is not installed, or a file is damaged, too large or without numbers.
    """
    with needs_extra("parquet", f"{path}: reading Parquet"):
        import pyarrow.parquet as pq

    parts = sorted(path.glob("data/**/*.parquet")) if path.is_dir() else [path]
    with undamaged(path, "Parquet file"):
        import pandas as pd

        refuse_larger(path, sum(_size(pq.read_metadata(part)) for part in parts))
        frame = pd.concat([pq.read_table(part).to_pandas() for part in parts], ignore_index=len(parts) > 1)
        columns, units = columns_of_frame(_unfolded(frame, _element_names(path)))
    note = "table: Parquet" + (f", {len(parts)} files of a LeRobot data set" if path.is_dir() else "")
    return held(path, columns, (note,), units)


def _size(metadata: Any) -> float:
    """Return the bytes of a file as numbers: packed, a billion equal rows take a few."""
    stored = sum(metadata.row_group(n).total_byte_size for n in range(metadata.num_row_groups))
    return max(stored, 8 * metadata.num_rows)


def _unfolded(frame: Any, known: Mapping[str, Sequence[str]]) -> Any:
    """Return a data frame in which each column of lists of numbers is a column an element."""
    for name in frame.columns:
        first = frame[name].iloc[0] if len(frame) else None
        if isinstance(first, np.ndarray) and first.ndim == 1 and len(first) <= MAX_ELEMENTS:
            names = known.get(name, [])
            said = names if len(names) == len(first) else range(len(first))
            values = np.stack(list(frame.pop(name))).astype(np.float64)
            frame = frame.assign(**{f"{name}.{label}": values[:, n] for n, label in enumerate(said)})
    return frame


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


FORMAT = Format(
    name="Parquet", order=1, open=open_parquet,
    sniff=lambda path, head: head.startswith(b"PAR1") or (path / INFO).is_file(),
)  # fmt: skip
