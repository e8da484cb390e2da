"""Isolated outliers: a bit lost on the wire, a register read while it was written, a hand before a marker."""

import numpy as np
import numpy.typing as npt

from sysid.noise.sensor import BEST_SENSOR, difference_noise, quantisation_step
from sysid.roll import Array

NEIGHBOURS = 4
"""Neighbours on either side that predict a sample: a parabola through eight leaves five degrees of freedom."""
MIN_DISTANCE = 15.0
"""Studentised distance from the neighbours' parabola from which a sample is an outlier [1]. Swings with at least 2.5 samples a
period, kinks, steps, jittering clocks and the knocks of real logs stay below 7."""
MAX_GAP_RATIO = 1.5
"""Largest duration of the neighbours, over that without a lost row: a sample alone in a gap may be a motion."""


def lone_outliers(time: Array, signal: Array, *, rate: bool) -> Array:
    """Return the distance of each outlier from its neighbours' prediction, 0 for all other samples; shape (n,), in the signal's unit.

    An outlier is one sample, or one of two close ones, far from a parabola that its neighbours follow. Beside a step, a kink, a
    ringing knock or a coarsely sampled swing the neighbours do not follow one.

    Args:
        time: Strictly increasing [s], shape (n,).
        signal: In any unit, shape (n,).
        rate: True for a rate. Two neighbouring rows of a rate may be half a swing from rest to rest, so they are not tested as a pair.
    """
    found = np.zeros(signal.size)
    if signal.size < 3 * NEIGHBOURS + 1:
        return found
    # 6 times the distance of one outlier; of neighbours, 6 a - 4 b and 6 b - 4 a, one is at least twice the smaller distance
    bends = np.zeros(signal.size)
    bends[2:-2] = np.abs(np.diff(signal, 4))
    low, high = np.percentile(signal, (1, 99))
    scale = max(
        difference_noise(signal, 4), quantisation_step(np.diff(signal)), BEST_SENSOR * float(high - low)
    )
    suspect, step = bends > 2 * MIN_DISTANCE * scale, float(np.median(np.diff(time)))
    # Two outliers hide each other if one is a neighbour of the other: test them together. Three may be a motion.
    for apart in (0, *range(2 if rate else 1, NEIGHBOURS + 1)):
        outliers = np.unique((0, apart)) + NEIGHBOURS
        first = np.arange(signal.size - 2 * NEIGHBOURS - apart)
        first = first[np.logical_or.reduce([suspect[first + place] for place in outliers])]
        window = first[:, None] + np.arange(2 * NEIGHBOURS + apart + 1)
        lasting = time[window[:, -1]] - time[window[:, 0]]
        window = window[lasting <= MAX_GAP_RATIO * (window.shape[1] - 1) * step]
        distance, studentised = _beside(time[window], signal[window], outliers, scale)
        far = studentised.min(axis=1) > MIN_DISTANCE
        found[window[far][:, outliers]] = distance[far]
    return found


def _beside(time: Array, signal: Array, outliers: npt.NDArray[np.intp], scale: float) -> tuple[Array, Array]:
    """Return the distance of some samples of each window from the parabola through the others, raw and studentised.

    Args:
        time: [s], shape (m, w).
        signal: In any unit, shape (m, w).
        outliers: Places of the samples in a window, shape (k,); both results are of shape (m, k).
        scale: Least standard deviation of a sample, in the signal's unit.
    """
    span = time[:, -1:] - time[:, :1]
    place = 2 * (time - time[:, :1]) / span - 1
    parabola = np.stack((np.ones_like(place), place, place**2), axis=2)
    others = np.delete(np.arange(time.shape[1]), outliers)
    known, wanted = parabola[:, others], parabola[:, outliers]
    inverse = np.linalg.pinv(known)
    values = signal[:, others, None]
    coefficients = inverse @ values
    residual = (values - known @ coefficients)[..., 0]
    std = np.sqrt(np.sum(residual**2, axis=1, keepdims=True) / (others.size - 3))
    distance = signal[:, outliers] - (wanted @ coefficients)[..., 0]
    leverage = np.sum((wanted @ inverse) ** 2, axis=2)
    return distance, np.abs(distance) / (np.sqrt(1 + leverage) * np.maximum(std, scale))
