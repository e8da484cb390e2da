"""MATLAB files up to version 7.2."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats.registry import Format, starts_with, undamaged
from sysid.logs.table.file import LogFile
from sysid.roll import Array


def open_mat(path: Path) -> LogFile:
    """Open a MATLAB file.

    Raises:
        SysidError: It is damaged, or holds no vectors of numbers.
    """
    import scipy.io

    with undamaged(path, "MATLAB file"):
        content: dict[str, Any] = scipy.io.loadmat(str(path), squeeze_me=True, struct_as_record=False)
    return table_of(path, "MATLAB", {name: value for name, value in content.items() if name[:2] != "__"})


def table_of(path: Path, kind: str, content: Mapping[str, Any]) -> LogFile:
    """Return the vectors among some variables that are as long as the longest of them.

    Raises:
        SysidError: There is none.
    """
    vectors = dict(_vectors(content))
    longest = max((len(vector) for vector in vectors.values()), default=0)
    if longest < 2:
        raise SysidError(f"{path}: no vector of numbers among {', '.join(content) or 'nothing'}.")
    columns = {name: vector for name, vector in vectors.items() if len(vector) == longest}
    return LogFile(
        path=path, names=tuple(columns), notes=(f"table: {kind} file with {', '.join(columns)}",),
        read=lambda names: {name: columns[name] for name in names},
    )  # fmt: skip


def _vectors(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Array]]:
    """Yield the real vectors among some variables, those of matrices and structures included."""
    for name, value in content.items():
        label = f"{prefix}{name}"
        if hasattr(value, "_fieldnames"):
            yield from _vectors({field: getattr(value, field) for field in value._fieldnames}, f"{label}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
            if value.ndim == 1:
                yield label, value.astype(np.float64)
            elif value.ndim == 2:
                columns = value.T if value.shape[0] >= value.shape[1] else value
                yield from ((f"{label}_{n}", row.astype(np.float64)) for n, row in enumerate(columns, 1))


FORMAT = Format(name="MATLAB", order=5, sniff=starts_with(b"MATLAB 5.0"), open=open_mat)
