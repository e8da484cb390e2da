"""The offset between the clocks of two records of one and the same motion."""

import numpy as np

from sysid.errors import SysidError
from sysid.quantity import Quantity, t95
from sysid.roll import Array, Roll

MAX_OFFSET = 60.0
"""Offsets beyond this are not looked for [s]."""
LIKENESS = 0.9
"""Least correlation of both records at the best offset. Two sensors on one deck reach 0.99; decays of different
releases, laid over each other as well as they go, 0.5 to 0.8. With ten samples or more it also keeps the 95 % interval of the
offset within a fifth of a quarter swing."""
LEAST_SMOOTH, MOST_SMOOTH = 0.7, 5.0
"""Width of the smoothing, a Gaussian's standard deviation, in samples of the coarser record."""
MAX_SMOOTHING = 0.1
"""Smoothing up to this share of a radian of the motion takes 0.5 % of its amplitude."""
MAX_CORRELATION_TIME = 0.12
"""Errors are alike for no longer than this [s]."""


def clock_offset(one: Roll, other: Roll) -> Quantity:
    """Return what to add to the times of `other` to bring them onto the clock of `one` [s].

    A coarse search by cross-correlation of the rolls comes first. Least squares over offset, gain and a common angle
    follow, with the finer record interpolated by a cubic spline.

    Both are smoothed alike before: between two samples a spline averages their noise, so that records of one
    rate would fit best half a sample off. The interval allows for residuals that are correlated and grow with the
    motion.

    Raises:
        SysidError: The records do not show the same motion, or nothing moves in them.
    """
    from scipy.interpolate import CubicSpline
    from scipy.optimize import least_squares

    steps = [float(np.median(np.diff(record.time))) for record in (one, other)]
    start = _coarse(one, other, max(min(steps), 1e-3))
    if steps[1] > steps[0]:
        found = clock_offset(other, one)
        low, high = found.ci95
        return Quantity(-found.value, found.std, found.unit, found.method, (-high, -low))
    width = _width(one, steps[0])
    time, roll, std = _smooth(one, width)
    times, rolls, stds = _smooth(other, width)
    spline = CubicSpline(times, rolls)
    low, high = max(time[0], times[0] + start) + 0.05, min(time[-1], times[-1] + start) - 0.05
    inside = (time >= low) & (time <= high)
    if inside.sum() < 10:
        raise SysidError(
            f"{one.log} and {other.log} overlap in {inside.sum()} samples only: nothing to align by."
        )
    time, roll = time[inside], roll[inside]
    noise = np.hypot(std[inside], np.interp(time - start, times, stds))
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
    offset, gain = float(fit.x[0]), float(fit.x[1])
    aligned = spline(time - offset)
    likeness = float(np.corrcoef(gain * aligned, roll)[0, 1])
    if not likeness > LIKENESS or gain <= 0:
        raise SysidError(
            f"{one.log} and {other.log} do not show the same motion (correlation {likeness:.2f} at best). "
            "Align records of the same releases, with the same sign of roll."
        )
    slope = np.asarray(-gain * spline(time - offset, 1), np.float64)
    std, freedom = _offset_std(
        slope, np.stack([aligned, np.ones_like(time)], axis=1), residuals(fit.x), noise, time
    )
    half = t95(freedom) * std
    return Quantity(offset, std, "s", "least squares of both rolls", (offset - half, offset + half))


def _width(record: Roll, step: float) -> float:
    """Return the width of the smoothing [s]: as much as takes nothing of the motion."""
    width = MOST_SMOOTH * step
    for _ in range(4):  # from the smoothest on: noise turns faster than any deck
        time, roll, _ = _smooth(record, width)
        turn = float(np.ptp(roll)) / max(float(np.ptp(np.gradient(roll, time))), 1e-12)
        width = float(np.clip(MAX_SMOOTHING * turn, LEAST_SMOOTH * step, MOST_SMOOTH * step))
    return width


def _smooth(record: Roll, width: float) -> tuple[Array, Array, Array]:
    """Return times, roll and standard deviations, smoothed by a Gaussian of this width [s].

    Times are averaged with the same weights, so that uneven samples are not shifted.
    """
    samples = width / float(np.median(np.diff(record.time)))
    reach = int(np.ceil(4 * samples))
    if len(record.time) < 2 * reach + 10:
        return record.time, record.roll, record.std
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / samples) ** 2)
    weight /= weight.sum()
    both = np.stack([np.convolve(values, weight, "valid") for values in (record.time, record.roll)])
    time, roll = np.asarray(both, np.float64)
    return time, roll, record.std[reach:-reach]


def _offset_std(
    slope: Array, others: Array, residual: Array, noise: Array, time: Array
) -> tuple[float, float]:
    """Return the standard deviation of the offset and the degrees of freedom behind it.

    Args:
        slope: Derivative of the model by the offset [rad/s], shape (n,).
        others: Those by gain and common angle, shape (n, 2).
        residual: Residuals of the fit, in units of `noise`, shape (n,).
        noise: Standard deviations that the samples were weighted by [rad], shape (n,).
        time: Times of the samples [s].
    """
    others = np.asarray(np.linalg.qr(others / noise[:, None])[0], np.float64)
    own = slope / noise
    own = own - others @ (others.T @ own)
    count = len(time)
    lags = min(count // 3, max(1, round(MAX_CORRELATION_TIME / float(np.median(np.diff(time))))))
    taper = 1 - np.arange(lags + 1) / (lags + 1)  # Bartlett's: the sum below is never negative
    alike = _products(residual, lags)
    shape = _products(own, lags)
    two = np.full(lags + 1, 2.0)
    two[0] = 1.0
    power = float(own @ own)
    grown = max(float(np.sum(two * shape * taper * alike / alike[0])), 0.1 * power)
    # In motion, interpolation and sensors err more than at rest.
    variance = max(float(residual @ residual) / (count - 3), float(own**2 @ residual**2) / power)
    telling = power**2 / float(np.sum(own**4))
    return float(np.sqrt(variance * grown) / power), max(telling - 3, 1.0)


def _products(values: Array, lags: int) -> Array:
    """Return Σ x_i x_(i+l) for l = 0 to `lags`, shape (lags + 1,)."""
    size = 1 << (2 * len(values) - 1).bit_length()
    return np.asarray(np.fft.irfft(np.abs(np.fft.rfft(values, size)) ** 2, size)[: lags + 1], np.float64)


def _coarse(one: Roll, other: Roll, step: float) -> float:
    """Offset [s] at which the normalised correlation of both roll rates is greatest."""
    rates: list[Array] = []
    for record in (one, other):
        grid = np.arange(record.time[0], record.time[-1], step)
        if len(grid) < 8 or np.ptp(record.roll) < 4 * np.median(record.std):
            raise SysidError(f"{record.log}: nothing moves in it, so its clock cannot be compared.")
        rate = np.gradient(np.interp(grid, record.time, record.roll), step)
        rates.append(rate - rate.mean())
    size = 1 << int(np.ceil(np.log2(len(rates[0]) + len(rates[1]))))
    product = np.fft.irfft(np.fft.rfft(rates[0], size) * np.conj(np.fft.rfft(rates[1], size)), size)
    lags = np.arange(size)
    lags = np.where(lags > size // 2, lags - size, lags)
    allowed = np.abs(lags * step) <= MAX_OFFSET
    best = int(lags[allowed][np.argmax(product[allowed])])
    return float(best * step + one.time[0] - other.time[0])
