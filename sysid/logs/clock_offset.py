"""The offset between the clocks of two records of one and the same motion."""

import numpy as np

from sysid.errors import SysidError
from sysid.noise.whiteness import correlation_length
from sysid.quantity import Z95, Quantity, t95
from sysid.roll import Array, Roll

MAX_OFFSET = 60.0
"""Offsets beyond this are not looked for [s]."""
LIKENESS = 0.9
"""Least correlation of both records at the best offset. Two sensors on one deck reach 0.99; decays of different
releases, laid over each other as well as they go, 0.5 to 0.8. With ten samples or more it also keeps the 95 % interval of the
offset within a fifth of a quarter swing."""


def clock_offset(one: Roll, other: Roll) -> Quantity:
    """Return what to add to the times of `other` to bring them onto the clock of `one` [s].

    A coarse search by cross-correlation of the rolls comes first. Least squares over offset, gain and a common angle
    follow, between the smoothing splines of both. A spline through the samples would average their noise between two of
    them: records of one rate would fit best half a sample off. The interval allows for residuals that are correlated
    and grow with the motion.

    Raises:
        SysidError: The records do not show the same motion, or nothing moves in them.
    """
    from scipy.interpolate import UnivariateSpline
    from scipy.optimize import least_squares

    steps = [float(np.median(np.diff(record.time))) for record in (one, other)]
    if steps[1] > steps[0]:
        found = clock_offset(other, one)
        turned = (-found.ci95[1], -found.ci95[0])
        return Quantity(-found.value, found.std, found.unit, found.method, turned)
    start = _coarse(one, other, max(min(steps), 1e-3))
    begin, end = max(one.time[0], other.time[0] + start), min(one.time[-1], other.time[-1] + start)
    time = np.arange(begin, end, max(steps))[1:-1]
    if time.size < 10:
        raise SysidError(
            f"{one.log} and {other.log} overlap in {time.size} samples only: nothing to align by."
        )
    mine, theirs = (
        UnivariateSpline(record.time, record.roll, 1 / record.std, s=record.time.size)
        for record in (one, other)
    )
    slope = theirs.derivative()
    roll = np.asarray(mine(time), np.float64)

    def residuals(parameters: Array) -> Array:
        offset, gain, shift = parameters
        return np.asarray(gain * theirs(time - offset) + shift - roll, np.float64)

    fit = least_squares(
        residuals,
        [start, 1.0, float(np.mean(roll) - np.mean(theirs(time - start)))],
        loss="soft_l1",
        f_scale=1e-3 * float(np.ptp(roll)),
        x_scale=[1e-3, 0.1, 0.1],
    )
    offset, gain = float(fit.x[0]), float(fit.x[1])
    aligned = np.asarray(theirs(time - offset), np.float64)
    likeness = float(np.corrcoef(gain * aligned, roll)[0, 1])
    if not likeness > LIKENESS or gain <= 0:
        raise SysidError(
            f"{one.log} and {other.log} do not show the same motion (correlation {likeness:.2f} at best). "
            "Align records of the same releases, with the same sign of roll."
        )
    others = np.linalg.qr(np.stack([aligned, np.ones_like(time)], axis=1))[0]
    own = -gain * np.asarray(slope(time - offset), np.float64)
    own = own - others @ (others.T @ own)
    left, power = residuals(fit.x), float(own @ own)
    length = correlation_length([left])  # in motion, interpolation and sensors err more than at rest
    variance = max(float(left @ left) / time.size, float(own**2 @ left**2) / power)
    half = t95(max(time.size / length - 3, 1.0)) * float(np.sqrt(variance * length / power))
    return Quantity(offset, half / Z95, "s", "least squares of both rolls", (offset - half, offset + half))


def _coarse(one: Roll, other: Roll, step: float) -> float:
    """Offset [s] at which the normalised correlation of both roll rates is greatest."""
    from scipy.signal import correlate, correlation_lags

    rates: list[Array] = []
    for record in (one, other):
        grid = np.arange(record.time[0], record.time[-1], step)
        if len(grid) < 8 or np.ptp(record.roll) < 4 * np.median(record.std):
            raise SysidError(f"{record.log}: nothing moves in it, so its clock cannot be compared.")
        rate = np.gradient(np.interp(grid, record.time, record.roll), step)
        rates.append(rate - rate.mean())
    first, second = rates
    product: Array = correlate(first, second)
    lags: Array = correlation_lags(len(first), len(second))
    best = lags[np.argmax(np.where(np.abs(lags * step) <= MAX_OFFSET, product, -np.inf))]
    return float(best * step + one.time[0] - other.time[0])
