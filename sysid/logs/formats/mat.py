"""MATLAB files up to version 7.2."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.logs.formats.registry import Format, starts_with
from sysid.roll import Array


@dataclass(frozen=True, slots=True)
class MatTable:
    """The vectors of a MATLAB file that are as long as its longest."""

    path: Path
    kind: str
    """What it is, in words."""
    columns: Mapping[str, Array]
    """Name and values, shape (n,)."""
    has_header: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables; of a matrix the name with the column's number, of a structure name.field."""
        return tuple(self.columns)

    @property
    def units(self) -> tuple[str | None, ...]:
        """No units apart from the names."""
        return (None,) * len(self.columns)

    @property
    def notes(self) -> tuple[str, ...]:
        """What is in it."""
        return (f"{self.kind} file with {', '.join(self.columns)}",)

    def read(self, names: Sequence[str]) -> dict[str, Array]:
        """Return whole columns of float64, shape (n,) each, in the log's units."""
        return {name: self.columns[name] for name in names}


def open_mat(path: Path) -> MatTable:
    """Open a MATLAB file.

    Raises:
        SysidError: It is damaged, or holds no vectors of numbers.
    """
    import scipy.io

    try:
        content: dict[str, Any] = scipy.io.loadmat(str(path), squeeze_me=True, struct_as_record=False)
    except Exception as error:  # scipy's reader lets through whatever a damaged file makes numpy raise
        raise SysidError(
            f"{path}: damaged MATLAB file ({type(error).__name__}: {str(error)[:80]})."
        ) from error
    return table_of(path, "MATLAB", {name: value for name, value in content.items() if name[:2] != "__"})


def table_of(path: Path, kind: str, content: Mapping[str, Any]) -> MatTable:
    """Return the vectors among some variables that are as long as the longest of them.

    Raises:
        SysidError: There is none.
    """
    vectors = dict(_vectors(content))
    longest = max((len(vector) for vector in vectors.values()), default=0)
    if longest < 2:
        raise SysidError(f"{path}: no vector of numbers among {', '.join(content) or 'nothing'}.")
    return MatTable(path, kind, {name: vector for name, vector in vectors.items() if len(vector) == longest})


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
