"""Sensor noise of a signal on a clock that need not be even."""

import numpy as np

from sysid.noise.sensor import BLOCK, DIFFERENCE, MAX_BLOCKS, Noise, divided_differences, estimate_noise
from sysid.roll import Array


def noise_of(time: Array, signal: Array) -> Noise:
    """Estimate a sensor's noise from the smoothness of its signal; see `sysid.noise.sensor.estimate_noise`.

    Args:
        time: Strictly increasing [s], shape (n,).
        signal: In any unit, shape (n,).
    """
    noise = estimate_noise(signal)
    low, high = np.percentile(np.diff(time), (10, 90))
    if signal.size < BLOCK or high < 1.1 * low:
        return noise
    left = sixth_differences(time, signal)
    blocks = left[: left.size // BLOCK * BLOCK].reshape(-1, BLOCK)
    uneven = float(np.median(np.sqrt(np.mean(blocks**2, axis=1)))) if len(blocks) else float(np.std(left))
    return Noise(std=max(uneven, noise.step / np.sqrt(12)), step=noise.step)


def sixth_differences(time: Array, signal: Array) -> Array:
    """Return sixth divided differences of unit norm, spread over the log, shape (m,), in the signal's unit."""
    starts = np.unique(
        np.linspace(0, signal.size - DIFFERENCE - 1, min(signal.size, MAX_BLOCKS * DIFFERENCE)).astype(
            np.intp
        )
    )
    rows = starts[:, None] + np.arange(DIFFERENCE + 1)
    return divided_differences(time[rows], signal[rows])
