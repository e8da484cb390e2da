"""The unit of a gyro whose columns name none, from the accelerometer beside it.

Turned into the frame of the first sample by the right rates, gravity stands still there, and what is left of the
accelerations over a second is what the lever arm to the axis of rotation feels. So each unit is tried with the lever
arm that suits it best; without one, a sensor a hand's breadth from the axis looks like another unit.
"""

from collections.abc import Sequence

import numpy as np

from sysid.logs.sources.gravity_smoother import lever_accelerations
from sysid.logs.sources.rotations import integrate_rate
from sysid.logs.table.names import RATE_UNITS
from sysid.logs.table.remarks import Remarks, warning
from sysid.noise.sensor import estimate_noise
from sysid.roll import Array

TRIAD_UNITS = ("rad/s", "deg/s", "mrad/s", "mdeg/s")
"""Units that three-axis gyros write; a speed in rpm is that of a wheel, and its column says so."""
RECORD_PART = 10.0
"""So much of the record about its liveliest second is looked at [s]."""
WINDOW = 1.0
"""Over this long the gyro's offset turns gravity by a straight line [s]."""
BANDWIDTH = 400.0
"""Faster records are averaged down to about this rate [Hz]: no deck turns within 5 ms."""
MAX_LEFT_SHARE = 0.5
"""Share of the change of the accelerations that a unit leaves at most, to be the right one."""
MIN_ERROR_RATIO = 1.2
"""By this factor the second best unit leaves more: with a longer arm, a smaller unit takes up all but the centripetal part."""
MIN_LIKELIHOOD_GAIN = 50.0
"""And twice its log likelihood is lower by this much: once in e^25 by chance."""
LONGEST_ARM = 0.5
"""No sensor sits farther from the axis that a board rocks about [m]."""
COUNTS = np.geomspace(1e-6, 0.3, 56)
"""Sizes of one count that are tried [rad/s]: from 24-bit sensors to 8-bit ones, a quarter apart."""


def scale_by_gravity(time: Array, rates: Array, accel: Array) -> tuple[float, Remarks] | None:
    """Return rad/s per unit of the rates, and a warning that it is inferred; None where gravity does not tell.

    Args:
        time: Time [s], shape (n,).
        rates: Rotation rates in sensor axes, in the unit that is looked for, shape (n, 3).
        accel: Specific force in sensor axes [m/s^2], shape (n, 3).
    """
    counts = bool(np.all(rates == np.round(rates)))
    time, rates, accel = _liveliest(time, rates - np.median(rates, axis=0), accel)
    still = _left(time, 0.0 * rates, accel)
    noise = len(accel) * sum(estimate_noise(column).std ** 2 for column in accel.T)
    if not counts:
        named = [_left(time, RATE_UNITS[unit] * rates, accel) for unit in TRIAD_UNITS]
        unit = TRIAD_UNITS[int(np.argmin(named))]
        beside = min(_left(time, factor * RATE_UNITS[unit] * rates, accel) for factor in (0.5, 2.0))
        if beside < min(named) or not _clear(named, still, noise, accel.size):
            return None
        return RATE_UNITS[unit], warning(
            f"rates taken as {unit}, as they match the turning of the accelerometer's vertical; no name gives their unit (else --unit)"
        )
    tried = [_left(time, size * rates, accel) for size in COUNTS]
    best = int(np.argmin(tried))
    if best in (0, len(tried) - 1):
        return None
    others = [left for index, left in enumerate(tried) if abs(index - best) > 2]
    if not _clear([tried[best], *others], still, noise, accel.size):
        return None
    size = float(COUNTS[best])
    for step in (1.12, 1.04, 1.01):
        size = min((size / step, size, size * step), key=lambda one: _left(time, one * rates, accel))
    return size, warning(
        f"one count of the gyro taken as {size:.3g} rad/s, because so it turns the accelerometer's vertical, to some "
        "percent. Say it with --unit"
    )


def _clear(left: Sequence[float], still: float, noise: float, count: int) -> bool:
    """Whether the best of some candidates explains the accelerations, and no other does nearly as well.

    All are sums over `count` numbers [m²/s⁴]: what candidates leave, what no rotation leaves, and what noise alone does.
    """
    first, second = sorted(left)[:2]
    beyond = max(first - noise, 0.0)
    surely = second - first > MIN_LIKELIHOOD_GAIN * first / count
    return beyond < MAX_LEFT_SHARE * (still - noise) and second - noise > MIN_ERROR_RATIO * beyond and surely


def _liveliest(time: Array, rates: Array, accel: Array) -> tuple[Array, Array, Array]:
    """Return the liveliest `RECORD_PART` of a record, averaged down to about `BANDWIDTH`."""
    period = float(np.median(np.diff(time)))
    size = max(1, round(1 / (BANDWIDTH * period)))
    count = time.size // size
    time, rates, accel = (
        values[: count * size].reshape(count, size, -1).mean(axis=1) for values in (time, rates, accel)
    )
    width = min(count, round(RECORD_PART / (size * period)))
    energy = np.concatenate(([0.0], np.cumsum(np.sum(rates**2, axis=1))))
    start = int(np.argmax(energy[width:] - energy[:-width]))
    return time[start : start + width, 0], rates[start : start + width], accel[start : start + width]


def _left(time: Array, rates: Array, accel: Array) -> float:
    """Return what is left of the changes of the accelerations, seen from the first sample's frame [m²/s⁴, summed]."""
    attitude = integrate_rate(time, rates)
    width = max(8, round(WINDOW / float(np.median(np.diff(time)))))
    levers = attitude @ lever_accelerations(time, rates)
    change = _without_lines(np.einsum("nij,nj->ni", attitude, accel), width).reshape(-1)
    arms = _without_lines(levers.reshape(len(time), 9), width).reshape(-1, 3)
    arm = np.linalg.lstsq(arms, change, rcond=1e-6)[0]
    if not np.linalg.norm(arm) < LONGEST_ARM:
        return float(change @ change)
    return float(np.sum((change - arms @ arm) ** 2))


def _without_lines(values: Array, width: int) -> Array:
    """Return columns, shape (n, m), without their straight line in each stretch of `width` rows, shape (k, m)."""
    width = min(width, len(values))
    blocks = values[: len(values) // width * width].reshape(-1, width, values.shape[1])
    ramp = np.linspace(-1, 1, width)[:, None]
    blocks = blocks - blocks.mean(axis=1, keepdims=True)
    slope = np.sum(blocks * ramp, axis=1, keepdims=True) / np.sum(ramp**2)
    return (blocks - slope * ramp).reshape(-1, values.shape[1])
