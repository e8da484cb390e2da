"""Autocorrelation of residuals, and its length."""

from collections.abc import Sequence

import numpy as np

from sysid.roll import Array


def covariances(left: Array, right: Array, lags: int) -> Array:
    """Return Σ_t left[t] · right[t + lag] for lags 0 to `lags`, of signals of shape (n,) or (n, p) summed over p."""
    size = fft_size(len(left) + lags + 1)
    product = np.conj(np.fft.rfft(left, size, axis=0)) * np.fft.rfft(right, size, axis=0)
    return np.fft.irfft(product.reshape(len(product), -1).sum(axis=1), size)[: lags + 1]


def fft_size(count: int) -> int:
    """Return the power of two from `count` on."""
    return 1 << (count - 1).bit_length()


def autocorrelation(residuals: Sequence[Array], lags: int) -> Array:
    """Return the pooled autocorrelation (dimensionless) of residuals for lags 0 to `lags`, shape (lags + 1,)."""
    total = sum((covariances(residual, residual, lags) for residual in residuals), np.zeros(lags + 1))
    return total / max(total[0], 1e-300)


def lag_one(residuals: Sequence[Array]) -> float:
    """Return the correlation of successive residuals [1], each of shape (n,) in any unit; 0 unless significantly positive."""
    count = sum(len(residual) for residual in residuals)
    power = sum(float(residual @ residual) for residual in residuals)
    if power == 0 or count < 10:
        return 0.0
    rho = sum(float(residual[1:] @ residual[:-1]) for residual in residuals) / power
    return min(rho, 0.999) if rho > 2.5 / np.sqrt(count) else 0.0


def correlation_length(residuals: Sequence[Array]) -> float:
    """Return the correlation length of residuals [samples]: 1 + 2 Σ ρ up to the first insignificant lag.

    Args:
        residuals: Of each release, shape (n,), in any unit.
    """
    n = sum(len(r) for r in residuals)
    longest = max(2, min(max(len(r) for r in residuals) // 4, 2000))
    rho = autocorrelation(residuals, longest)[1:]
    small = np.flatnonzero(rho < 2.0 / np.sqrt(n))
    end = int(small[0]) if len(small) else len(rho)
    return float(1 + 2 * np.sum(rho[:end]))
