"""Angles that begin again after a whole turn, and the unit that this gives away."""

import numpy as np
import pytest
from rocking import rocking, write_csv

from sysid.logs import read_roll

TIME = np.arange(0, 9, 0.01)
TURN = {"deg": 360.0, "rad": 2 * np.pi}


def wrapped(unit, rest, seed=0):
    roll = rocking(TIME, rest=np.radians(rest), omega=2 * np.pi * 2)[0]
    roll = roll + np.random.default_rng(seed).normal(0, 5e-4, len(TIME))
    angle = np.degrees(roll) if unit == "deg" else roll
    return roll, (angle + TURN[unit] / 2) % TURN[unit] - TURN[unit] / 2


@pytest.mark.parametrize(("unit", "name"), [("deg", "roll"), ("rad", "angle")])
def test_a_wrap_gives_the_unit_away(tmp_path, unit, name):
    roll, angle = wrapped(unit, 175)
    read = read_roll(write_csv(tmp_path / "log.csv", ("time_s", name), TIME, angle))
    assert np.ptp(read.roll) == pytest.approx(np.ptp(roll), rel=1e-6)
    assert any(f"{unit}, because it jumps by {TURN[unit]:.4g}" in text for text in read.notes)
    assert not any("unit" in text for text in read.warnings)


@pytest.mark.parametrize(("rate", "amplitude"), [(12.0, 130.0), (20.0, 175.0), (50.0, 150.0)])
def test_a_swing_through_most_of_a_turn_is_no_wrap(tmp_path, rate, amplitude):
    time = np.arange(0, 9, 1 / rate)
    angle = np.degrees(rocking(time, amplitude=np.radians(amplitude), omega=2 * np.pi)[0])
    read = read_roll(write_csv(tmp_path / "log.csv", ("time_s", "roll"), time, angle))
    assert np.ptp(read.roll) == pytest.approx(np.radians(np.ptp(angle)), rel=1e-6)
    assert not any("wrapped" in text for text in read.notes)
