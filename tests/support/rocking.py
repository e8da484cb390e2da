"""A rocking deck in closed form, and files of it: what the tests of the log readers read back."""

from pathlib import Path

import numpy as np

OMEGA, ZETA = 2 * np.pi * 4.0, 0.05


def rocking(time, *, amplitude=0.3, rest=0.02, release=1.0, omega=OMEGA, zeta=ZETA):
    """Roll, rate and angular acceleration of a deck held at `rest + amplitude` until `release`."""
    t = np.maximum(time - release, 0.0)
    damped = omega * np.sqrt(1 - zeta**2)
    envelope = amplitude * np.exp(-zeta * omega * t)
    phase = damped * t
    ratio = zeta / np.sqrt(1 - zeta**2)
    free = time > release
    roll = rest + np.where(free, envelope * (np.cos(phase) + ratio * np.sin(phase)), amplitude)
    rate = np.where(free, -envelope * omega / np.sqrt(1 - zeta**2) * np.sin(phase), 0.0)
    acceleration = np.where(free, -(omega**2) * (roll - rest) - 2 * zeta * omega * rate, 0.0)
    return roll, rate, acceleration


def imu(time, roll, rate, acceleration, *, arm=(0.0, 0.0, 0.0), mount=None, yaw_axis=False):
    """Gyro [rad/s] and accelerometer [m/s²] of a sensor on a deck that turns about +x; `mount` turns the sensor."""
    n = len(time)
    gyro = np.zeros((n, 3))
    gyro[:, 0] = rate
    turn = np.zeros((n, 3))
    turn[:, 0] = acceleration
    r = np.broadcast_to(np.asarray(arm, dtype=float), (n, 3))
    up = np.stack((np.zeros(n), np.sin(roll), np.cos(roll)), axis=1)
    accel = 9.81 * up + np.cross(turn, r) + np.cross(gyro, np.cross(gyro, r))
    if mount is not None:
        gyro, accel = gyro @ mount, accel @ mount
    return gyro, accel


def write_csv(path: Path, header, *columns, sep=",", decimal=".", form="%.9g", newline="\n"):
    """Write columns as text."""
    rows = [sep.join(header)] if header else []
    for row in zip(*columns, strict=True):
        cells = [item if isinstance(item, str) else form % item for item in row]
        rows.append(sep.join(cell.replace(".", decimal) if decimal != "." else cell for cell in cells))
    path.write_text(newline.join(rows) + newline, encoding="utf-8")
    return path


TIME = np.arange(0, 6, 0.01)
MOTION = rocking(TIME)
"""Roll, rate and acceleration of the decay that files in all formats hold."""
_NOISE = np.random.default_rng(0)
ROLL = MOTION[0] + _NOISE.normal(0, 5e-4, len(TIME))
GYRO, ACCEL = (sensor + _NOISE.normal(0, 0.01, sensor.shape) for sensor in imu(TIME, *MOTION))


def right(path, *, swing=MOTION[0], **options):
    """Read a log: frequency, damping and size of its swing are those of the decay. Return the roll."""
    from sysid.free_decay import fit_decay
    from sysid.logs import LogOptions, read_roll
    from sysid.releases import find_releases

    roll = read_roll(path, LogOptions(**options))
    numbers = fit_decay(find_releases(roll)).numbers
    assert abs(numbers.omega_n.value / OMEGA - 1) < 3e-3
    assert abs(numbers.damping_ratio.value / ZETA - 1) < 0.06
    assert abs(np.ptp(roll.roll) / np.ptp(swing) - 1) < 0.04
    return roll
