"""Columns that are read beside the motion keep its rows."""

import numpy as np
import pytest
from rocking import rocking, write_csv

from sysid.errors import SysidError
from sysid.logs import LogOptions, read_roll

TIME = np.arange(0, 6, 0.002)
ROLL = rocking(TIME)[0] + np.random.default_rng(7).normal(0, 1e-3, TIME.size)


def test_an_extra_column_keeps_the_rows_of_the_motion(tmp_path):
    torque, roll = np.cos(3 * TIME), ROLL.copy()
    roll[100], torque[200] = np.nan, np.nan
    path = write_csv(tmp_path / "log.csv", ("t_s", "roll_rad", "tau"), TIME, roll, torque)
    read = read_roll(path, LogOptions(also=("tau", "2")))
    assert read.time.size == TIME.size - 1
    kept = np.delete(np.arange(TIME.size), 100)
    np.testing.assert_allclose(read.extra["tau"], torque[kept], atol=1e-6)
    np.testing.assert_allclose(read.extra["roll_rad"], read.roll, atol=1e-9)
    assert read[5:50].extra["tau"].size == 45
    with pytest.raises(SysidError, match="no such column"):
        read_roll(path, LogOptions(also=("taw",)))
