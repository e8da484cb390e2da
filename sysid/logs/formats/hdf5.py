"""HDF5 files, MATLAB's of version 7.3 among them."""

from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import needs_extra
from sysid.logs.formats.mat import vectors_of
from sysid.logs.formats.registry import Format, refuse_larger, starts_with, undamaged
from sysid.logs.formats.tables import log_of_vectors
from sysid.logs.table.file import LogFile


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
    return log_of_vectors(path, "HDF5", dict(vectors_of(content)))


FORMAT = Format(
    name="HDF5",
    order=6,
    sniff=lambda path, head: starts_with(b"\x89HDF")(path, head) or head.startswith(b"MATLAB 7.3"),
    open=open_hdf5,
)
