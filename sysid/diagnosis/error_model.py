"""How likely an error is: white and coloured sensor noise, time stamps that jitter, and a model that is not quite right.

No model of a real joint is exact, and what it misses follows the motion: it is a share of the swing and lasts for a part
of a period. So an error is taken for a sum of four independent parts,

* white noise of the sensor,
* coloured noise of the sensor, as large when the motion has faded as before, with a memory of its own,
* jitter of the time stamps, white, in proportion to the rate,
* a discrepancy in proportion to the amplitude, with a memory of an eighth of a period,

whose five sizes are fitted to each error by maximum likelihood, beside what the sensor's steps hide, which is known. Where a
model reaches the noise, its discrepancy is zero and every sample counts; where none does, neighbouring samples say the same and
a percent less error is no evidence.

The likelihood is Whittle's (Bull. Int. Stat. Inst. 39, 1962), period by period: cosine coefficients of one period of
error are nearly independent, with the parts' spectra as variances.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.least_squares import Normal, minimise
from sysid.roll import Array

MEMORY = 0.125
"""Of the discrepancy, in periods: harmonics of the swing up to the fifth hold 90 % of its power."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """Pieces of one period each, of all releases: what the likelihood of an error is made from."""

    frequency: Array
    """Of each coefficient, in cycles per sample, shape (n,)."""
    amplitude: Array
    """Of the swing in the coefficient's block, shape (n,)."""
    rate: Array
    """RMS rate in the coefficient's block, shape (n,)."""
    signal_square: Array
    """Squares of the motion about rest, sample by sample."""
    cuts: tuple[tuple[int, int, int], ...]
    """Release, begin and end of each block."""
    period: float
    """In samples."""
    rounding: Array
    """Variance of the coefficient that comes from the sensor's steps alone, shape (n,)."""

    def coefficients(self, errors: Sequence[Array]) -> Array:
        """Return the cosine coefficients of an error, block by block, shape (n,), in the unit of the error."""
        from scipy.fft import dct

        return np.concatenate([np.asarray(dct(errors[i][a:b], norm="ortho")) for i, a, b in self.cuts])


@dataclass(frozen=True, slots=True)
class Fitted:
    """An error model fitted to one error."""

    log_likelihood: float
    """In nats, up to a constant of the log."""
    white: float
    coloured: float
    jitter: float
    """Of a time stamp, in units of the rate's time."""
    discrepancy: float
    """Share of the amplitude."""
    each: Array
    """Log-likelihood of each coefficient, shape (n,)."""


@dataclass(frozen=True, slots=True)
class Rounding:
    """What the steps of a sensor hide of a release.

    Where the reading changes from sample to sample it is white, step²/12. A reading that stays says the same again until the motion
    or the noise has left its step: however many there are, at rest they are one.
    """

    step: float
    """Of the sensor [rad or rad/s]."""
    readings: Array
    """Of which means are fitted [rad or rad/s], shape (n * average,)."""
    average: int
    """Readings a sample."""

    def variance(self, frequency: Array, begin: int, end: int) -> Array:
        """Return the variance of cosine coefficients of some samples, in the sensor's unit squared, shape (end - begin,).

        Args:
            frequency: Of the coefficients, in cycles per sample.
            begin: First sample.
            end: Sample after the last.
        """
        readings = self.readings[begin * self.average : end * self.average]
        stays = len(readings) / (1 + np.count_nonzero(np.diff(readings)))
        least = self.step**2 / 12 * min(1.0, stays / self.average)
        return least * _memory(frequency, (stays - 1) / (2 * self.average))


def blocks_of(
    signals: Sequence[Array], rates: Sequence[Array], steps: Sequence[float], period: float, rounding: Sequence[Rounding] = (),
) -> Blocks:  # fmt: skip
    """Cut releases into periods.

    Args:
        signals: Model of each release about rest [rad or rad/s], shape (n,) each.
        rates: Its time derivative, shape (n,) each.
        steps: Sampling period of each [s].
        period: Of the joint [s].
        rounding: Of each release, where the sensor reads in steps.
    """
    frequency, amplitude, rate, cuts, rounded = [], [], [], [], []
    for index, (signal, slope, step) in enumerate(zip(signals, rates, steps, strict=True)):
        length = max(8, round(period / step))
        count = max(1, len(signal) // length)
        for a, b in zip(
            *[np.linspace(0, len(signal), count + 1).astype(int)[i:][:count] for i in (0, 1)], strict=True
        ):
            size = b - a
            swing = np.sqrt(np.mean(signal[a:b] ** 2 + (slope[a:b] * period / (2 * np.pi)) ** 2))
            frequency.append(np.arange(size) / (2.0 * size))
            amplitude.append(np.full(size, swing))
            rate.append(np.full(size, np.sqrt(np.mean(slope[a:b] ** 2))))
            cuts.append((index, int(a), int(b)))
            rounded.append(rounding[index].variance(frequency[-1], a, b) if rounding else np.zeros(size))
    return Blocks(
        np.concatenate(frequency), np.concatenate(amplitude), np.concatenate(rate), np.concatenate(list(signals)) ** 2, tuple(cuts), period / float(np.median(steps)),
        np.concatenate(rounded),
    )  # fmt: skip


def fit_errors(blocks: Blocks, errors: Sequence[Array]) -> Fitted:
    """Fit the error model to one error, by Fisher scoring on the logarithms of its sizes.

    Args:
        blocks: Of the motion.
        errors: Of each release [rad or rad/s], shape (n,) each.
    """
    power = np.maximum(blocks.coefficients(errors) ** 2, 1e-300)
    size = float(np.mean(power))
    swing, rate = (max(float(np.sqrt(np.mean(x**2))), 1e-300) for x in (blocks.amplitude, blocks.rate))
    follows = (blocks.amplitude / swing) ** 2 * _memory(blocks.frequency, MEMORY * blocks.period)
    jitters = (blocks.rate / rate) ** 2

    def variance(point: Array) -> tuple[Array, Array]:
        """Return the variance and its slopes, shape (n,) and (5, n)."""
        w, c, t, j, m = np.exp(point)
        remembered, longer = (_memory(blocks.frequency, f * t * blocks.period) for f in (1.0, 1.01))
        slope = c * (longer - remembered) / np.log(1.01)
        parts = size * np.stack([np.full_like(power, w), c * remembered, slope, j * jitters, m * follows])
        return parts[[0, 1, 3, 4]].sum(0) + blocks.rounding, parts

    def normal(point: Array) -> Normal:
        v, slopes = variance(point)
        ratio, relative = power / v, slopes / v
        cost = 0.5 * float(np.sum(ratio - 1 - np.log(ratio)))
        return Normal(cost, 0.5 * relative @ (1 - ratio), 0.5 * relative @ relative.T)

    white = float(np.median(power[blocks.frequency > 0.25])) / 0.455 / size  # a squared normal's median
    low = np.array([-14.0, -14.0, np.log(0.02), -14.0, -14.0])
    high = np.array([2.0, 2.0, np.log(20.0), 2.0, 4.0])
    starts = [
        np.array([np.log(max(white, 1e-5)), coloured, np.log(memory), -4.0, follow])
        for coloured, memory, follow in ((-2.0, 0.1, -2.0), (-1.0, 1.0, -4.0), (-5.0, 0.1, -0.5))
    ]
    found = [minimise(normal, s, low, high, iterations=40, tolerance=1e-7, damping=0.1) for s in starts]
    best = min(found, key=lambda f: f.normal.cost).point
    v, _ = variance(best)
    w, c, _, j, m = np.exp(best)
    each = -0.5 * (np.log(v) + power / v)
    return Fitted(
        float(each.sum()), float(np.sqrt(size * w + np.mean(blocks.rounding))), float(np.sqrt(size * c)),
        float(np.sqrt(size * j)) / rate, float(np.sqrt(size * m)) / swing, each,
    )  # fmt: skip


def _memory(frequency: Array, samples: float) -> Array:
    """Return the spectrum of noise of variance one that forgets exponentially, shape (n,)."""
    a = np.exp(-1.0 / max(samples, 1e-3))
    return (1 - a * a) / (1 - 2 * a * np.cos(2 * np.pi * frequency) + a * a)
