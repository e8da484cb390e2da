"""From a file to roll: units, overrides, noise, wraps, saturation, refusals, and real logs."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import husky
from rocking import rocking, write_csv

from sysid.errors import SysidError
from sysid.logs import LogOptions, read_roll
from sysid.noise.sensor import estimate_noise, saturated

TIME = np.arange(0, 6, 0.002)
RNG = np.random.default_rng(7)
ROLL = rocking(TIME)[0] + RNG.normal(0, 1e-3, TIME.size)


# Units and overrides


@pytest.mark.parametrize(
    ("header", "scale", "options"),
    [
        ("roll_deg", 57.29577951308232, {}),
        ("roll", 57.29577951308232, {}),
        ("roll", 1.0, {}),
        ("angle (mrad)", 1e3, {}),
        ("roll_deg", 1.0, {"unit": "rad"}),
        ("counts", 651.8986469044033, {"column": "counts", "unit": "0.0015339807878856412"}),
        ("x7", 57.29577951308232, {"column": "X7", "unit": "degrees"}),
        ("turns", 0.15915494309189535, {"column": "2", "unit": "rev"}),
    ],
)
def test_units_by_name_by_size_and_by_hand(tmp_path, header, scale, options):
    path = write_csv(tmp_path / "log.csv", ("t_s", header), TIME, ROLL * scale)
    roll = read_roll(path, LogOptions(**options))
    np.testing.assert_allclose(roll.roll, ROLL, atol=1e-7)
    assert roll.std[0] == pytest.approx(1e-3, rel=0.1)


def test_the_axis_picks_the_angle_and_flips_it(tmp_path):
    path = write_csv(
        tmp_path / "log.csv", ("t_s", "yaw_rad", "pitch_rad", "roll_rad"), TIME, 2 * ROLL, -ROLL, ROLL
    )
    np.testing.assert_allclose(read_roll(path).roll, ROLL, atol=1e-8)
    np.testing.assert_allclose(read_roll(path, LogOptions(axis="pitch")).roll, -ROLL, atol=1e-8)
    np.testing.assert_allclose(read_roll(path, LogOptions(axis="-x")).roll, -ROLL, atol=1e-8)
    np.testing.assert_allclose(read_roll(path, LogOptions(axis="-z")).roll, -2 * ROLL, atol=1e-8)
    with pytest.raises(SysidError, match="minus sign"):
        read_roll(path, LogOptions(axis="up"))


# Noise


@pytest.mark.parametrize("std", [1e-4, 1e-3, 5e-3])
@pytest.mark.parametrize("frequency", [1.0, 6.0])
def test_white_noise_is_found_whatever_the_motion(std, frequency):
    time = np.arange(0, 6, 0.005)
    signal = rocking(time, omega=2 * np.pi * frequency)[0]
    found = [
        estimate_noise(signal + np.random.default_rng(k).normal(0, std, time.size)).std for k in range(20)
    ]
    assert np.mean(found) == pytest.approx(std, rel=0.06)


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_quantised_encoders_have_at_least_the_rounding_error(bits):
    step = 2 * np.pi / 2**bits
    noise = estimate_noise(np.round(rocking(TIME)[0] / step) * step)
    assert noise.step == pytest.approx(step, rel=1e-6)
    assert step / np.sqrt(12) <= noise.std < 1.5 * step


# Wraps and saturation


def test_wrapped_angles_are_unwrapped_and_brought_near_zero(tmp_path):
    wrapped = np.rad2deg(np.mod(ROLL - 0.02, 2 * np.pi))
    roll = read_roll(write_csv(tmp_path / "a.csv", ("t_s", "roll_deg"), TIME, wrapped))
    assert any("unwrapped" in note for note in roll.notes)
    np.testing.assert_allclose(roll.roll, ROLL - 0.02, atol=1e-6)


def test_saturation_is_a_warning_and_counts_for_little(tmp_path):
    signal = rocking(TIME, zeta=0.01)[0]
    path = write_csv(tmp_path / "log.csv", ("t_s", "roll_rad"), TIME, np.clip(signal, -0.2, 0.2))
    roll = read_roll(path)
    clipped = (np.abs(signal) > 0.2) & (TIME > 1.0)
    assert any("saturated" in warning for warning in roll.warnings)
    assert np.mean(roll.std[clipped] > 0.01) > 0.8
    # The lost height is guessed within a factor of two at the largest swing that is cut on both sides.
    swing = clipped & (TIME > 1.1) & (TIME < 1.3)
    assert 0.5 < roll.std[swing].max() / (np.abs(signal[swing]).max() - 0.2) < 2
    assert roll.std[~clipped].max() < 2 * roll.std.min()


@pytest.mark.parametrize("step", [0.0, 2 * np.pi / 4096, 2 * np.pi / 1000])
def test_turning_points_holds_and_stops_are_not_saturation(step):
    for omega in (6.0, 25.0):
        signal = rocking(TIME, omega=omega)[0]
        if step:
            signal = np.round(signal / step) * step
        assert saturated(signal, estimate_noise(signal)) is None


# Refusals


def broken(tmp_path, name, text):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


ROWS = "".join(f"{t:.6g},{r:.6g}\n" for t, r in zip(TIME, ROLL, strict=True))


@pytest.mark.parametrize(
    ("name", "text", "hint"),
    [
        ("empty.csv", "", "empty"),
        ("empty_utf16.csv", "\n".encode("utf-16"), "empty"),
        ("header_only.csv", "t_s,roll_rad\n", "no rows of numbers"),
        ("binary.csv", bytes(range(256)) * 100, "binary file"),
        (
            "text.csv",
            "t_s,roll_rad\n0,0.32\n0.0005,0.32\n" + ROWS.replace("0.32", "oops", 1),
            r"line \d+, column 'roll_rad': 'oops",
        ),
        ("ragged.csv", "t_s,roll_rad\n" + ROWS + "1,2,3,4\n", "line 3002 has 4 fields where 2"),
        ("constant.csv", "t_s,roll_rad\n" + "".join(f"{k},0.5\n" for k in range(99)), "never changes"),
        ("nan.csv", "t_s,roll_rad\n" + "".join(f"{k},nan\n" for k in range(99)), "0 of 99 rows"),
        ("no_time.csv", "roll_rad\n" + "".join(f"{r:.6g}\n" for r in ROLL), "--rate"),
        ("no_roll.csv", "t_s,battery\n" + ROWS, "--column"),
        ("one_line.csv", "1," * 300_000, "transpose"),
        ("not.mcap", b"\x89MCAP0\r\nbroken", "."),
    ],
)
def test_bad_files_get_one_clear_line_and_leave_nothing(tmp_path, name, text, hint):
    path = broken(tmp_path, name, text)
    with pytest.raises(SysidError, match=hint) as refused:
        read_roll(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_command_refuses_the_same_way(tmp_path):
    path = broken(tmp_path, "binary.csv", bytes(range(256)) * 100)
    done = husky("roll", path, "-o", tmp_path / "out.csv")
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out.csv").exists()
    assert husky("roll", tmp_path / "none.csv", "-o", tmp_path / "out.csv").returncode == 1
    assert husky("roll", path).returncode == 2
    good = write_csv(tmp_path / "good.csv", ("t_s", "roll_rad"), TIME, ROLL)
    done = husky("roll", good, "-o", good / "out.csv")
    assert done.returncode == 1
    assert sorted(file.name for file in tmp_path.iterdir()) == ["binary.csv", "good.csv"]


def test_wrong_columns_are_met_with_a_proposal(tmp_path):
    path = write_csv(tmp_path / "log.csv", ("t_s", "roll_rad"), TIME, ROLL)
    with pytest.raises(SysidError, match="Did you mean 'roll_rad'"):
        read_roll(path, LogOptions(column="rol_rad"))
    with pytest.raises(SysidError, match="--time-column 'zeit'"):
        read_roll(path, LogOptions(time_column="zeit"))
    with pytest.raises(SysidError, match="not a unit of an angle"):
        read_roll(path, LogOptions(unit="furlong"))
    with pytest.raises(SysidError, match="no column of imu"):
        read_roll(path, LogOptions(source="imu"))


def test_a_file_of_two_gigabytes_of_nothing_is_refused_at_once(tmp_path):
    path = tmp_path / "zeros.csv"
    with path.open("wb") as file:
        file.write(("t_s,roll_rad\n" + ROWS * 10).encode())
        file.truncate(2 << 30)  # sparse: zeros take no room on disk
    with pytest.raises(SysidError, match="zero bytes"):
        read_roll(path)


# The command


def test_roll_writes_what_it_can_read_back(tmp_path):
    path = write_csv(tmp_path / "log.csv", ("t_ms", "roll_deg"), TIME * 1e3, np.rad2deg(ROLL))
    out = tmp_path / "sub" / "roll.csv"
    done = husky("roll", path, "-o", out, "--json", "-", "--axis", "-x", "--from", 1, "--to", 3)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["origin"] == "angle"
    assert result["rate_hz"] == pytest.approx(500)
    assert result["rows"] == 1001
    assert any("roll_deg" in note for note in result["notes"])
    assert out.read_text().splitlines()[0] == "time_s,roll_rad,roll_std_rad"
    first, again = read_roll(path), read_roll(out)
    inside = (first.time >= 1) & (first.time <= 3)
    np.testing.assert_allclose(again.roll, -first.roll[inside], atol=1e-8)
    np.testing.assert_allclose(again.std, first.std[inside], rtol=1e-6)


# Real logs


@pytest.mark.parametrize(
    ("log", "origin", "column", "rows", "amplitude"),
    [
        ("servo_passive_drop/drop_kp100.csv", "angle", "angle_rad", 1510, (0.15, 0.35)),
        ("servo_passive_drop/drop_kp800.csv", "angle", "angle_rad", 1509, (0.6, 0.96)),
        ("rotary_pendulum_freeswing/swing_01.csv", "angle", "angle_rad", 5000, (1.7, 2.4)),
        ("kvlcc2_roll_decay/run_21337.csv", "angle", "roll_rad", 9166, (0.16, 0.17)),
        ("bicycle_wheel_gyro/radial.csv", "gyro", "gyro_rad_s", 1001, (0.2, 0.22)),
        ("video_red_apple/red_apple_track.csv", "angle", "angle_rad", 1299, (0.3, 0.4)),
    ],
)
def test_real_logs_are_read_with_no_option(real_logs: Path, log, origin, column, rows, amplitude):
    roll = read_roll(real_logs / log)
    assert roll.origin == origin
    assert roll.time.size == rows
    assert np.all(np.diff(roll.time) > 0)
    assert np.all(roll.std > 0)
    assert any(f"'{column}'" in note for note in roll.notes)
    low, high = amplitude
    assert low < roll.roll.max() < high
    assert low < -roll.roll.min() < high


def test_encoder_steps_of_real_logs(real_logs: Path):
    servo = read_roll(real_logs / "servo_passive_drop/drop_kp400.csv")
    assert 2 * np.pi / 4096 / np.sqrt(12) * 0.99 < servo.std[0] < 2 * np.pi / 4096
    arm = read_roll(real_logs / "rotary_pendulum_freeswing/swing_02.csv")
    assert 2 * np.pi / 4000 / np.sqrt(12) * 0.99 < arm.std[0] < 2 * np.pi / 4000
    assert any("angle_deg_as_logged" in note for note in arm.notes)


def test_a_gyro_without_rest_finds_its_offset_in_the_oscillation(real_logs: Path):
    roll = read_roll(real_logs / "bicycle_wheel_gyro/radial.csv")
    assert roll.rate is not None
    angle = roll.roll - roll.roll.mean()
    peaks = [k for k in range(20, angle.size - 20) if abs(angle[k]) == abs(angle[k - 20 : k + 21]).max()]
    heights = np.abs(roll.roll[peaks])
    # Left and right swings about zero shrink together; a wrong offset would let the angle walk away.
    middle = 0.5 * (heights[2:] + heights[:-2])
    assert np.abs(heights[1:-1] / middle - 1).max() < 0.01


def test_an_angle_may_be_declared_a_rate_and_the_time_is_not_the_signal(tmp_path):
    path = write_csv(tmp_path / "log.csv", ("t_s", "roll_deg"), TIME, ROLL)
    roll = read_roll(path, LogOptions(column="roll_deg", unit="rad/s"))
    assert roll.origin == "gyro"
    with pytest.raises(SysidError, match="is the column of time"):
        read_roll(path, LogOptions(column="1"))


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


SLOW = np.arange(0, 9, 0.01)
TURN = {"deg": 360.0, "rad": 2 * np.pi}


def wrapped(unit, rest, seed=0):
    roll = rocking(SLOW, rest=np.radians(rest), omega=2 * np.pi * 2)[0]
    roll = roll + np.random.default_rng(seed).normal(0, 5e-4, len(SLOW))
    angle = np.degrees(roll) if unit == "deg" else roll
    return roll, (angle + TURN[unit] / 2) % TURN[unit] - TURN[unit] / 2


@pytest.mark.parametrize(("unit", "name"), [("deg", "roll"), ("rad", "angle")])
def test_a_wrap_gives_the_unit_away(tmp_path, unit, name):
    roll, angle = wrapped(unit, 175)
    read = read_roll(write_csv(tmp_path / "log.csv", ("time_s", name), SLOW, angle))
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
