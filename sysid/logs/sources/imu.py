"""Roll from accelerometer and gyro together: gravity gives the angle, the gyro its changes."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.logs.sources.axis import ONE_AXIS, RollAxis, angle_about, find_roll_axis
from sysid.logs.sources.gyro import find_rest, rate_scale, roll_from_rate
from sysid.logs.sources.registry import Reading, Source
from sysid.logs.table.choose import Choice, chosen, triple
from sysid.logs.table.names import ACCEL_UNITS, Column
from sysid.logs.table.options import LogOptions
from sysid.logs.table.remarks import Remarks, note, warning
from sysid.noise.sensor import estimate_noise, saturated
from sysid.quantity import Z95
from sysid.roll import Array, Roll

if TYPE_CHECKING:
    from sysid.logs.sources.gravity_smoother import Gravity

STANDARD_GRAVITY = ACCEL_UNITS["g"]


def find_imu(columns: Sequence[Column], axis: str, sign: float) -> list[Choice]:
    """Return the three rates of a gyro and the three accelerations beside it."""
    gyro, accel = triple(columns, "rate", "xyz"), triple(columns, "accel", "xyz")
    if gyro is None or accel is None:
        return []
    how = f"from gyro '{gyro[0].name}'... and accelerometer '{accel[0].name}'..., smoothed together"
    return [chosen((*gyro, *accel), axis, sign, how, accel_unit=accel[0].unit)]


def roll_from_imu(reading: Reading) -> Roll:
    """Return roll from six columns; from the gyro alone where the accelerometer tells nothing of it.

    Raises:
        SysidError: The record is too short for it.
    """
    choice, time, options = reading.choice, reading.time, reading.options
    columns = np.stack(reading.signals, axis=1)
    accel, remarks = accel_in_si(columns[:, 3:], choice)
    scale, how = imu_rate_scale(time, columns[:, :3], accel, choice)
    rates = columns[:, :3] * scale
    axis = find_roll_axis(rates, choice)
    remarks += how + axis.remarks
    if accel is None:
        return roll_from_rate(reading, rates @ axis.vector, remarks)
    gravity = _gravity(time, rates, accel, axis, options)
    if gravity.lever_arm is not None:
        arm = ", ".join(f"{100 * value:.1f}" for value in gravity.lever_arm)
        known = "given" if options.lever_arm else "estimated"
        remarks += note("accelerometer", f"sits ({arm}) cm from the axis of rotation, {known}")
    about = angle_about(axis.vector, gravity.up)
    if about is None:
        remarks += warning("the roll axis stands upright, where gravity tells no roll: gyro alone")
        return roll_from_rate(reading, rates @ axis.vector, remarks)
    roll, zero = about
    noise = estimate_noise(gravity.rate @ axis.vector).std
    offset = ", ".join(f"{value:.2g}" for value in gravity.offset)
    remarks += zero + _saturation(choice, columns)
    remarks += note("offset", f"({offset}) rad/s of the gyro")
    remarks += note("noise", f"{noise:.2g} rad/s of the gyro")
    std, rate_std = (
        np.maximum(gravity.std, noise * float(np.median(np.diff(time)))),
        np.full(roll.size, noise),
    )
    scale_std = gravity.scale_std(axis.vector)
    remarks += note(
        "scale",
        f"of roll and rate, good to {100 * Z95 * scale_std:.1f} % (95 %): as well as gravity tells the gyro's gain",
    )
    rate = gravity.rate @ axis.vector
    return reading.as_roll(
        roll, std, "imu", remarks, zero="drifting", rate=rate, rate_std=rate_std, scale_std=scale_std
    )


def _gravity(time: Array, rates: Array, accel: Array, axis: RollAxis, options: LogOptions) -> "Gravity":
    """Smooth the direction of gravity, from the gyro's offset at rest where the log begins with one."""
    from sysid.logs.sources.gravity_smoother import smooth_gravity

    noise = float(np.mean([estimate_noise(rates[:, k]).std for k in range(3)]))
    about = rates @ axis.vector
    rest = find_rest(time, about, estimate_noise(about).std, 1)
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


def accel_in_si(accel: Array, choice: Choice) -> tuple[Array | None, Remarks]:
    """Return the accelerations [m/s²], shape (n, 3); None where they hold no gravity."""
    norm, remarks = float(np.median(np.linalg.norm(accel, axis=1))), Remarks()
    if choice.accel_unit is not None:
        scale = ACCEL_UNITS[choice.accel_unit]
    else:
        usual = 0.8 * STANDARD_GRAVITY, 1.25 * STANDARD_GRAVITY
        known = {unit: size for unit, size in ACCEL_UNITS.items() if usual[0] < norm * size < usual[1]}
        scale = next(iter(known.values()), STANDARD_GRAVITY / norm if norm > 100 else 1.0)
        unit = next(iter(known), f"counts of {scale:.3g} m/s²")
        remarks += note("accelerometer", f"in {unit}, because they rest at {norm:.4g}")
    if not 0.7 < norm * scale / STANDARD_GRAVITY < 1.4:
        remarks += warning(
            f"'{choice.columns[3]}' holds no gravity (it rests at {norm * scale:.2g} m/s²): gyro alone. "
            "Record the accelerometer with gravity"
        )
        return None, remarks
    return accel * scale, remarks


def _saturation(choice: Choice, columns: Array) -> Remarks:
    remarks = Remarks()
    for name, column in zip(choice.columns, columns.T, strict=True):
        excess = saturated(column, estimate_noise(column))
        if excess is not None:
            remarks += warning(
                f"'{name}' is saturated in {np.count_nonzero(excess)} samples (up to {np.abs(column).max():.4g}): "
                "angles after them are off, use a range that is wide enough"
            )
    return remarks


def imu_rate_scale(time: Array, rates: Array, accel: Array | None, choice: Choice) -> tuple[float, Remarks]:
    """Return rad/s per unit of the rates, shape (n, 3), and how that is known; gravity tells where names do not."""
    if choice.scale is None and choice.unit is None and accel is not None:
        from sysid.logs.sources.gyro_unit import scale_by_gravity

        found = scale_by_gravity(time, rates, accel)
        if found is not None:
            return found
    return rate_scale(rates, choice)


SOURCE = Source(name="imu", order=1, quantity="rate", find=find_imu, to_roll=roll_from_imu, moving=3)
