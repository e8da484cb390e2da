"""Roll from accelerometer and gyro together, or from the accelerometer alone; see `sysid.logs.sources.swing_smoother`."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from sysid.errors import SysidError
from sysid.logs.sources.axis import Plane, find_roll_axis, plane_about
from sysid.logs.sources.gyro import half_cycle, rate_scale, roll_from_rate
from sysid.logs.sources.registry import Reading, Source
from sysid.logs.sources.swing_smoother import (
    ARM_STD,
    EDGES,
    PER_SWING,
    Blocks,
    Swing,
    block_means,
    smooth_swing,
)  # fmt: skip
from sysid.logs.table.choose import Choice, chosen, triple
from sysid.logs.table.names import ACCEL_UNITS, RATE_UNITS, Column
from sysid.logs.table.noise import noise_of
from sysid.logs.table.remarks import Remarks, note, warning
from sysid.noise.sensor import estimate_noise, saturated
from sysid.quantity import Z95
from sysid.roll import Array, Roll

TRIAD_UNITS = ("rad/s", "deg/s", "mrad/s", "mdeg/s")
"""Units of three-axis gyros; a speed in rpm is a wheel's."""
LASTING = 2.0
"""Periods for which the strength of accelerations beside gravity stays about the same: a hand's touch, or a release."""
CONSISTENT = 0.25
"""Share by which a scale may be uncertain before a log counts as without one [1]."""


def find_imu(columns: Sequence[Column], axis: str, sign: float) -> list[Choice]:
    """Return the three rates of a gyro and the three accelerations beside it."""
    gyro, accel = triple(columns, "rate", "xyz"), triple(columns, "accel", "xyz")
    if gyro is None or accel is None:
        return []
    how = f"from gyro '{gyro[0].name}'... and accelerometer '{accel[0].name}'..., smoothed together"
    return [chosen((*gyro, *accel), axis, sign, how, accel_unit=accel[0].unit)]


def find_accelerometer(columns: Sequence[Column], axis: str, sign: float) -> list[Choice]:
    """Return the three accelerations of a log without a gyro."""
    accel = triple(columns, "accel", "xyz")
    if accel is None:
        return []
    how = f"from accelerometer '{accel[0].name}'... of a swing"
    return [replace(chosen(accel, axis, sign, how, accel_unit=accel[0].unit), unit=None)]


def roll_from_imu(reading: Reading) -> Roll:
    """Return roll from six columns; from the gyro alone where the accelerometer tells nothing of it."""
    choice, time = reading.choice, reading.time
    columns = np.stack(reading.signals, axis=1)
    accel, remarks = accel_in_si(columns[:, 3:], choice)
    silent = choice.unit is None and choice.scale is None
    gyro = columns[:, :3]
    axis, how_axis = find_roll_axis(gyro, choice)
    plane = None if accel is None else plane_about(axis, accel)
    if silent and accel is not None and plane is not None:
        counts = bool(np.all(gyro == np.rint(gyro)))
        scale, how = _scale_by_gravity(time, gyro @ axis, plane.of(accel), choice, counts=counts)
    else:
        scale, how = rate_scale(gyro, choice)
    remarks += how + how_axis
    about = scale * (gyro @ axis)
    if accel is None or plane is None:
        if accel is not None:
            remarks += warning("the roll axis stands upright, where gravity tells no roll: gyro alone")
        return roll_from_rate(reading, about, remarks)
    remarks += _saturation(choice, columns)
    swing, blocks = _smoothed(reading, about, plane.of(accel), plane)
    rate = swing.gain * about - swing.offset
    steps = np.diff(time)
    whole = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * steps)))
    beside = swing.angle - np.interp(blocks.edges, time, whole)
    roll = whole + np.interp(time, blocks.edges, beside)
    noise, step = noise_of(time, rate).std, float(np.median(steps))
    share = np.sqrt(float(np.median(np.diff(blocks.edges))) / step)
    felt = share * float(np.median(blocks.accel_std))
    omega = np.pi / (step * max(half_cycle(rate), 1.0))
    tilt = abs(swing.gravity + omega**2 * swing.arm)
    by_gyro = omega * felt > tilt * noise
    # A release lies anywhere between two samples: the integral across that kink is off by up to (ω dt)²/8 of the angle.
    scale_std = float(np.hypot(swing.std[1], (omega * step) ** 2 / 8))
    given = reading.options.lever_arm is not None
    if given or abs(swing.arm) > Z95 * float(np.hypot(*swing.std[3:])) > 0:
        remarks += _arm_note(swing, plane, given=given)
    remarks += plane.zero
    remarks += note("offset", f"{swing.offset:.3g} rad/s ± {Z95 * swing.std[0]:.1g} of the gyro")
    remarks += note("noise", f"{noise:.2g} rad/s of the gyro, {felt:.2g} m/s² of the accelerometer")
    remarks += note(
        "scale",
        f"roll and rate ± {100 * Z95 * scale_std:.1f} % (95 %), calibrated by gravity",
    )
    # White errors of either sensor at the swing's frequency; where that sensor rules, they are those of the estimate.
    std = (
        np.sqrt(step * felt * noise / (2 * swing.gravity))
        if by_gyro
        else 1 / np.hypot(omega / noise, tilt / felt)
    )
    return reading.as_roll(
        roll, np.full(roll.size, max(std, noise * step)), "imu", remarks, zero="drifting", rate=rate,
        rate_std=np.full(roll.size, noise), measured="rate" if by_gyro else "roll", scale_std=scale_std,
    )  # fmt: skip


def _smoothed(
    reading: Reading, rate: Array, accel: npt.NDArray[np.complex128], plane: Plane
) -> tuple[Swing, Blocks]:
    """Smooth gyro and accelerometer; the residuals tell how strongly something shakes the sensor beside gravity.

    Args:
        reading: Its clock and options.
        rate: About the axis [rad/s], shape (n,).
        accel: Square to it [m/s²], shape (n,).
        plane: The axes of it.
    """
    from scipy.ndimage import gaussian_filter1d

    blocks = _blocks(reading.time, rate, accel)
    arm = _given_arm(reading, plane)
    angle, first = _start(blocks)
    swing = smooth_swing(blocks, angle, arm=arm, first=first)
    for _ in range(2):
        power = gaussian_filter1d(np.abs(swing.left) ** 2 / 2, LASTING * PER_SWING, mode="nearest")
        blocks = replace(blocks, accel_std=np.sqrt(np.maximum(power, 1e-12)))
        swing = smooth_swing(blocks, swing.angle, arm=arm, first=swing.arm)
    return swing, blocks


def _given_arm(reading: Reading, plane: Plane) -> complex | None:
    given = reading.options.lever_arm
    return None if given is None else complex(plane.of(np.array([given]))[0])


def _blocks(time: Array, rate: Array | None, accel: npt.NDArray[np.complex128]) -> Blocks:
    """Average the sensors over blocks of which the swing has `PER_SWING` in a period."""
    usual = float(np.median(np.diff(time)))
    period = 2 * usual * half_cycle(accel.imag if rate is None else rate)
    signals = [accel.real, accel.imag, *([] if rate is None else [rate])]
    edges, means = block_means(time, signals, max(period / PER_SWING, usual))
    share = np.sqrt(max(time.size / (len(edges) - 1), 1.0))
    noise = [max(noise_of(time, signal).std, 1e-9) / share for signal in signals]
    return Blocks(
        edges=edges, rate=None if rate is None else means[2], accel=means[0] + 1j * means[1], rate_std=noise[-1],
        accel_std=np.full(len(edges) - 1, np.hypot(*noise[:2]) / np.sqrt(2)),
    )  # fmt: skip


def _start(blocks: Blocks) -> tuple[Array, complex]:
    """Return a first guess of the angle and of the lever arm [m].

    The angle is the gyro's integral; with its course given, gravity, a slow drift and the lever arm are linear.
    """
    assert blocks.rate is not None
    edges, rate = blocks.edges, blocks.rate - np.median(blocks.rate)
    steps = np.diff(edges)
    whole = np.concatenate(([0.0], np.cumsum(rate * steps)))
    lever = -(1j * np.gradient(rate) / steps + rate**2)
    turned, since = np.exp(0.5j * (whole[1:] + whole[:-1])), 0.5 * (edges[1:] + edges[:-1]) - edges.mean()
    design = np.stack((turned, 1j * since * turned, lever), axis=1) / blocks.accel_std[:, None]
    design = np.vstack((design, [[0.0, 0.0, 1 / ARM_STD]]))
    found, *_ = np.linalg.lstsq(design, np.append(blocks.accel / blocks.accel_std, 0.0), rcond=None)
    drift = float((found[1] / found[0]).real)
    return whole + np.angle(found[0]) + drift * (edges - edges.mean()), complex(found[2])


def roll_from_accelerometer(reading: Reading) -> Roll:
    """Return the roll of a swing from three accelerations.

    Along the motion they feel g sin φ + r φ̈, which is proportional to φ in a swing. So frequency and damping need no
    lever arm r. The size of the swing does: accelerations along the arm tell it if the swing is wide.

    Raises:
        SysidError: They hold no gravity, or the axis is upright.
    """
    from scipy.interpolate import CubicSpline

    choice = reading.choice
    accel, remarks = accel_in_si(np.stack(reading.signals, axis=1), choice)
    mean = np.zeros(3) if accel is None else accel.mean(axis=0)
    if accel is None or not np.any(mean):
        raise SysidError(
            f"'{choice.columns[0]}'... hold no gravity, so they tell no roll. Record the gyro beside them, or the accelerometer "
            "with gravity."
        )
    mean = mean / np.linalg.norm(mean)
    beside = accel - accel.mean(axis=0)
    beside = beside - np.outer(beside @ mean, mean)
    axis = np.cross(np.linalg.eigh(beside.T @ beside)[1][:, -1], mean)
    axis = (
        np.eye(3)["xyz".index(choice.axis)] if choice.axis else axis * np.sign(axis[np.argmax(np.abs(axis))])
    )
    plane = plane_about(axis * choice.sign, accel)
    if plane is None:
        raise SysidError("the roll axis stands upright, where gravity tells no roll. Record a gyro.")
    given = _given_arm(reading, plane)
    blocks = _blocks(reading.time, None, plane.of(accel))
    swing, omega = _swung(blocks, given)
    tilt = swing.gravity + omega**2 * swing.arm.real
    scale_std = abs(omega**2 * float(swing.std[3]) / tilt)
    if scale_std < CONSISTENT:
        tilt = _size(blocks, swing)
        remarks += _arm_note(swing, plane, given=given is not None)
    else:
        tilt, scale_std = swing.gravity, 1.0
        remarks += warning(
            "nothing tells the lever arm from the axis to the accelerometer: frequency and damping are right, the size of the "
            "swing is unknown. Give it with --lever-arm"
        )
    shown = ", ".join(f"{value:.2f}" for value in axis * choice.sign)
    along = plane.of(accel).imag
    roll = along / tilt
    wide = roll if scale_std == 1 else CubicSpline(blocks.edges, swing.angle)(reading.time)
    roll = (along + swing.gravity * (wide - np.sin(wide))) / tilt
    std = noise_of(reading.time, along).std / abs(tilt)
    remarks += note("axis", f"({shown}) of the sensor, taken as forward") + plane.zero
    remarks += note("noise", f"{np.rad2deg(std):.2g}° from the whole signal")
    return reading.as_roll(
        roll, np.full(roll.size, std), "accelerometer", remarks, zero="constant", scale_std=scale_std
    )


def _arm_note(swing: Swing, plane: Plane, *, given: bool) -> Remarks:
    """Return where the accelerometer sits, in sensor axes."""
    arm = swing.arm.real * plane.top + swing.arm.imag * plane.left
    at = ", ".join(f"{100 * value + 0.0:.1f}" for value in np.round(arm, 3))
    how = "given" if given else f"± {100 * Z95 * float(np.hypot(*swing.std[3:])):.1g} cm, estimated"
    return note("accelerometer", f"sits ({at}) cm from the axis of rotation, {how}")


def _size(blocks: Blocks, swing: Swing) -> float:
    """Return the acceleration along the motion over the angle [m/s²].

    Both are taken over a quarter of a swing: a joint that is held, or at rest, adds nothing. The line through the origin with the
    least absolute residuals hardly notices the release itself, where the acceleration jumps.
    """
    angle = np.convolve(swing.angle, EDGES, "valid")
    along = blocks.accel.imag[2:-2] + swing.gravity * (angle - np.sin(angle))
    quarter = PER_SWING // 4
    turned, moved = (values[quarter:] - values[:-quarter] for values in (angle, along))
    ratio = moved / np.where(turned == 0, 1e-300, turned)
    order = np.argsort(ratio)
    weight = np.cumsum(np.abs(turned)[order])
    return float(ratio[order][np.searchsorted(weight, 0.5 * weight[-1])])


def _swung(blocks: Blocks, arm: complex | None) -> tuple[Swing, float]:
    """Smooth accelerations alone, and return the swing's angular frequency [rad/s] too.

    The search begins from swings that reach a radian, a third of it, and so on, of either sign: the lever arm [m] tells
    them apart.
    """
    along = blocks.accel.imag
    omega = np.pi / (float(np.median(np.diff(blocks.edges))) * max(half_cycle(along), 1.0))
    reach, found = float(np.percentile(np.abs(along - np.median(along)), 99)), list[Swing]()
    edges = np.interp(blocks.edges, 0.5 * (blocks.edges[1:] + blocks.edges[:-1]), along)
    for amplitude in np.outer((1.0, -1.0), 3.0 ** -np.arange(4)).ravel() if arm is None else [np.nan]:
        first = arm if arm is not None else complex((reach / amplitude - ACCEL_UNITS["g"]) / omega**2)
        start = edges / (ACCEL_UNITS["g"] + omega**2 * first.real)
        with np.errstate(all="ignore"):  # a start that leads nowhere
            swing = smooth_swing(blocks, start, arm=arm, first=first, stiff=0.1 * float(np.std(start)))
        found.append(swing if np.isfinite(swing.cost) else replace(swing, cost=np.inf))
    return min(found, key=lambda swing: swing.cost), omega


def accel_in_si(accel: Array, choice: Choice) -> tuple[Array | None, Remarks]:
    """Return the accelerations [m/s²], shape (n, 3); None where they hold no gravity."""
    norm, remarks = float(np.median(np.linalg.norm(accel, axis=1))), Remarks()
    if choice.accel_unit is not None:
        scale = ACCEL_UNITS[choice.accel_unit]
    else:
        usual = 0.8 * ACCEL_UNITS["g"], 1.25 * ACCEL_UNITS["g"]
        known = {unit: size for unit, size in ACCEL_UNITS.items() if usual[0] < norm * size < usual[1]}
        scale = next(iter(known.values()), ACCEL_UNITS["g"] / norm if norm > 100 else 1.0)
        unit = next(iter(known), f"counts of {scale:.3g} m/s²")
        remarks += note("accelerometer", f"in {unit}, because they rest at {norm:.4g}")
    if not 0.7 < norm * scale / ACCEL_UNITS["g"] < 1.4:
        remarks += warning(
            f"'{choice.columns[-3]}' holds no gravity (it rests at {norm * scale:.2g} m/s²): gyro alone. "
            "Record the accelerometer with gravity"
        )
        return None, remarks
    return accel * scale, remarks


def _saturation(choice: Choice, columns: Array) -> Remarks:
    remarks = Remarks()
    for name, column in zip(choice.columns, columns.T, strict=True):
        if (excess := saturated(column, estimate_noise(column))) is not None:
            remarks += warning(
                f"'{name}' is saturated in {np.count_nonzero(excess)} samples (up to {np.abs(column).max():.4g}): "
                "angles after them are off, use a range that is wide enough"
            )
    return remarks


def _scale_by_gravity(
    time: Array, rate: Array, accel: npt.NDArray[np.complex128], choice: Choice, *, counts: bool
) -> tuple[float, Remarks]:
    """Return rad/s per unit of a rate, shape (n,), whose name gives none: the one that turns gravity as it is felt.

    From hardly any motion on, the gain grows to it. Other numbers than counts are in the nearest unit.
    """
    blocks = _blocks(time, rate, accel)
    assert blocks.rate is not None
    turned = np.cumsum((blocks.rate - np.median(blocks.rate)) * np.diff(blocks.edges))
    if not (reach := float(np.ptp(turned))) > 0:  # about an axis that does not turn
        return rate_scale(rate[:, None], choice)
    size = 1e-3 / reach
    small = replace(blocks, rate=size * blocks.rate, rate_std=size * blocks.rate_std)
    swing = smooth_swing(small, np.full(len(blocks.edges), np.angle(blocks.accel.mean())), gain_std=np.inf)
    if not Z95 * swing.std[1] < CONSISTENT * swing.gain:
        return rate_scale(rate[:, None], choice)
    if counts:
        return size * swing.gain, warning(
            f"one count of the gyro taken as {size * swing.gain:.3g} rad/s, because so it turns the accelerometer's vertical, to "
            "some percent. Say it with --unit"
        )
    unit = min(TRIAD_UNITS, key=lambda unit: abs(np.log(size * swing.gain / RATE_UNITS[unit])))
    return RATE_UNITS[unit], warning(
        f"rates taken as {unit}, as they match the turning of the accelerometer's vertical; no name gives their unit (else --unit)"
    )


ACCELEROMETER = Source(
    name="accelerometer", order=4, quantity=None, find=find_accelerometer, to_roll=roll_from_accelerometer
)
SOURCE = Source(name="imu", order=1, quantity="rate", find=find_imu, to_roll=roll_from_imu, moving=3)
