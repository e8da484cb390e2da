"""How likely an error is: white and coloured sensor noise, time stamps that jitter, and a model that is not quite right.

No model of a real joint is exact, and what it misses follows the motion: it is a share of the swing and lasts for a part
of a period. So an error is taken for a sum of four independent parts,

* white noise of the sensor,
* coloured noise of the sensor, as large when the motion has faded as before, with a memory of its own,
* jitter of the time stamps, white, in proportion to the rate,
* a discrepancy in proportion to the amplitude, with a memory of an eighth of a period,

whose five sizes are fitted to each error by maximum likelihood. Where a model reaches the noise, its discrepancy is
zero and every sample counts; where none does, neighbouring samples say the same and a percent less error is no evidence.

The likelihood is Whittle's (Bull. Int. Stat. Inst. 39, 1962), period by period: cosine coefficients of one period of
error are nearly independent, with the parts' spectra as variances.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.roll import Array

MEMORY = 0.125
"""Of the discrepancy, in periods: harmonics of the swing up to the fifth hold 90 % of its power."""
_PARTS = 5


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

    def coefficients(self, errors: Sequence[Array]) -> Array:
        """Return the cosine coefficients of an error, block by block, shape (n,)."""
        from scipy.fft import dct

        return np.concatenate([dct(errors[i][a:b], norm="ortho") for i, a, b in self.cuts])


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


def blocks_of(signals: Sequence[Array], rates: Sequence[Array], steps: Sequence[float], period: float) -> Blocks:
    """Cut releases into periods.

    Args:
        signals: Model of each release about rest [rad or rad/s].
        rates: Its time derivative.
        steps: Sampling period of each [s].
        period: Of the joint [s].
    """
    frequency, amplitude, rate, cuts = [], [], [], []
    for index, (signal, slope, step) in enumerate(zip(signals, rates, steps, strict=True)):
        length = max(8, round(period / step))
        count = max(1, len(signal) // length)
        for a, b in zip(*[np.linspace(0, len(signal), count + 1).astype(int)[i:][:count] for i in (0, 1)], strict=True):
            size = b - a
            swing = np.sqrt(np.mean(signal[a:b] ** 2 + (slope[a:b] * period / (2 * np.pi)) ** 2))
            frequency.append(np.arange(size) / (2.0 * size))
            amplitude.append(np.full(size, swing))
            rate.append(np.full(size, np.sqrt(np.mean(slope[a:b] ** 2))))
            cuts.append((index, int(a), int(b)))
    return Blocks(
        np.concatenate(frequency), np.concatenate(amplitude), np.concatenate(rate), np.concatenate(list(signals)) ** 2, tuple(cuts), period / float(np.median(steps)),
    )  # fmt: skip


def fit_errors(blocks: Blocks, errors: Sequence[Array]) -> Fitted:
    """Fit the error model to one error."""
    from scipy.optimize import minimize

    power = blocks.coefficients(errors) ** 2
    size = float(np.mean(power)) or 1e-300
    swing, rate = float(np.sqrt(np.mean(blocks.amplitude**2))), float(np.sqrt(np.mean(blocks.rate**2)))
    follows = (blocks.amplitude / max(swing, 1e-300)) ** 2 * _memory(blocks.frequency, MEMORY * blocks.period)
    jitters = (blocks.rate / max(rate, 1e-300)) ** 2
    white = float(np.median(power[blocks.frequency > 0.25])) / 0.455 / size  # a squared normal's median

    def variance(point: Array) -> Array:
        w, c, t, j, m = np.exp(point)
        return size * (w + c * _memory(blocks.frequency, t * blocks.period) + j * jitters + m * follows)

    def loss(point: Array) -> float:
        v = variance(point)
        return 0.5 * float(np.sum(np.log(v) + power / v))

    low = [-14.0, -14.0, np.log(0.02), -14.0, -14.0]
    high = [2.0, 2.0, np.log(20.0), 2.0, 4.0]
    starts = [
        [np.log(max(white, 1e-5)), coloured, np.log(0.1), -6.0, follow]
        for coloured, follow in ((-6.0, -6.0), (-6.0, -0.5), (-0.5, -6.0))
    ]
    found = [
        minimize(loss, s, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)), options={"maxiter": 60})
        for s in starts
    ]
    best = min(found, key=lambda f: f.fun)
    v = variance(best.x)
    w, c, _, j, m = np.exp(best.x)
    each = -0.5 * (np.log(v) + power / v)
    return Fitted(
        float(each.sum()), float(np.sqrt(size * w)), float(np.sqrt(size * c)),
        float(np.sqrt(size * j)) / max(rate, 1e-300), float(np.sqrt(size * m)) / max(swing, 1e-300), each,
    )  # fmt: skip


def _memory(frequency: Array, samples: float) -> Array:
    """Return the spectrum of noise of variance one that forgets exponentially, shape (n,)."""
    a = np.exp(-1.0 / max(samples, 1e-3))
    return (1 - a * a) / (1 - 2 * a * np.cos(2 * np.pi * frequency) + a * a)
