"""Roll from an inertial sensor: gyro alone, gyro and accelerometer, or an orientation quaternion."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.errors import HuskyError
from sysid.logs.sources.gyro import find_rest, roll_from_rate
from sysid.logs.sources.rotations import quaternion_matrices, rotation_angles
from sysid.logs.table.choose import Choice
from sysid.logs.table.clock import Clock
from sysid.logs.table.names import ACCEL_UNITS, RATE_UNITS
from sysid.noise.sensor import estimate_noise, saturated
from sysid.roll import Array, Roll

if TYPE_CHECKING:
    from sysid.logs import LogOptions
    from sysid.logs.sources.gravity_smoother import Gravity

STANDARD_GRAVITY = ACCEL_UNITS["g"]
ONE_AXIS = 0.8
"""Share of the rotation about one axis from which on a motion counts as one-axis."""
UPRIGHT = 0.8
"""Cosine between roll axis and vertical beyond which gravity tells too little of roll."""

MAX_RATE = 35.0
"""No common gyro measures more than 2000 °/s = 34.9 rad/s: larger numbers are degrees."""


def roll_from_imu(
    path: Path, choice: Choice, clock: Clock, data: dict[str, Array], options: "LogOptions"
) -> Roll:
    """Return roll from the chosen columns of an inertial sensor.

    Raises:
        HuskyError: The record is too short for it.
    """
    columns = np.stack([data[name] for name in choice.columns], axis=1)
    if choice.source == "quaternion":
        return _roll_from_quaternion(path, choice, clock, columns)
    rates = columns[:, :3]
    accel = accel_in_si(columns[:, 3:], choice) if choice.source == "imu" else None
    rates = rates * rate_scale(clock.time, rates, accel, choice)
    if rates.shape[1] == 1:
        return roll_from_rate(path, choice, clock, rates[:, 0] * choice.sign)
    axis = find_roll_axis(clock.time, rates, choice)
    gravity = None if accel is None else _gravity(clock.time, rates, accel, axis, options)
    if gravity is None:
        return roll_from_rate(path, choice, clock, rates @ axis.vector)
    if gravity.lever_arm is not None:
        arm = ", ".join(f"{100 * value:.1f}" for value in gravity.lever_arm)
        known = "given" if options.lever_arm else "estimated"
        choice.notes.append(f"accelerometer sits ({arm}) cm from the axis of rotation, {known}")
    roll = angle_about(axis.vector, gravity.up, choice)
    if roll is None:
        choice.warnings.append("the roll axis stands upright, where gravity tells no roll: gyro alone")
        return roll_from_rate(path, choice, clock, rates @ axis.vector)
    noise = estimate_noise(gravity.rate @ axis.vector).std
    offset = ", ".join(f"{value:.2g}" for value in gravity.offset)
    _warn_of_saturation(choice, columns)
    return Roll(
        log=str(path),
        time=clock.time,
        roll=roll,
        std=np.maximum(gravity.std, noise * float(np.median(np.diff(clock.time)))),
        origin="imu",
        rate=gravity.rate @ axis.vector,
        rate_std=np.full(roll.size, noise),
        notes=(f"gyro offset ({offset}) rad/s, gyro noise {noise:.2g} rad/s",),
        warnings=(*clock.warnings, *choice.warnings),
    )


def _gravity(
    time: Array, rates: Array, accel: Array, axis: "RollAxis", options: "LogOptions"
) -> "Gravity | None":
    from sysid.logs.sources.gravity_smoother import smooth_gravity

    noise = float(np.mean([estimate_noise(rates[:, k]).std for k in range(3)]))
    rest = find_rest(time, rates @ axis.vector, estimate_noise(rates @ axis.vector).std, 1)
    return smooth_gravity(
        time,
        rates,
        accel,
        offset=None if rest is None else rates[rest].mean(axis=0),
        offset_std=0.1 if rest is None else 2e-3,
        rate_noise=noise,
        lever_arm=None if options.lever_arm is None else np.array(options.lever_arm),
        find_lever_arm=axis.share > ONE_AXIS,
    )


def _roll_from_quaternion(path: Path, choice: Choice, clock: Clock, quaternion: Array) -> Roll:
    """Return the swing of an orientation about its roll axis; the orientation turns sensor into earth axes."""
    norm = np.linalg.norm(quaternion, axis=1)
    if not np.all(np.abs(norm - 1) < 0.1):
        raise HuskyError(
            f"{', '.join(map(repr, choice.columns))}: {np.count_nonzero(np.abs(norm - 1) >= 0.1)} rows are no "
            "orientation (their norm is not 1). Is the order w, x, y, z and the file whole?"
        )
    attitude = quaternion_matrices(quaternion)
    turned = rotation_angles(attitude[:-1].transpose(0, 2, 1) @ attitude[1:])
    rates = turned / np.diff(clock.time)[:, None]
    rates = np.concatenate((rates[:1], 0.5 * (rates[1:] + rates[:-1]), rates[-1:]))
    axis = find_roll_axis(clock.time, rates, choice)
    roll = angle_about(axis.vector, attitude[:, 2, :], choice)
    if roll is None:  # the axis stands upright: the sum of the turns is all there is
        roll = np.concatenate(([0.0], np.cumsum(turned @ axis.vector)))
        choice.notes.append("the roll axis stands upright: roll is counted from the first sample")
    noise = estimate_noise(roll)
    return Roll(
        log=str(path),
        time=clock.time,
        roll=roll,
        std=np.full(roll.size, noise.std),
        origin="quaternion",
        notes=(f"noise {np.rad2deg(noise.std):.3g}° from the signal itself",),
        warnings=(*clock.warnings, *choice.warnings),
    )


@dataclass(frozen=True, slots=True)
class RollAxis:
    """The axis that the deck turns about, in sensor axes."""

    vector: Array
    """Unit vector forward, shape (3,)."""
    share: float
    """Share of the squared rotation rate that is about it, 0 to 1."""


def find_roll_axis(time: Array, rates: Array, choice: Choice) -> RollAxis:
    """Return the user's axis, or the one that the sensor turns about most; its largest component is positive.

    Args:
        time: Time [s], shape (n,).
        rates: Rotation rates in sensor axes [rad/s], shape (n, 3).
        choice: Gets notes and warnings; its axis and sign count.
    """
    free = rates - np.median(rates, axis=0)
    moments, axes = np.linalg.eigh(free.T @ free)
    if choice.axis:
        vector = np.eye(3)["xyz".index(choice.axis)]
        share = float(np.sum((free @ vector) ** 2) / max(moments.sum(), 1e-30))
        choice.notes.append(
            f"roll about the sensor's {'-' if choice.sign < 0 else '+'}{choice.axis}, as --axis says"
        )
    else:
        vector = axes[:, -1] * np.sign(axes[np.argmax(np.abs(axes[:, -1])), -1])
        share = float(moments[-1] / max(moments.sum(), 1e-30))
        main = "xyz"[int(np.argmax(np.abs(vector)))]
        shown = ", ".join(f"{value:.2f}" for value in vector)
        choice.notes.append(
            f"roll about ({shown}) of the sensor, {100 * share:.0f} % of its rotation, taken as forward; "
            f"--axis -{main} if the sensor's {main} points backward"
        )
    if share < ONE_AXIS:
        choice.warnings.append(
            f"the sensor turns about several axes (only {100 * share:.0f} % about the roll axis): not a one-axis motion"
        )
    return RollAxis(vector * choice.sign, share)


def angle_about(axis: Array, up: Array, choice: Choice) -> Array | None:
    """Return the roll about an axis from the vertical in sensor axes, shape (n,); None if the axis is upright.

    Roll is zero where the sensor axis that is nearest to the vertical points along it, as seen along the roll
    axis: a sensor that lies flat reads the true roll, whichever of its faces is up.
    """
    mean = up.mean(axis=0)
    if np.median(np.abs(up @ axis)) > UPRIGHT:
        return None
    square = np.eye(3) - np.outer(axis, axis)
    facing = (square @ mean) / np.linalg.norm(square, axis=0).clip(1e-9)
    facing[np.linalg.norm(square, axis=0) < 0.5] = 0.0  # nearly along the roll axis
    nearest = int(np.argmax(np.abs(facing)))
    sign = 1.0 if facing[nearest] >= 0 else -1.0
    top = square[:, nearest] * sign
    top /= np.linalg.norm(top)
    left = np.cross(top, axis)
    choice.notes.append(
        f"roll is zero where the sensor's {'+' if sign > 0 else '-'}{'xyz'[nearest]} points up"
    )
    return np.unwrap(np.arctan2(up @ left, up @ top))


def accel_in_si(accel: Array, choice: Choice) -> Array | None:
    """Return the accelerations in m/s²; None, with a warning, where they hold no gravity."""
    norm = float(np.median(np.linalg.norm(accel, axis=1)))
    if choice.accel_unit is not None:
        scale = ACCEL_UNITS[choice.accel_unit]
    else:
        known = {
            unit: size for unit, size in ACCEL_UNITS.items() if 0.8 < norm * size / STANDARD_GRAVITY < 1.25
        }
        scale = next(iter(known.values()), STANDARD_GRAVITY / norm if norm > 100 else 1.0)
        unit = next(iter(known), f"counts of {scale:.3g} m/s²")
        choice.notes.append(f"accelerations in {unit}, because they rest at {norm:.4g}")
    if not 0.7 < norm * scale / STANDARD_GRAVITY < 1.4:
        choice.warnings.append(
            f"'{choice.columns[3]}' holds no gravity (it rests at {norm * scale:.2g} m/s²): gyro alone. "
            "Record the accelerometer with gravity"
        )
        return None
    return accel * scale


def _warn_of_saturation(choice: Choice, columns: Array) -> None:
    for name, column in zip(choice.columns, columns.T, strict=True):
        excess = saturated(column, estimate_noise(column))
        if excess is not None:
            count = np.count_nonzero(excess)
            choice.warnings.append(
                f"'{name}' is saturated in {count} samples (up to {np.abs(column).max():.4g}): "
                "angles after them are off, use a range that is wide enough"
            )


def rate_scale(time: Array, rates: Array, accel: Array | None, choice: Choice) -> float:
    """Return rad/s per unit of the rates, shape (n, m), adding to the choice's notes how that is known."""
    if choice.scale is not None:
        choice.notes.append(f"one count is {choice.scale:g} rad/s, as --unit says")
        return choice.scale
    if choice.unit is not None:
        return RATE_UNITS[choice.unit]
    if accel is not None and (unit := _unit_by_gravity(time, rates, accel)) is not None:
        choice.notes.append(f"rates in {unit}, because so they turn the accelerometer's vertical")
        return RATE_UNITS[unit]
    largest = float(np.abs(rates).max())
    unit = "deg/s" if largest > MAX_RATE else "rad/s"
    choice.warnings.append(
        f"'{choice.columns[0]}' names no unit; taken as {unit}, because it reaches {largest:.3g}. "
        "That can be wrong: say it with --unit"
    )
    return RATE_UNITS[unit]


def _unit_by_gravity(time: Array, rates: Array, accel: Array) -> str | None:
    """Return the unit in which the rates turn gravity as the accelerometer sees it: g' = -ω × g."""
    period = float(np.median(np.diff(time)))
    found = 0.0
    for seconds in (
        0.2,
        0.02,
    ):  # slow motions drown in noise over short blocks, fast ones average out over long ones
        size = max(1, round(seconds / period))
        count = time.size // size
        if count < 8:
            continue
        mean_rate, mean_accel = (
            values[: count * size].reshape(count, size, 3).mean(axis=1)
            for values in (rates - np.median(rates, axis=0), accel)
        )
        change = np.diff(mean_accel, axis=0) / (size * period)
        turned = np.cross(0.5 * (mean_accel[1:] + mean_accel[:-1]), 0.5 * (mean_rate[1:] + mean_rate[:-1]))
        agreement = float(np.sum(change * turned))
        if agreement > 0.3 * np.linalg.norm(change) * np.linalg.norm(turned) > 0:
            found = agreement / float(np.sum(turned**2))
            break
    if not found:
        return None
    unit = min(RATE_UNITS, key=lambda name: abs(np.log(RATE_UNITS[name] / found)))
    return unit if abs(np.log(RATE_UNITS[unit] / found)) < np.log(2) else None
