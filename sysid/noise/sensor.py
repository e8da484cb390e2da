"""Sensor noise, quantisation step and saturation of a signal, from the signal itself."""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from sysid.roll import Array

BLOCK = 64
MAX_BLOCKS = 2000
DIFFERENCE = 6
"""Samples of a block, largest number of blocks, order of the differences: choices. Sixth differences keep 0.03 % of a motion with
25 samples a period."""
BAND, SIDE = 4.0, 3
"""Scatter of a flat top, and least height of a round one [noise of a sample]; rows on each side for its parabola."""
FULL_SCALES = np.deg2rad([scale * 2.0**k for scale in (125.0, 2**15 * 4.375e-3) for k in range(5)])
FULL_SCALE_ERROR = 0.03
"""Limits of gyros [rad/s]: ±125 to 2000 deg/s, and those of ST, whose counts are multiples of 4.375 mdeg/s; relative tolerance of a
limit."""
SOFT = 0.9
"""Share of its limit from which a sensor may saturate softly; larger readings are left out in every swing."""
BEST_SENSOR = 1e-6
"""Least noise of a sensor over its swing; a computed log has less, from rounding."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Sensor noise of a signal."""

    std: float
    """Standard deviation of one sample, in the signal's unit."""
    step: float
    """Quantisation step in the signal's unit; 0 if it is not visible."""


def estimate_noise(signal: Array) -> Noise:
    """Estimate a sensor's noise from the smoothness of its signal.

    Sixth differences keep white noise and suppress a smooth motion: of a sine of angular frequency ω, sampled every
    T, (ωT)⁶ of the amplitude remains. The median over short blocks ignores release, catch and knocks. High
    differences underestimate the noise of a filtered sensor. A second estimate is therefore the scatter about a
    straight line in the quietest blocks; the larger one counts. Both are at least the rounding noise, step / √12.

    Args:
        signal: Evenly sampled signal in any unit, shape (n,).
    """
    length = min(BLOCK, signal.size)
    count = min(signal.size // length, MAX_BLOCKS)
    starts = np.unique(np.linspace(0, signal.size - length, count).astype(np.intp))
    blocks = signal[starts[:, None] + np.arange(length)]
    step = quantisation_step(np.diff(blocks, axis=1).ravel())
    differences = np.diff(blocks, DIFFERENCE, axis=1)
    high = float(np.median(np.sqrt(np.mean(differences**2, axis=1) / math.comb(2 * DIFFERENCE, DIFFERENCE))))
    line = np.column_stack([np.ones(length), np.arange(length)])
    apart = blocks.T - line @ (np.linalg.pinv(line) @ blocks.T)
    scatter = np.sort(np.sqrt(np.sum(apart**2, axis=0) / max(length - 2, 1)))
    quiet = float(np.median(scatter[: max(1, len(scatter) // 5)]))
    # Even the quietest blocks may move; then only the high differences count.
    quiet = quiet if quiet < 3 * max(high, step / np.sqrt(12)) else 0.0
    return Noise(std=max(high, quiet, step / np.sqrt(12)), step=step)


def difference_noise(signal: Array, order: int) -> float:
    """Return the white noise of an evenly sampled signal, shape (n,), from the median size of its differences, in its unit.

    Differences of order m have C(2m, m) times the variance of the noise. The median ignores short stretches of fast motion; of a
    normal variable it is 0.6745 σ.
    """
    size = float(np.median(np.abs(np.diff(signal, order))))
    return size / (0.6745 * math.sqrt(math.comb(2 * order, order)))


def divided_differences(nodes: Array, values: Array) -> Array:
    """Return divided differences of unit norm, shape (m,), in the signal's unit.

    They keep the size of white noise and remove polynomials below their order, on uneven stamps too.

    Args:
        nodes: When each window was sampled [s], strictly increasing, shape (m, order + 1).
        values: The signal there, shape (m, order + 1).
    """
    size = np.zeros(nodes.T.shape)  # of the weights, as logarithms: torn stamps are any size
    for i, j in combinations(range(len(size)), 2):
        apart = np.log(nodes[:, j] - nodes[:, i])
        size[i] -= apart
        size[j] -= apart
    weights = np.exp(size - size.max(axis=0))
    weights[1::2] *= -1
    return np.sum(weights * values.T, axis=0) / np.linalg.norm(weights, axis=0)


def runs(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    """Return the first index and the end of each run of true values of a mask of shape (n,), shape (k, 2); dimensionless."""
    return np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))).reshape(-1, 2)


def quantisation_step(differences: Array) -> float:
    """Return the step of a quantised signal, in its unit; nearly all its differences, shape (n,), are multiples of it. 0 without a step."""
    changes = np.abs(differences)
    size = float(changes.max(initial=0.0))
    changes = changes[changes > 1e-9 * size]
    if changes.size < 8:
        return 0.0
    step = float(changes.min())
    # Rounded decimals make the smallest difference a little off; refine it by the larger multiples.
    for limit in (4.0, 40.0, 400.0):
        near = changes[changes < limit * step]
        step = float(np.sum(near) / np.sum(np.round(near / step)))
    ratio = changes[changes < 100 * step] / step
    return step if np.mean(np.abs(ratio - np.round(ratio)) < 0.1) > 0.95 else 0.0


def saturated(signal: Array, noise: Noise) -> Array | None:
    """Return by how much the true value of each saturated sample may exceed the limit, shape (n,) in its unit; 0 elsewhere.

    A sensor at its limit repeats its largest or smallest value, with steep slopes on both sides. At a turning point,
    even of a coarsely quantised signal, the slopes are flat; a held deck leaves gently. Beyond the limit the motion
    is a parabola through the slopes at both ends: height = slope · duration / 4. None without saturation.
    """
    excess: Array | None = None
    for limit in (signal.max(), signal.min()):
        starts, stops = runs(signal == limit).T
        inside = (stops - starts >= 3) & (starts >= 2) & (stops <= signal.size - 2)
        starts, stops = starts[inside], stops[inside]
        slopes = np.minimum(
            np.abs(signal[starts - 1] - signal[starts - 2]), np.abs(signal[stops] - signal[stops + 1])
        )
        for run in np.flatnonzero(slopes > 4 * max(noise.std, noise.step)):
            excess = np.zeros_like(signal) if excess is None else excess
            start, stop = starts[run], stops[run]
            excess[start:stop] = slopes[run] * (stop - start) / 4
    return excess


def clipped_rows(rate: Array, noise: Noise) -> npt.NDArray[np.bool_]:
    """Return which samples of a rotation rate [rad/s], shape (n,), its sensor may have clipped.

    A clipped top repeats one value (`saturated`), is flat but for noise, or bends softly: the parabola through the rows on both sides
    lies above it. Two such tops in a decay are clipped. A single one may be freeplay; it is clipped if its height is the full scale of
    a gyro. The test is for rates only: a held deck, or one at a stop, has flat tops of the angle.
    """
    size = np.abs(rate)
    band, top = BAND * max(noise.std, noise.step), float(np.partition(size, -4)[-4])
    flat = list[float]()
    for level in (rate, -rate):
        starts, stops = runs(level > top - band).T
        enough = (stops - starts >= 3) & (starts >= SIDE) & (stops <= rate.size - SIDE)
        for start, stop in zip(starts[enough], stops[enough], strict=True):
            beside = np.concatenate((np.arange(start - SIDE, start), np.arange(stop, stop + SIDE)))
            middle = 0.5 * (start + stop - 1)
            parabola = np.polyfit(beside - middle, level[beside], 2)
            height, round_top = float(level[start:stop].max()), float(parabola[-1])
            bend = round_top - float(np.polyval(parabola, 0.5 * (stop - start - 1)))
            # A top of few rows, or of a hardening spring, is not a parabola either, but it bends; a clipped one does not.
            if round_top > height + band and height - level[start:stop].min() - band < 0.5 * bend:
                flat.append(height)
    at_limit = any(np.abs(height / FULL_SCALES - 1).min() < FULL_SCALE_ERROR for height in flat)
    found = len(flat) > 1 or at_limit or saturated(rate, noise) is not None
    return size > SOFT * top if found else np.zeros(rate.size, dtype=np.bool_)
