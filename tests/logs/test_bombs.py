"""Files of a few kilobytes that ask for gigabytes, and others whose reader would end the process, get one line."""

import struct

import numpy as np
import pytest

from sysid.errors import SysidError
from sysid.logs import read_roll


def test_a_matlab_file_that_unpacks_to_gigabytes(tmp_path):
    path = tmp_path / "log.mat"
    pytest.importorskip("scipy.io").savemat(path, {"roll": np.zeros(9)})
    data = bytearray(path.read_bytes())
    struct.pack_into("<II", data, 160, 1, 1 << 30)  # the array's size, behind its tag and flags
    path.write_bytes(data)
    with pytest.raises(SysidError, match="unpacks to more than 1 GiB"):
        read_roll(path)


def test_a_parquet_file_of_a_billion_equal_rows(tmp_path):
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "log.parquet"
    part = pa.table({"flag": pa.DictionaryArray.from_arrays(np.zeros(1 << 21, np.int8), ["x"])})
    with pq.ParquetWriter(path, part.schema) as writer:
        for _ in range(70):
            writer.write_table(part)
    assert path.stat().st_size < 1 << 20
    with pytest.raises(SysidError, match="unpacks to more than 1 GiB"):
        read_roll(path)


def test_a_dataset_of_hdf5_that_was_never_filled(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("roll_rad", shape=(1 << 40,), dtype="f8", chunks=(1 << 16,), compression="gzip")
    with pytest.raises(SysidError, match="unpacks to more than 1 GiB"):
        read_roll(path)


def test_a_cell_far_from_the_others(tmp_path):
    writer = pytest.importorskip("xlsxwriter")
    path = tmp_path / "log.xlsx"
    with writer.Workbook(path) as book:
        sheet = book.add_worksheet()
        sheet.write_row(0, 0, ("time_s", "roll_rad"))
        sheet.write(1048575, 16383, 1.0)
    with pytest.raises(SysidError, match=r"a cell far from the others \(column 16384, row 1048576\)"):
        read_roll(path)
