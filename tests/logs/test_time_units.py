"""What the stamps of a log mean: their unit where nobody says it, pauses, midnight, and times as the log has them."""

from datetime import datetime, timedelta

import numpy as np
import pytest
from rocking import OMEGA, rocking, write_csv

from sysid.errors import SysidError
from sysid.free_decay import fit_decay
from sysid.logs import LogOptions, read_roll
from sysid.quantity import Quantity
from sysid.releases import find_releases

TIME = np.arange(0, 8, 1 / 200)
INERTIA = Quantity(8.7e-3, 0.0, "kg*m^2")


def swing(time, **motion):
    return rocking(time, **motion)[0] + np.random.default_rng(0).normal(0, 1e-3, len(time))


def frequency(path, **options):
    return fit_decay(find_releases(read_roll(path, LogOptions(**options))), INERTIA).numbers.omega_n.value


@pytest.mark.parametrize("pause", [60.0, 1800.0, 36000.0])
def test_a_pause_does_not_change_the_unit(tmp_path, pause):
    """Two decays with a pause between: the mean step is no guess of the unit."""
    stamps = np.concatenate((TIME, TIME + 8 + pause))
    path = write_csv(tmp_path / "log.csv", ("t", "roll_rad"), stamps, np.tile(swing(TIME), 2))
    roll = read_roll(path)
    assert roll.sampling_rate == pytest.approx(200)
    assert len(find_releases(roll)) == 2
    assert frequency(path) == pytest.approx(OMEGA, rel=2e-3)


@pytest.mark.parametrize(("unit", "size"), [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)])
def test_bursts_do_not_change_the_unit(tmp_path, unit, size):
    """Ten samples come with one stamp each 50 ms, a microsecond apart."""
    bursts = np.floor(np.arange(len(TIME)) / 10) * 0.05 + np.arange(len(TIME)) % 10 * 1e-6
    path = write_csv(tmp_path / "log.csv", ("t", "roll_rad"), bursts / size, swing(TIME), form="%.12g")
    assert read_roll(path).sampling_rate == pytest.approx(200, rel=0.01), unit


def clock_times(begin, stamps, form):
    return [(begin + timedelta(seconds=float(t))).strftime(form)[:-3] for t in stamps]


@pytest.mark.parametrize("header", ["time", "Timestamp", "time_ms"])
def test_a_time_of_day_runs_over_midnight_in_seconds(tmp_path, header):
    times = clock_times(datetime(2024, 3, 31, 23, 59, 56), TIME, "%H:%M:%S.%f")
    path = write_csv(tmp_path / "log.csv", (header, "roll_rad"), times, swing(TIME))
    roll = read_roll(path)
    assert roll.time[-1] - roll.time[0] == pytest.approx(TIME[-1], abs=0.01)
    assert any("midnight" in note for note in roll.notes)
    assert frequency(path) == pytest.approx(OMEGA, rel=2e-3)


def test_a_clock_that_is_set_back_loses_no_sample(tmp_path):
    stamps = np.where(TIME < 4, TIME, TIME - 3600)
    times = clock_times(datetime(2024, 10, 27, 2, 59, 56), stamps, "%Y-%m-%d %H:%M:%S.%f")
    path = write_csv(tmp_path / "log.csv", ("time", "roll_rad"), times, swing(TIME))
    roll = read_roll(path)
    assert roll.time[-1] - roll.time[0] == pytest.approx(TIME[-1], abs=0.01)
    assert len(find_releases(roll)) == 1


def test_times_are_shown_and_taken_as_the_log_has_them(tmp_path):
    path = write_csv(tmp_path / "log.csv", ("t_s", "roll_rad"), TIME + 13.84, swing(TIME))
    roll = read_roll(path)
    assert roll.time[0] == pytest.approx(13.84)
    assert find_releases(roll)[0].start == pytest.approx(14.84, abs=0.01)
    (release,) = find_releases(roll, start=14.5, stop=20.0)
    assert release.start == pytest.approx(14.84, abs=0.01)
    with pytest.raises(SysidError, match=r"from 13.84 s to 21.8"):
        find_releases(roll, start=0.0, stop=5.0)
