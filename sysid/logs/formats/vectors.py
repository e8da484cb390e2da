"""Vectors by name: HDF5 files, and MATLAB's of all versions."""

import math
from collections.abc import Iterator, Mapping
from os.path import commonprefix
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import SysidError, needs_extra
from sysid.logs.formats.registry import Format, refuse_larger, undamaged
from sysid.logs.formats.tables import sensor_tables
from sysid.logs.table.clock import rises, time_scale
from sysid.logs.table.file import LogFile
from sysid.logs.table.names import parse_column
from sysid.roll import Array


def open_mat(path: Path) -> LogFile:
    """Open a MATLAB file.

    Raises:
        SysidError: It is damaged, unpacks to too much, or holds no vectors of numbers.
    """
    import scipy.io

    with undamaged(path, "MATLAB file"):
        refuse_larger(path, sum(8.0 * math.prod(shape) for _, shape, _ in scipy.io.whosmat(str(path))))
        content: dict[str, Any] = scipy.io.loadmat(str(path), squeeze_me=True, struct_as_record=False)
    return log_of_vectors(path, "MATLAB", {n: v for n, v in content.items() if n[:2] != "__"})


def open_hdf5(path: Path) -> LogFile:
    """Open an HDF5 file: its vectors, matrices and tables, by their path in it.

    Raises:
        SysidError: The reader is not installed, the file is damaged, or it holds no vectors of numbers.
    """
    otherwise = "Or write its columns out: h5dump -d DATASET -y -w 0 -o log.csv FILE; in MATLAB: save('log.mat', '-v7')."
    with needs_extra("formats", f"{path}: reading HDF5", otherwise):
        import h5py
    content: dict[str, Any] = {}

    def keep(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiuV":
            refuse_larger(path, sum(kept.nbytes for kept in content.values()) + item.nbytes)
            values: Any = np.asarray(item)
            fields = values.dtype.names
            content.update(
                {f"{name}/{f}": values[f] for f in fields} if fields else {name: np.squeeze(values)}
            )

    with undamaged(path, "HDF5 file"), h5py.File(path, "r") as file:
        file.visititems(keep)
    return log_of_vectors(path, "HDF5", content)


def _vectors_of(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Array]]:
    """Yield the real vectors among some variables, shape (n,) in their units, those of matrices and structures included."""
    for name, value in content.items():
        label = f"{prefix}{name}"
        if hasattr(value, "_fieldnames"):
            yield from _vectors_of({field: getattr(value, field) for field in value._fieldnames}, f"{label}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
            if value.ndim == 1:
                yield label, value.astype(np.float64)
            elif value.ndim == 2:
                columns = value.T if value.shape[0] >= value.shape[1] else value
                yield from ((f"{label}_{n}", row.astype(np.float64)) for n, row in enumerate(columns, 1))


def log_of_vectors(path: Path, kind: str, content: Mapping[str, Any]) -> LogFile:
    """Return the vectors of a file as one log, each on the clock of its length whose name is most like its own.

    Raises:
        SysidError: There is no vector.
    """
    named = {name: values for name, values in _vectors_of(content) if len(values) > 1}
    if not named:
        raise SysidError(f"{path}: no vector of numbers among {', '.join(content) or 'nothing'}.")
    parsed = {name: parse_column(name) for name in named}
    rising = [name for name in named if parsed[name].kind == "time" and rises(named[name])]
    columns: dict[str, tuple[str, Array]] = {}
    for name, values in named.items():
        same = [clock for clock in rising if len(named[clock]) == len(values)]
        alike = [len(commonprefix([clock, name])) for clock in same]  # noqa: RUF071  letter by letter
        columns[name] = (same[alike.index(max(alike))] if same else f"{len(values)} rows"), values
    used = {columns[name][0] for name in named if name not in rising}
    clocks = {
        clock: named[clock] * time_scale(named[clock], parsed[clock].unit)[0]
        for clock in rising
        if clock in used
    }
    signals = {name: column for name, column in columns.items() if name not in clocks}
    return sensor_tables(path, clocks, signals, f"table: {kind} file with {', '.join(named)}")


MATLAB = Format(
    name="MATLAB", order=5, sniff=lambda path, head: head.startswith(b"MATLAB 5.0"), open=open_mat,
)  # fmt: skip
HDF5 = Format(
    name="HDF5", order=6, sniff=lambda path, head: head.startswith((b"\x89HDF", b"MATLAB 7.3")), open=open_hdf5,
)  # fmt: skip
