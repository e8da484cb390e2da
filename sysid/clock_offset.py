"""The offset between the clocks of two records of one and the same motion."""

import numpy as np

from sysid.errors import HuskyError
from sysid.quantity import Quantity
from sysid.roll import Array, Roll

LARGEST = 60.0
"""Offsets beyond this are not looked for [s]."""
LIKENESS = 0.9
"""Least correlation of both records at the best offset. Two sensors on one deck reach 0.99; decays of different
releases, laid over each other as well as they go, 0.5 to 0.8. With ten samples or more it also keeps the 95 % interval of the
offset within a fifth of a quarter swing."""


def clock_offset(one: Roll, other: Roll) -> Quantity:
    """Return what to add to the times of `other` to bring them onto the clock of `one` [s].

    A coarse search by cross-correlation of the rolls, then least squares over offset, gain and a
    common angle (records may differ in zero, and an uncalibrated gyro or camera in scale), with the
    second record interpolated by a cubic spline.

    Raises:
        HuskyError: The records do not show the same motion, or nothing moves in them.
    """
    from scipy.interpolate import CubicSpline
    from scipy.optimize import least_squares

    step = min(float(np.median(np.diff(record.time))) for record in (one, other))
    start = _coarse(one, other, max(step, 1e-3))
    spline = CubicSpline(other.time, other.roll)
    low, high = (
        max(one.time[0], other.time[0] + start) + 0.05,
        min(one.time[-1], other.time[-1] + start) - 0.05,
    )
    inside = (one.time >= low) & (one.time <= high)
    if inside.sum() < 10:
        raise HuskyError(
            f"{one.log} and {other.log} overlap in {inside.sum()} samples only: nothing to align by."
        )
    time, roll = one.time[inside], one.roll[inside]
    noise = np.hypot(one.std[inside], np.interp(time - start, other.time, other.std))
    noise = np.maximum(noise, 1e-3 * np.ptp(roll))

    def residuals(parameters: Array) -> Array:
        offset, gain, shift = parameters
        return (gain * spline(time - offset) + shift - roll) / noise

    fit = least_squares(
        residuals,
        [start, 1.0, float(np.mean(roll) - np.mean(spline(time - start)))],
        loss="soft_l1",
        x_scale=[1e-3, 0.1, 0.1],
    )
    aligned = fit.x[1] * spline(time - fit.x[0])
    likeness = float(np.corrcoef(aligned, roll)[0, 1])
    if not likeness > LIKENESS or fit.x[1] <= 0:
        raise HuskyError(
            f"{one.log} and {other.log} do not show the same motion (correlation {likeness:.2f} at best). "
            "Align records of the same releases, with the same sign of roll."
        )
    raw = residuals(fit.x)
    scale = max(float(np.mean(raw**2)), 1.0)
    std = float(np.sqrt(np.linalg.inv(fit.jac.T @ fit.jac)[0, 0] * scale))
    return Quantity(float(fit.x[0]), std, "s", "least squares of both rolls")


def _coarse(one: Roll, other: Roll, step: float) -> float:
    """Offset [s] at which the normalised correlation of both roll rates is greatest."""
    rates: list[Array] = []
    for record in (one, other):
        grid = np.arange(record.time[0], record.time[-1], step)
        if len(grid) < 8 or np.ptp(record.roll) < 4 * np.median(record.std):
            raise HuskyError(f"{record.log}: nothing moves in it, so its clock cannot be compared.")
        rate = np.gradient(np.interp(grid, record.time, record.roll), step)
        rates.append(rate - rate.mean())
    size = 1 << int(np.ceil(np.log2(len(rates[0]) + len(rates[1]))))
    product = np.fft.irfft(np.fft.rfft(rates[0], size) * np.conj(np.fft.rfft(rates[1], size)), size)
    lags = np.arange(size)
    lags = np.where(lags > size // 2, lags - size, lags)
    allowed = np.abs(lags * step) <= LARGEST
    best = int(lags[allowed][np.argmax(product[allowed])])
    return float(best * step + one.time[0] - other.time[0])
