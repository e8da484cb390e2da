"""Of several columns that may be roll, the one that moves is."""

import numpy as np
import pytest
from rocking import OMEGA, imu, rocking, write_csv

from sysid.free_decay import fit_decay
from sysid.logs import LogOptions, read_roll
from sysid.quantity import Quantity
from sysid.releases import find_releases

TIME = np.arange(0, 8, 1 / 200)


def columns(*, fused, pitch=None):
    """A phone whose y axis lies along the board: its own roll hardly turns, its gyro's y does."""
    rng = np.random.default_rng(0)
    roll, rate, acceleration = rocking(TIME)
    gyro, accel = imu(TIME, roll, rate, acceleration)
    gyro, accel = gyro[:, [1, 0, 2]] * [1, 1, -1], accel[:, [1, 0, 2]] * [1, 1, -1]
    wander = 0.3 * np.cumsum(rng.normal(0, 1, len(TIME))) / np.sqrt(len(TIME))
    sens = np.degrees(roll) if fused else wander
    data = {"t_s": TIME, "sensRoll": sens + rng.normal(0, 0.02, len(TIME))}
    if pitch is not None:
        data["sensPitch"] = np.degrees(pitch) + rng.normal(0, 0.02, len(TIME))
    for k, a in enumerate("xyz"):
        data[f"gyro{a} (rad/s)"] = gyro[:, k] + rng.normal(0, 3e-3, len(TIME))
    return data, accel


def read(tmp_path, data, **options):
    return read_roll(write_csv(tmp_path / "log.csv", tuple(data), *data.values()), LogOptions(**options))


def frequency(roll):
    return fit_decay(find_releases(roll), Quantity(8.7e-3, 0.0, "kg*m^2")).numbers.omega_n.value


def test_the_gyro_axis_that_carries_the_motion_wins_over_a_name(tmp_path):
    data, _ = columns(fused=False)
    roll = read(tmp_path, data)
    assert roll.origin == "gyro"
    assert frequency(roll) == pytest.approx(OMEGA, rel=2e-3)
    assert any("'sensRoll' hardly moves" in text for text in roll.warnings)
    assert read(tmp_path, data, column="sensRoll").origin == "angle"


def test_a_fused_roll_that_moves_with_the_gyro_is_taken(tmp_path):
    data, _ = columns(fused=True)
    roll = read(tmp_path, data)
    assert roll.origin == "angle"
    assert not any("hardly moves" in text for text in roll.warnings)


def test_the_angle_that_moves_wins_over_the_one_called_roll(tmp_path):
    data, _ = columns(fused=False, pitch=rocking(TIME)[0])
    data = {name: column for name, column in data.items() if "gyro" not in name}
    roll = read(tmp_path, data)
    assert frequency(roll) == pytest.approx(OMEGA, rel=2e-3)
    assert any("'sensPitch' does" in text for text in roll.warnings)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_of_two_rates_the_livelier_is_taken(tmp_path, share):
    noise = np.random.default_rng(1).normal(0, 0.01, (2, len(TIME)))
    slow = share * rocking(TIME, omega=0.5 * OMEGA)[1]
    data = {"t_s": TIME, "j1_vel": slow + noise[0], "j2_vel": rocking(TIME)[1] + noise[1]}
    assert frequency(read(tmp_path, data)) == pytest.approx(OMEGA, rel=2e-3)
