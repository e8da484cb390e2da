"""MATLAB files up to version 7.2."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sysid.logs.formats.registry import Format, refuse_larger, starts_with, undamaged
from sysid.logs.formats.tables import log_of_vectors
from sysid.logs.table.file import LogFile
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
    return log_of_vectors(
        path, "MATLAB", dict(vectors_of({n: v for n, v in content.items() if n[:2] != "__"}))
    )


def vectors_of(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Array]]:
    """Yield the real vectors among some variables, shape (n,) in their units, those of matrices and structures included."""
    for name, value in content.items():
        label = f"{prefix}{name}"
        if hasattr(value, "_fieldnames"):
            yield from vectors_of({field: getattr(value, field) for field in value._fieldnames}, f"{label}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
            if value.ndim == 1:
                yield label, value.astype(np.float64)
            elif value.ndim == 2:
                columns = value.T if value.shape[0] >= value.shape[1] else value
                yield from ((f"{label}_{n}", row.astype(np.float64)) for n, row in enumerate(columns, 1))


FORMAT = Format(name="MATLAB", order=5, sniff=starts_with(b"MATLAB 5.0"), open=open_mat)
