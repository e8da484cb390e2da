"""Cubic Hermite interpolation on an even grid: from integration steps to the samples of a log."""

from typing import Any

import numpy as np

from sysid.roll import Array


def hermite_matrix(time: Array, h: float, points: int, *, slope: bool = False) -> Any:
    """Return the sparse matrix from grid values and slopes to values (or slopes) at `time`.

    Args:
        time: Times within the grid [s], shape (n,).
        h: Grid step [s].
        slope: Return the matrix for slopes at `time` instead of values.

    Returns:
        CSR matrix, shape (n, 2 points); its columns take value and slope of each grid point in turn.
    """
    from scipy.sparse import csr_matrix

    index = np.minimum((time / h).astype(np.int64), points - 2)
    s = time / h - index
    if slope:
        w = (-6 * s * (1 - s) / h, (1 - s) * (1 - 3 * s), 6 * s * (1 - s) / h, s * (3 * s - 2))
    else:
        w = ((1 + 2 * s) * (1 - s) ** 2, h * s * (1 - s) ** 2, s**2 * (3 - 2 * s), -h * s**2 * (1 - s))
    columns = (2 * index[:, None] + np.arange(4)).ravel()
    rows = np.arange(0, len(columns) + 1, 4)
    return csr_matrix((np.stack(w, axis=1).ravel(), columns, rows), shape=(len(time), 2 * points))
