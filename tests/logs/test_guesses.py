"""What a log leaves open and a guess would get wrong: its clock, its unit, which of two columns is the joint's."""

import numpy as np
import pytest
from rocking import OMEGA, imu, rocking, write_csv

from sysid.errors import SysidError
from sysid.free_decay import fit_decay
from sysid.logs import LogOptions, read_roll
from sysid.quantity import Quantity
from sysid.releases import find_releases

TIME = np.arange(0, 6, 1 / 200)
ROLL = rocking(TIME)[0] + np.random.default_rng(0).normal(0, 1e-3, len(TIME))
COUNTS = np.round(2048 + ROLL * 4096 / (2 * np.pi))


def log(tmp_path, header, *columns):
    return write_csv(tmp_path / "log.csv", header, *columns)


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("lost", [0, 20])
def test_a_count_of_rows_is_no_clock(tmp_path, first, lost):
    rows = np.sort(np.random.default_rng(1).choice(len(TIME), len(TIME) - lost, replace=False))
    path = log(tmp_path, ("n", "a"), rows + first, np.degrees(ROLL)[rows])
    with pytest.raises(SysidError, match=r"no column of time among .*; 'n' counts the rows.*--rate"):
        read_roll(path)
    assert read_roll(path, LogOptions(rate=200.0)).sampling_rate == pytest.approx(200)
    assert read_roll(path, LogOptions(time_column="n")).sampling_rate == pytest.approx(1000)


def test_whole_numbers_that_a_name_calls_time_are_one(tmp_path):
    for name in ("t", "ms", "stamp", "time"):
        path = log(tmp_path, (name, "roll_deg"), np.arange(len(TIME)), np.degrees(ROLL))
        assert read_roll(path).sampling_rate == pytest.approx(1000)


@pytest.mark.parametrize("counts", [COUNTS, 8 * COUNTS, 8 * (COUNTS - 2048)])
def test_counts_are_no_degrees(tmp_path, counts):
    path = log(tmp_path, ("t", "position"), TIME, counts)
    with pytest.raises(SysidError, match=r"look like counts.*--unit 0\.00153398 .*2π/4096"):
        read_roll(path)
    assert np.ptp(read_roll(path, LogOptions(unit="deg")).roll) > 1
    size = str(2 * np.pi / 4096 * np.ptp(COUNTS) / np.ptp(counts))
    assert np.ptp(read_roll(path, LogOptions(unit=size)).roll) == pytest.approx(np.ptp(ROLL), rel=1e-2)


def test_whole_degrees_that_wrap_are_no_counts(tmp_path):
    path = log(tmp_path, ("t", "angle"), TIME, np.round(np.degrees(ROLL)) % 360)
    assert np.ptp(read_roll(path).roll) == pytest.approx(np.ptp(ROLL), rel=0.1)


@pytest.mark.parametrize("reach", [0.2, 17.0, 60.0])
def test_a_guessed_unit_is_doubted(tmp_path, reach):
    angle = (ROLL - 0.02) * reach / 0.3
    (warned,) = read_roll(log(tmp_path, ("time", "angle"), TIME, angle)).warnings
    assert "--unit" in warned


def test_the_joint_goes_before_its_motor_and_its_goal_after_both(tmp_path):
    joint = np.degrees(ROLL)
    path = log(tmp_path, ("time_s", "motor_deg", "joint_deg"), TIME, 9 * joint, joint)
    assert np.ptp(read_roll(path).roll) == pytest.approx(np.ptp(ROLL))
    path = log(tmp_path, ("time_s", "motor_deg", "target_deg"), TIME, joint, np.where(joint > 5, 10.0, 0.0))
    assert any("from 'motor_deg' rather than" in note for note in read_roll(path).notes)


@pytest.mark.parametrize(("times", "way"), [(0.8, -1), (1.5, 1), (9.0, 1)])
def test_another_column_as_good_by_its_name_is_named(tmp_path, times, way):
    """A smaller motion, or the same on the other side of a gear."""
    joint = np.degrees(ROLL)
    path = log(tmp_path, ("time_s", "hinge_deg", "elbow_deg"), TIME, joint, times * joint[::way])
    (warned,) = read_roll(path).warnings
    assert f"'elbow_deg' is as good by its name and turns {times:.2g}" in warned
    assert "--column 'elbow_deg'" in warned


@pytest.mark.parametrize("epoch", [0.0, 1.7e15])
def test_of_two_joints_the_livelier_is_taken_whatever_the_clock(tmp_path, epoch):
    """Stamps since the epoch once switched the comparison off."""
    stamps = [f"{epoch + 1e6 * t:.0f}" for t in TIME]
    path = log(tmp_path, ("time_us", "hip_rad", "knee_deg"), stamps, 0.3 * ROLL[::-1], np.degrees(ROLL))
    roll = read_roll(path)
    assert np.ptp(roll.roll) == pytest.approx(np.ptp(ROLL), rel=1e-6)
    assert any("'knee_deg', which turns 3.3 times as much as 'hip_rad'" in text for text in roll.warnings)


def test_one_motion_written_twice_is_no_rival(tmp_path):
    other = ROLL + np.random.default_rng(5).normal(0, 2e-3, len(TIME))
    for header, column in (
        ("angle_deg", np.degrees(ROLL)),
        ("angle", np.degrees(ROLL)),
        ("angle_b_rad", other),
    ):
        path = log(tmp_path, ("time_s", "angle_rad", header), TIME, ROLL, column)
        assert not read_roll(path).warnings
    path = log(tmp_path, ("time_s", "hip_rad", "angle_rad"), TIME, ROLL, np.full(len(TIME), 0.1))
    assert "hardly" not in " ".join(read_roll(path).warnings)


# Of several columns that may be roll, the one that moves is.


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
    return read_roll(log(tmp_path, tuple(data), *data.values()), LogOptions(**options))


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
