"""The readings of a sensor, and the files of loggers."""

import io
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np

from sysid.errors import SysidError
from sysid.files import write_atomically
from sysid.quantity import GRAVITY
from sysid.roll import Array

Dialect = Literal["angle", "angle-deg", "position", "gyro", "imu", "phyphox", "sensor-logger"]
"""Channels and format of a log: an angle in rad or in degrees, a slide's position, a roll rate, or six IMU channels. These are in
a CSV, a phyphox or a Sensor Logger export."""
ANGLES: tuple[Dialect, ...] = ("angle", "angle-deg", "position")
"""Dialects with the position of the joint."""
_DAY = datetime(2026, 1, 1, tzinfo=UTC)
"""Date of all archives: the same log is the same file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """The measuring chain; everything zero is a perfect sensor."""

    noise: float = 0.0
    """White noise of an angle sensor [rad]."""
    quantisation: float = 0.0
    """Step of an angle sensor [rad]."""
    lever_arm: tuple[float, float, float] = (0.1, 0.03, 0.05)
    """Place of an IMU on the deck, from the tilt axis: forward, left, up [m]."""
    gyro_bias: float = 0.01
    """Offset of the roll rate of an IMU [rad/s]; the other two axes get fractions of it."""
    gyro_noise: float = 0.003
    """White noise of a gyro sample [rad/s]."""
    accelerometer_noise: float = 0.03
    """White noise of an accelerometer sample [m/s^2]."""
    bias: float = 0.0
    """Constant error of the angle; of an IMU, its mounting about the roll axis [rad]."""
    drift: float = 0.0
    """Growing error of the angle; of an IMU, additional offset of the roll rate [rad/s]."""
    time_constant: float = 0.0
    """First-order lag of every channel [s]."""
    clock: float = 1.0
    """Measured seconds in one true second."""


def measure(time: Array, motion: Array, sensor: Sensor, dialect: Dialect, rng: np.random.Generator) -> Array:
    """Return the readings of the channels.

    Args:
        time: True time [s], shape (n,).
        motion: True roll, rate and acceleration, shape (n, 3).

    Returns:
        Angle [rad] or position [m] for a dialect of `ANGLES`, roll rate [rad/s] for 'gyro', shape (n, 1). Else accelerations
        x, y, z [m/s^2] and rates x, y, z [rad/s], shape (n, 6).
    """
    roll, rate, acceleration = motion.T
    if dialect in ANGLES:
        angle = lowpass(time, roll, rate, sensor.time_constant) + sensor.bias + sensor.drift * time
        angle = angle + sensor.noise * rng.standard_normal(len(time))
        if sensor.quantisation > 0:
            angle = sensor.quantisation * np.round(angle / sensor.quantisation)
        return angle[:, None]
    roll_rate = lowpass(time, rate, acceleration, sensor.time_constant) + sensor.gyro_bias + sensor.drift
    if dialect == "gyro":
        return (roll_rate + sensor.gyro_noise * rng.standard_normal(len(time)))[:, None]
    force = _specific_force(roll, rate, acceleration, sensor)
    for axis in range(3):
        force[:, axis] = lowpass(
            time, force[:, axis], np.gradient(force[:, axis], time), sensor.time_constant
        )
    force += sensor.accelerometer_noise * rng.standard_normal(force.shape)
    still = np.zeros_like(roll_rate)
    rates = np.column_stack((roll_rate, still - 0.4 * sensor.gyro_bias, still + 0.7 * sensor.gyro_bias))
    rates += sensor.gyro_noise * rng.standard_normal(rates.shape)
    return np.hstack((force, rates))


def _specific_force(roll: Array, rate: Array, acceleration: Array, sensor: Sensor) -> Array:
    """Return the specific force on the deck [m/s^2], shape (n, 3): gravity, tangential, centripetal."""
    _, left, up = sensor.lever_arm
    y = GRAVITY.value * np.sin(roll) - acceleration * up - rate**2 * left
    z = GRAVITY.value * np.cos(roll) + acceleration * left - rate**2 * up
    c, s = math.cos(sensor.bias), math.sin(sensor.bias)
    return np.column_stack((np.zeros_like(roll), c * y + s * z, c * z - s * y))


def lowpass(time: Array, signal: Array, slope: Array, time_constant: float) -> Array:
    """Return the output of τ ẏ = x − y, settled at the start; exact for x cubic between samples.

    Times [s], input x in any unit and its derivative are of shape (n,).
    """
    if time_constant == 0:
        return signal
    tau, h = time_constant, np.diff(time)
    rise = (signal[1:] - signal[:-1]) / h
    # Second derivatives at both ends of each interval, and the constant third, of the Hermite cubic.
    left = (6 * rise - 4 * slope[:-1] - 2 * slope[1:]) / h
    right = (2 * slope[:-1] + 4 * slope[1:] - 6 * rise) / h
    third = (right - left) / h
    settled_left = signal[:-1] - tau * slope[:-1] + tau**2 * left - tau**3 * third
    settled_right = signal[1:] - tau * slope[1:] + tau**2 * right - tau**3 * third
    forget = np.exp(-h / tau)
    gain = settled_right - forget * settled_left
    output, value = [float(signal[0])], float(signal[0])
    for keep, add in zip(forget.tolist(), gain.tolist(), strict=True):
        value = keep * value + add
        output.append(value)
    return np.array(output)


def write_log(path: Path, time: Array, channels: Array, dialect: Dialect) -> None:
    """Write a log as the named logger would.

    Args:
        time: Stamps of the logger [s], shape (n,).
        channels: The result of `measure` [rad, rad/s, m/s^2], shape (n, 1) or (n, 6).

    Raises:
        SysidError: The file name does not go with the dialect, or cannot be written.
    """
    zipped = path.suffix == ".zip"
    if dialect == "sensor-logger" and not zipped:
        raise SysidError(f"{path}: Sensor Logger exports an archive; name the log {path.stem}.zip.")
    if zipped and dialect not in ("phyphox", "sensor-logger"):
        raise SysidError(f"{path}: only the dialects phyphox and sensor-logger are archives; name it .csv.")
    if dialect == "angle-deg":
        time, channels = 1e3 * time, np.degrees(channels)
    write_atomically(
        path, _archive(time, channels, dialect) if zipped else _csv(*_TABLES[dialect], time, channels)
    )


_TIME = '"Time (s)"'
_ACCELERATION = ",".join(f'"Acceleration {axis} (m/s^2)"' for axis in "xyz")
_ROTATION = ",".join(f'"Gyroscope {axis} (rad/s)"' for axis in "xyz")
"""Columns of phyphox."""
_TABLES = {
    "angle": ("time_s,roll_rad", "%.6f,%.8f"),
    "angle-deg": ("time_ms,roll_deg", "%.3f,%.6f"),
    "position": ("time_s,position_m", "%.6f,%.9f"),
    "gyro": ("time_s,gyro_x_rad_s", "%.6f,%.7f"),
    "imu": (",".join(("time_s", *(f"acc_{a}_m_s2" for a in "xyz"), *(f"gyro_{a}_rad_s" for a in "xyz"))),
            "%.6f,%.5f,%.5f,%.5f,%.6f,%.6f,%.6f"),
    "phyphox": (f"{_TIME},{_ACCELERATION},{_ROTATION}", "%.9E,%.6E,%.6E,%.6E,%.6E,%.6E,%.6E"),
}  # fmt: skip
"""Header and formats of each dialect as one table."""


def _archived_tables(time: Array, channels: Array, dialect: Dialect) -> Mapping[str, str]:
    acceleration, rates = channels[:, :3], channels[:, 3:]
    if dialect == "phyphox":
        formats = ",".join(["%.9E"] * 4)
        return {
            "Accelerometer.csv": _csv(f"{_TIME},{_ACCELERATION}", formats, time, acceleration),
            "Gyroscope.csv": _csv(f"{_TIME},{_ROTATION}", formats, time, rates),
        }
    stamps = (int(_DAY.timestamp()) * 10**9 + np.round(1e9 * time).astype(np.int64)).astype(np.str_)
    tables: dict[str, str] = {}
    for name, values in (("TotalAcceleration", acceleration), ("Gyroscope", rates)):
        body = _csv("seconds_elapsed,z,y,x", ",".join(["%.7f"] * 4), time, values[:, ::-1]).splitlines()
        lines = [f"{stamp},{line}" for stamp, line in zip(["time", *stamps.tolist()], body, strict=True)]
        tables[f"{name}.csv"] = "\n".join(lines) + "\n"
    return tables


def _csv(header: str, formats: str, time: Array, channels: Array) -> str:
    buffer = io.StringIO()
    np.savetxt(buffer, np.column_stack((time, channels)), fmt=formats, header=header, comments="")
    return buffer.getvalue()


def _archive(time: Array, channels: Array, dialect: Dialect) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in _archived_tables(time, channels, dialect).items():
            archive.writestr(zipfile.ZipInfo(name, _DAY.timetuple()[:6]), text, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()
