"""The offset of a rate gyro: from rest, never from a slow swing that seems to stand still, and from the part that counts."""

import numpy as np
import pytest
from rocking import write_csv

from sysid.logs import LogOptions, read_roll

TIME = np.arange(0, 40, 1 / 200)
OFFSET = -0.001
SLOW = 2 * np.pi / 4.0


def slow_swing(phase, seed=0):
    """Rate of a swing of 4 s that is in full swing from the first sample to the last."""
    swing = np.exp(-0.03 * TIME) * np.cos(SLOW * TIME + phase)
    return swing + OFFSET + np.random.default_rng(seed).normal(0, 0.01, len(TIME))


def offset_of(path, **options):
    roll = read_roll(path, LogOptions(**options))
    return float(next(note for note in roll.notes if note.startswith("offset: ")).split()[1])


@pytest.mark.parametrize("phase", np.arange(0, 2 * np.pi, np.pi / 2))
def test_a_slow_swing_is_no_rest(tmp_path, phase):
    path = write_csv(tmp_path / "log.csv", ("t_s", "gyro_x_rad_s"), TIME, slow_swing(phase))
    assert offset_of(path) == pytest.approx(OFFSET, abs=0.005)


def test_an_offset_that_stays_is_not_said_to_drift(tmp_path):
    for seed in range(10):
        path = write_csv(tmp_path / f"{seed}.csv", ("t_s", "gyro_x_rad_s"), TIME, slow_swing(0.0, seed))
        assert not any("drifting" in note for note in read_roll(path).notes)


def test_what_is_cut_off_says_nothing_of_the_offset(tmp_path):
    """After 20 s somebody turns the board slowly for good; --to leaves that out."""
    rate = np.where(TIME < 20, np.exp(-0.5 * TIME) * np.sin(10 * TIME), 0.4)
    rate = rate + OFFSET + np.random.default_rng(0).normal(0, 0.003, len(TIME))
    path = write_csv(tmp_path / "log.csv", ("t_s", "gyro_x_rad_s"), TIME, rate)
    assert offset_of(path, stop=19.0) == pytest.approx(OFFSET, abs=3e-4)
    assert read_roll(path, LogOptions(stop=19.0)).time[-1] == pytest.approx(TIME[-1])
