"""File formats: each becomes a `LogFile`, named columns of numbers that are read when asked for."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from sysid.errors import HuskyError
from sysid.logs.formats.csv import open_csv
from sysid.roll import Array

_KNOWN_ELSEWHERE = {
    b"SQLite format 3": "a ROS 2 recording in SQLite. Convert it: mcap convert recording.db3 recording.mcap.",
    b"#ROSBAG": "a ROS 1 bag. Convert it: mcap convert recording.bag recording.mcap.",
    b"\x1f\x8b": "compressed with gzip. Unpack it first.",
    b"\xd0\xcf\x11\xe0": "an Excel sheet. Save it as CSV.",
}
"""First bytes of formats that are not read, and what to do with them."""


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
    """Open a log by its first bytes, whatever its ending says.

    Raises:
        HuskyError: The file cannot be opened or is of no known format.
    """
    from sysid.logs.formats.phone_exports import open_folder, open_zip

    try:
        if path.is_dir():
            return open_folder(path)
        with path.open("rb") as file:
            magic = file.read(16)
    except OSError as error:
        raise HuskyError(f"{path}: cannot be opened ({error.strerror}).") from error
    for start, advice in _KNOWN_ELSEWHERE.items():
        if magic.startswith(start):
            raise HuskyError(f"{path}: {advice}")
    if magic.startswith(b"PAR1"):
        return _open_parquet(path)
    if magic.startswith(b"\x89MCAP"):
        from sysid.logs.formats.mcap import open_mcap

        return open_mcap(path)
    if magic.startswith(b"PK") and path.suffix.lower() in (".xlsx", ".ods"):
        raise HuskyError(f"{path}: a spreadsheet. Save it as CSV.")
    if magic.startswith(b"PK"):
        return open_zip(path)
    return open_csv(path)
