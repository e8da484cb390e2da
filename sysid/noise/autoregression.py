"""Noise model of a fit's residuals: an autoregression.

Neighbouring residuals of a real log are correlated, because a sensor smooths or a model is not quite right.
Treated as independent they give intervals that are too narrow. A fit also absorbs the noise along its own
directions. The residuals then look smaller and less correlated than the noise; `residual_noise` corrects this.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.noise.whiteness import covariances, fft_size
from sysid.roll import Array

_LONGEST = 60
"""Highest order of the autoregression."""
_ROUNDS = 8
"""Largest number of corrections for the noise that the fit absorbed; each is a fraction of the one before."""


@dataclass(frozen=True, slots=True)
class ResidualNoise:
    """Stationary noise e with e_t = Σ a_i e_{t-i} + w_t and w white."""

    innovation: float
    """Variance of w, in the square of the signal's unit."""
    coefficients: Array
    """a_1, a_2, …; empty for white noise."""

    def spectrum(self, size: int) -> Array:
        """Return the power at the frequencies of a real FFT of that size, shape (size // 2 + 1,), in the square of the signal's unit."""
        shape = np.abs(np.fft.rfft(np.concatenate([[1.0], -self.coefficients]), size)) ** 2
        return self.innovation / np.maximum(shape, 1e-12)

    @property
    def std(self) -> float:
        """Standard deviation of one residual."""
        return float(np.sqrt(self.covariances(16384)[0]))

    @property
    def memory(self) -> float:
        """Over how many samples residuals are correlated: 1 + 2 Σ ρ, which is 1 for white noise."""
        return float(self.spectrum(16384)[0] / self.covariances(16384)[0])

    def covariances(self, size: int) -> Array:
        """Return the autocovariance at lags 0 to size / 2, shape (size // 2 + 1,), in the square of the signal's unit."""
        return np.fft.irfft(self.spectrum(size), size)[: size // 2 + 1]

    def applied(self, columns: Array) -> Array:
        """Return the noise's covariance times columns, shape (n, q) like them, in their unit times the square of the signal's."""
        if len(self.coefficients) == 0:
            return self.innovation * columns
        size = fft_size(2 * len(columns))
        power = self.spectrum(size)[:, None]
        return np.fft.irfft(power * np.fft.rfft(columns, size, axis=0), size, axis=0)[: len(columns)]

    def drawn(self, count: int, rng: np.random.Generator) -> Array:
        """Draw such noise, shape (count,), in the signal's unit."""
        from scipy.signal import lfilter

        lead = 20 * len(self.coefficients) + 200
        white = np.sqrt(self.innovation) * rng.standard_normal(count + lead)
        return np.asarray(lfilter([1.0], np.concatenate([[1.0], -self.coefficients]), white))[lead:]


def residual_noise(
    residuals: Sequence[Array], directions: Sequence[Array] | None = None, shared: int | None = None
) -> ResidualNoise:
    """Estimate the noise behind the residuals of a fit.

    The order of the autoregression is the one with the lowest BIC (VARHAC; den Haan and Levin 1998). The
    residuals of a linear fit are (1 - U Uᵀ) e. Their covariances are smaller than those of the noise e by a term
    of U and e. This term is added back iteratively.

    Args:
        residuals: Of each record, shape (n,), evenly sampled, in one unit.
        directions: Rows of each record of a matrix U, shape (n, p) each. Its orthonormal columns span the
            directions in which the fit can move. None: the residuals are the noise.
        shared: Number of first columns that all records have; the others of each record are zero in the rest. All if left out.
    """
    n = sum(len(r) for r in residuals)
    longest = min(_LONGEST, max(1, min(len(r) for r in residuals) // 8))
    seen = sum((covariances(r, r, longest) for r in residuals), np.zeros(longest + 1)) / n
    noise = autoregression(seen, n)
    for _ in range(_ROUNDS if directions and noise.innovation > 0 else 0):
        moved = [noise.applied(u) for u in directions or ()]
        inner = [u.T @ v for u, v in zip(directions or (), moved, strict=True)]
        together = sum((one[:shared, :shared] for one in inner), np.zeros(()))
        taken = np.zeros(longest + 1)
        for u, v, own in zip(directions or (), moved, inner, strict=True):
            # 2 sym(U Uᵀ R) - U (Uᵀ R U) Uᵀ, summed along its diagonals.
            own[:shared, :shared] = together
            rest = 2 * v - u @ own
            taken += 0.5 * (covariances(u, rest, longest) + covariances(rest, u, longest))
        before, noise = noise, autoregression(seen + taken / n, n)
        if abs(noise.std / max(before.std, 1e-300) - 1) < 1e-3:
            break
    return noise


def autoregression(covariances: Array, count: int) -> ResidualNoise:
    """Return the autoregression of the lowest BIC for covariances at lags 0, 1, … of `count` samples.

    Levinson–Durbin. The recursion stops at an order at which the covariances are no longer those of stationary noise.

    Args:
        covariances: In the square of the signal's unit, shape (lags,).
    """
    variance = float(covariances[0])
    if not variance > 0:
        return ResidualNoise(max(variance, 0.0), np.zeros(0))
    coefficients = np.zeros(0)
    best = count * np.log(variance), variance, coefficients
    for order in range(1, len(covariances)):
        reflection = (covariances[order] - coefficients @ covariances[order - 1 : 0 : -1]) / variance
        if not abs(reflection) < 1:
            break
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        variance *= 1 - reflection**2
        score = count * np.log(variance) + order * np.log(count)
        if score < best[0]:
            best = score, variance, coefficients
    return ResidualNoise(float(best[1]), best[2])
