"""Roll from inertial sensors: truth recovered, mounted any way, off the axis, and against optical tracking."""

import numpy as np
import pytest
from rocking import imu, rocking, write_csv
from scipy.spatial.transform import Rotation

from sysid.errors import SysidError
from sysid.logs import LogOptions, read_roll
from sysid.logs.table.names import RATE_UNITS
from sysid.noise.sensor import clipped_rows, estimate_noise

TIME = np.arange(0, 8, 1 / 200)
OFFSET = np.array([0.012, -0.02, 0.005])


def turn_about(axis, angle):
    return Rotation.from_rotvec(np.array(axis, dtype=float) * angle).as_matrix()


def sensor(
    tmp_path, *, seed=0, arm=(0.0, 0.0, 0.0), mount=None, rate_unit=1.0, accel_unit=1.0, names=None, **motion
):
    rng = np.random.default_rng(seed)
    gyro, accel = imu(TIME, *rocking(TIME, release=2.0, **motion), arm=arm, mount=mount)
    gyro = (gyro + OFFSET + rng.normal(0, 3e-3, gyro.shape)) / rate_unit
    accel = (accel + rng.normal(0, 0.03, accel.shape)) / accel_unit
    names = names or ("t_s", "gx", "gy", "gz", "ax", "ay", "az")
    return write_csv(tmp_path / "imu.csv", names, TIME, *gyro.T, *accel.T)


def worst_deg(roll, **motion):
    truth = rocking(roll.time, release=2.0, **motion)[0]
    return float(np.rad2deg(np.abs(roll.roll - truth).max()))


# Gyro and accelerometer


@pytest.mark.parametrize(
    ("seed", "zeta", "arm"),
    [
        (0, 0.03, (0.0, 0.0, 0.0)),
        (1, 0.5, (0.0, 0.0, 0.0)),
        (2, 0.03, (0.1, 0.08, 0.05)),
        (0, 0.5, (0.1, 0.08, 0.05)),
    ],
)
def test_roll_is_recovered_and_its_offset_too(tmp_path, seed, zeta, arm):
    roll = read_roll(sensor(tmp_path, seed=seed, zeta=zeta, arm=arm))
    assert roll.origin == "imu"
    assert worst_deg(roll, zeta=zeta) < 0.4  # in the block in which it is let go; elsewhere a tenth of that
    truth = rocking(TIME, release=2.0, zeta=zeta)[1]
    assert np.std(roll.rate - truth) < 1.5 * 3e-3 + 2 * roll.scale_std * np.std(truth)
    assert abs(np.mean(roll.rate - truth)) < 1e-3
    assert any("cm from the axis" in note for note in roll.notes) == (arm != (0.0, 0.0, 0.0))


def test_the_lever_arm_is_found_or_taken_as_given(tmp_path):
    path = sensor(tmp_path, arm=(0.0, 0.08, 0.05), zeta=0.02)
    found = next(note for note in read_roll(path).notes if "cm from the axis" in note)
    x, y, z = (float(value) for value in found[found.index("(") + 1 : found.index(")")].split(","))
    assert (x, y, z) == pytest.approx((0, 8, 5), abs=0.5)
    given = read_roll(path, LogOptions(lever_arm=(0.0, 0.08, 0.05)))
    assert any("given" in note for note in given.notes)
    assert worst_deg(given, zeta=0.02) < 0.2


@pytest.mark.parametrize(
    ("mount", "flipped"),
    [
        (turn_about((0, 0, 1), 0.6), False),
        (turn_about((0, 0, 1), np.pi / 2), True),
        (turn_about((0, 0, 1), np.pi), True),
        (turn_about((1, 0, 0), np.pi), False),  # face down
    ],
    ids=["askew", "across", "backward", "face down"],
)
def test_the_sensor_may_lie_any_way_on_the_deck(tmp_path, mount, flipped):
    path = sensor(tmp_path, mount=mount)
    roll = read_roll(path)
    forward = mount.T @ (1.0, 0.0, 0.0)
    main = int(np.argmax(np.abs(forward)))
    backward = bool(forward[main] < 0)
    assert backward == flipped
    assert any("taken as forward" in note for note in roll.notes)
    if backward:
        roll = read_roll(path, LogOptions(axis="-" + "xyz"[main]))
    assert worst_deg(roll) < 0.2


@pytest.mark.parametrize(
    ("rate_unit", "accel_unit"),
    [
        ("rad/s", 9.80665),
        ("deg/s", 1.0),
        ("mdeg/s", 9.80665e-3),
        ("mrad/s", 9.80665 / 16384),
        ("deg/s", 9.80665),
    ],
)
def test_silent_units_are_told_by_gravity(tmp_path, rate_unit, accel_unit):
    roll = read_roll(sensor(tmp_path, rate_unit=RATE_UNITS[rate_unit], accel_unit=accel_unit))
    assert worst_deg(roll) < 0.2
    assert any(
        rate_unit in text and "turning of the accelerometer's vertical" in text for text in roll.warnings
    )


def test_an_upright_axis_is_left_to_the_gyro(tmp_path):
    gyro, accel = imu(TIME, *rocking(TIME, release=2.0))
    accel = np.broadcast_to((9.81, 0.0, 0.0), accel.shape) + np.random.default_rng(0).normal(
        0, 0.02, accel.shape
    )
    gyro = gyro + np.random.default_rng(1).normal(0, 2e-3, gyro.shape)
    path = write_csv(
        tmp_path / "imu.csv",
        ("t_s", "gx (rad/s)", "gy (rad/s)", "gz (rad/s)", "ax", "ay", "az"),
        TIME,
        *gyro.T,
        *accel.T,
    )
    roll = read_roll(path)
    assert roll.origin == "gyro"
    assert any("upright" in warning for warning in roll.warnings)
    assert worst_deg(roll, rest=0.0) < 0.3


# Gyro alone


@pytest.mark.parametrize("seed", range(2))
def test_a_gyro_alone_starts_from_its_rest(tmp_path, seed):
    rng = np.random.default_rng(seed)
    rate = rocking(TIME, release=2.0, omega=30.0)[1] + 0.05 + rng.normal(0, 3e-3, TIME.size)
    path = write_csv(tmp_path / "log.csv", ("t_s", "gyro (deg/s)"), TIME, np.rad2deg(rate))
    roll = read_roll(path)
    assert roll.origin == "gyro"
    assert worst_deg(roll, rest=0.0, omega=30.0) < 0.15
    assert any("from rest and oscillation" in note for note in roll.notes)
    np.testing.assert_allclose(roll.rate, rate - 0.05, atol=2e-3)
    assert roll.rate_std[0] == pytest.approx(3e-3, rel=0.15)
    assert np.all(np.diff(roll.std) >= 0)  # the integral's error is a random walk


def test_a_drifting_offset_goes_from_rest_to_rest(tmp_path):
    rate = rocking(TIME, release=2.0, omega=30.0, zeta=0.15)[1] + np.linspace(0.02, 0.06, TIME.size)
    rate += np.random.default_rng(0).normal(0, 3e-3, TIME.size)
    roll = read_roll(write_csv(tmp_path / "log.csv", ("t_s", "gyro_rad_s"), TIME, rate))
    assert any("drifting" in note for note in roll.notes)
    assert worst_deg(roll, rest=0.0, omega=30.0, zeta=0.15) < 0.6


def limited(rate, soft):
    """A rate [deg/s] that its sensor keeps below 250, from a share `soft` below that on little by little."""
    begin = 250 * (1 - soft)
    beyond = np.abs(rate) - begin
    bent = begin + (np.minimum(beyond, 0) if soft == 0 else 250 * soft * np.tanh(beyond / (250 * soft)))
    return np.where(beyond > 0, np.sign(rate) * bent, rate)


@pytest.mark.parametrize(
    ("soft", "noise", "amplitude", "zeta"),
    [(0.0, 0.05, 26, 0.03), (0.03, 0.3, 35, 0.08), (0.1, 2.0, 45, 0.03), (0.0, 2.0, 45, 0.08)],
)
def test_a_flat_top_is_left_out_though_no_value_repeats(tmp_path, soft, noise, amplitude, zeta):
    from sysid.free_decay import fit_decay
    from sysid.releases import find_releases

    time = np.arange(0, 9, 0.01)
    true = np.degrees(rocking(time, amplitude=np.radians(amplitude), omega=4 * np.pi, zeta=zeta)[1])
    rate = limited(true, soft) + np.random.default_rng(9).normal(0, noise, len(time))
    roll = read_roll(write_csv(tmp_path / "log.csv", ("t_s", "gyro_dps"), time, rate))
    assert any("saturated" in warning for warning in roll.warnings)
    assert not np.isin(time[np.abs(true) > 260], roll.time).any()
    damping = fit_decay(find_releases(roll)).numbers.damping_ratio
    assert abs(damping.value / zeta - 1) < max(0.01, 2 * 1.96 * damping.std / zeta)


@pytest.mark.parametrize(
    ("noise", "zeta", "rate"),
    [(0.05, 0.005, 50.0), (0.3, 0.03, 200.0), (2.0, 0.2, 1000.0), (0.05, 0.2, 200.0)],
)
def test_round_tops_are_no_limit(tmp_path, noise, zeta, rate):
    time = np.arange(0, 9, 1 / rate)
    clean = np.degrees(rocking(time, amplitude=0.35, omega=4 * np.pi, zeta=zeta)[1])
    noisy = np.round(clean + np.random.default_rng(9).normal(0, noise, len(time)), 2)
    roll = read_roll(write_csv(tmp_path / "log.csv", ("t_s", "gyro_dps"), time, noisy))
    assert not any("saturated" in warning for warning in roll.warnings)


@pytest.mark.parametrize("hardening", [1e4, 4e4])
def test_the_top_of_a_hard_spring_bends_and_is_no_limit(hardening):
    """It is flatter than a parabola, and may be near a limit that gyros have, of any height."""
    from scipy.integrate import solve_ivp

    for amplitude in np.arange(0.3, 0.4, 0.02):
        swing = solve_ivp(
            lambda _, y: (y[1], -7 * y[1] - 900 * y[0] - hardening * y[0] ** 3), (0, 2), (-amplitude, 0.0),
            t_eval=np.arange(0, 2, 0.004), max_step=1e-3,
        ).y[1]  # fmt: skip
        rate = np.concatenate((np.zeros(250), swing)) + np.random.default_rng(9).normal(0, 0.0035, 750)
        assert not clipped_rows(rate, estimate_noise(rate)).any()


# Orientation


@pytest.mark.parametrize("mirrored", [1.0, -1.0])
def test_a_quaternion_gives_the_swing_about_its_axis(tmp_path, mirrored):
    roll = rocking(TIME, release=2.0)[0]
    half = roll / 2
    # yaw 1.4 rad, then roll about the body's x
    w, x, y, z = (
        np.cos(0.7) * np.cos(half),
        np.cos(0.7) * np.sin(half),
        np.sin(0.7) * np.sin(half),
        np.sin(0.7) * np.cos(half),
    )
    columns = [mirrored * part for part in (w, x, y, z)]
    path = write_csv(tmp_path / "log.csv", ("t_s", "q_w", "q_x", "q_y", "q_z"), TIME, *columns)
    found = read_roll(path)
    assert found.origin == "quaternion"
    np.testing.assert_allclose(found.roll, roll, atol=1e-6)
    path = write_csv(
        tmp_path / "bad.csv",
        ("t_s", "q_w", "q_x", "q_y", "q_z"),
        TIME,
        *(np.where(TIME < 4, 3, 1) * part for part in columns),
    )
    with pytest.raises(SysidError, match="norm is not that of"):
        read_roll(path)


# What the columns do not say


SIX_WAYS = [turn_about(axis, angle) for axis in np.eye(3) for angle in (0.0, np.pi / 2)]
ARM = (0.1, 0.08, 0.05)


@pytest.mark.parametrize("way", range(6))
@pytest.mark.parametrize(
    ("rate_unit", "names"),
    [("rad/s", None), ("deg/s", ("t_s", *(f"w{a}" for a in "xyz"), *(f"a{a}" for a in "xyz")))],
)
def test_the_unit_of_a_gyro_off_the_axis(tmp_path, way, rate_unit, names):
    """The lever arm's accelerations are not gravity, and a triad is never in rpm."""
    path = sensor(
        tmp_path,
        seed=way,
        arm=ARM,
        mount=SIX_WAYS[way],
        rate_unit=RATE_UNITS[rate_unit],
        zeta=0.02,
        names=names,
    )
    roll = read_roll(path, LogOptions(axis="x" if way in (0, 1, 2, 4) else None))
    assert np.ptp(roll.roll) == pytest.approx(np.ptp(rocking(TIME, release=2.0, zeta=0.02)[0]), rel=0.03)
    assert any(rate_unit in text and "--unit" in text for text in roll.warnings)


@pytest.mark.parametrize(
    ("height", "rate_unit"), [(-0.15, "deg/s"), (0.02, "rad/s"), (0.05, "deg/s"), (0.1, "deg/s")]
)
def test_a_gyro_above_or_below_the_axis_keeps_its_unit(tmp_path, height, rate_unit):
    """At 5 to 10 cm the lever arm's acceleration made deg/s look like rpm, and every angle six times as large."""
    roll = read_roll(sensor(tmp_path, arm=(0.0, 0.0, height), rate_unit=RATE_UNITS[rate_unit], zeta=0.02))
    assert np.ptp(roll.roll) == pytest.approx(np.ptp(rocking(TIME, release=2.0, zeta=0.02)[0]), rel=0.03)


@pytest.mark.parametrize("counts_per_deg_s", [131.0, 16.4, 14.375])
def test_raw_counts_of_a_gyro(tmp_path, counts_per_deg_s):
    size = np.deg2rad(1 / counts_per_deg_s)
    rng = np.random.default_rng(0)
    gyro, accel = imu(TIME, *rocking(TIME, release=2.0))
    counts = np.round((gyro + OFFSET + rng.normal(0, 3e-3, gyro.shape)) / size)
    accel = accel + rng.normal(0, 0.03, accel.shape)
    path = write_csv(
        tmp_path / "imu.csv", ("t_s", "gx", "gy", "gz", "ax", "ay", "az"), TIME, *counts.T, *accel.T
    )
    roll = read_roll(path)
    assert np.ptp(roll.roll) == pytest.approx(np.ptp(rocking(TIME, release=2.0)[0]), rel=0.05)
    assert any("one count" in text for text in roll.warnings)


@pytest.mark.parametrize(("gain", "below"), [(0.98, 2.0), (1.02, 2.4)])
def test_at_the_end_of_a_pendulum_the_gyro_keeps_its_scale(tmp_path, below, gain):
    """A swing seat feels its weight along the ropes at every tilt, which tells no angle."""
    time, rng = np.arange(0, 80, 1 / 50), np.random.default_rng(2)
    motion = rocking(time, amplitude=0.55, rest=0.0, release=3.0, omega=np.sqrt(9.81 / 2.1), zeta=0.01)
    gyro, accel = imu(time, *motion, arm=(0.0, 0.0, -below))
    gyro, accel = gyro * gain + rng.normal(0, 4e-3, gyro.shape), accel + rng.normal(0, 0.03, accel.shape)
    names = ("t_s", *(f"gyro{a} (rad/s)" for a in "xyz"), "ax", "ay", "az")
    roll = read_roll(write_csv(tmp_path / "log.csv", names, time, *gyro.T, *accel.T))
    assert roll.rate is not None
    scale = float(roll.rate @ motion[1] / (motion[1] @ motion[1]))
    assert abs(scale - 1) < 2.5 * roll.scale_std


# Accelerometer alone


@pytest.mark.parametrize(("height", "given"), [(-0.05, False), (0.2, False), (0.06, True)])
def test_an_accelerometer_alone_gives_the_decay_of_a_swing(tmp_path, height, given):
    """Along the motion it feels g sin φ + r φ̈: the same decay, of another size."""
    from sysid.free_decay import fit_decay
    from sysid.releases import find_releases

    _, accel = imu(TIME, *rocking(TIME, release=2.0, zeta=0.02), arm=(0.0, 0.03, height))
    accel = accel + np.random.default_rng(3).normal(0, 0.03, accel.shape)
    path = write_csv(tmp_path / "log.csv", ("t_s", "ax", "ay", "az"), TIME, *accel.T)
    roll = read_roll(path, LogOptions(lever_arm=(0.0, 0.03, height) if given else None))
    numbers = fit_decay(find_releases(roll)).numbers
    assert roll.origin == "accelerometer"
    assert abs(numbers.omega_n.value - 8 * np.pi) < 3 * numbers.omega_n.std + 1e-3 * 8 * np.pi
    assert abs(numbers.damping_ratio.value - 0.02) < 3 * numbers.damping_ratio.std + 2e-4
    size = np.ptp(roll.roll[roll.time > 2.1]) / np.ptp(
        rocking(roll.time, release=2.0, zeta=0.02)[0][roll.time > 2.1]
    )
    assert abs(size - 1) < 3 * roll.scale_std + 0.02


def test_a_wide_swing_keeps_its_damping_without_a_gyro(tmp_path):
    """The sine of a wide angle is not the angle, and the lever arm takes off a part of it."""
    from sysid.free_decay import fit_decay
    from sysid.releases import find_releases

    time = np.arange(0, 30, 0.01)
    _, accel = imu(time, *rocking(time, omega=5.0, zeta=0.02, amplitude=0.6), arm=(0.0, 0.0, -0.15))
    accel = accel + np.random.default_rng(3).normal(0, 0.02, accel.shape)
    path = write_csv(tmp_path / "log.csv", ("t_s", "ax", "ay", "az"), time, *accel.T)
    ratio = fit_decay(find_releases(read_roll(path))).numbers.damping_ratio
    assert abs(ratio.value - 0.02) < 4 * ratio.std


# The offset of a rate gyro: from rest, never from a slow swing that seems to stand still, and from the part that counts.

LONG = np.arange(0, 40, 1 / 200)
BIAS = -0.001
PACE = 2 * np.pi / 4.0


def slow_swing(phase, seed=0):
    """Rate of a swing of 4 s that is in full swing from the first sample to the last."""
    swing = np.exp(-0.03 * LONG) * np.cos(PACE * LONG + phase)
    return swing + BIAS + np.random.default_rng(seed).normal(0, 0.01, len(LONG))


def offset_of(path, **options):
    roll = read_roll(path, LogOptions(**options))
    return float(next(note for note in roll.notes if note.startswith("offset: ")).split()[1])


@pytest.mark.parametrize("phase", np.arange(0, 2 * np.pi, np.pi / 2))
def test_a_slow_swing_is_no_rest(tmp_path, phase):
    path = write_csv(tmp_path / "log.csv", ("t_s", "gyro_x_rad_s"), LONG, slow_swing(phase))
    assert offset_of(path) == pytest.approx(BIAS, abs=0.005)


def test_an_offset_that_stays_is_not_said_to_drift(tmp_path):
    for seed in range(10):
        path = write_csv(tmp_path / f"{seed}.csv", ("t_s", "gyro_x_rad_s"), LONG, slow_swing(0.0, seed))
        assert not any("drifting" in note for note in read_roll(path).notes)


def test_what_is_cut_off_says_nothing_of_the_offset(tmp_path):
    """After 20 s somebody turns the board slowly for good; --to leaves that out."""
    rate = np.where(LONG < 20, np.exp(-0.5 * LONG) * np.sin(10 * LONG), 0.4)
    rate = rate + BIAS + np.random.default_rng(0).normal(0, 0.003, len(LONG))
    path = write_csv(tmp_path / "log.csv", ("t_s", "gyro_x_rad_s"), LONG, rate)
    assert offset_of(path, stop=19.0) == pytest.approx(BIAS, abs=3e-4)
    assert read_roll(path, LogOptions(stop=19.0)).time[-1] == pytest.approx(LONG[-1])
