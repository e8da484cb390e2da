"""How residuals are judged where the zero of a sensor wanders: white noise beside a random walk.

The best prediction of such a residual is a first-order filter with the gain K of a stationary Kalman filter. Its innovations are white
with variance σ²/(1 - K), where σ is the sensor's noise:

    e_k = r_k - x_k,   x_{k+1} = x_k + K e_k.

Source: Grewal and Andrews, Kalman Filtering, 2015, section 4.9 (the scalar stationary case).
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_banded

from sysid.diagnosis.nuisances import DRIFT
from sysid.fitting.result import JointFit
from sysid.roll import Array

GAINS = 6
"""Sizes of the walk that are tried, each half of the one before, from the prior deviation of the equations on."""


def innovations(residuals: Sequence[Array], gain: float) -> Array:
    """Return the innovations of residuals, shape (s,) each, over √(1 / (1 - K)), all in one, shape (n,), in their unit [rad or rad/s]."""
    if not gain:
        return np.concatenate(list(residuals))
    # e_k - (1 - K) e_{k-1} = r_k - r_{k-1}; importing scipy.signal takes longer than a fit
    bands = [np.vstack([np.ones(len(r)), np.full(len(r), gain - 1)]) for r in residuals]
    steps = [np.diff(r, prepend=0.0) for r in residuals]
    filtered = [solve_banded((1, 0), band, step) for band, step in zip(bands, steps, strict=True)]
    return np.concatenate(filtered) * float(np.sqrt(1 - gain))


def error_beside(residuals: Sequence[Array], gain: float) -> float:
    """Return the RMS of residuals, shape (s,) each, beside a walk of the zero [rad or rad/s]."""
    return float(np.sqrt(np.mean(innovations(residuals, gain) ** 2)))


def likeliest_gain(fits: Sequence[JointFit]) -> float:
    """Return the gain K that makes the residuals of the best of some fits of the same releases the likeliest.

    It is 0 for a rate, and for a sensor that counts steps: a counter keeps its zero. It is also 0 unless a walk and a law explain the log to its noise: a missing law is no walk.
    """
    fit = fits[0]
    if fit.records[0].is_rate or fit.noise.counts:
        return 0.0
    noise, frequency = fit.noise.std, fit.law.frequency
    step = float(np.median(np.diff(fit.records[0].time)))
    widest = max(float(np.ptp(r.signal)) for r in fit.records) / 2
    most = DRIFT * widest * np.sqrt(step * frequency / (2 * np.pi))

    def cost(gain: float) -> float:
        error = min(error_beside(one.residuals, gain) for one in fits)
        samples = sum(len(r) for r in fit.residuals)
        return 0.5 * samples * ((error / noise) ** 2 - float(np.log1p(-gain)))

    shares = [(most / 2**i / noise) ** 2 for i in range(GAINS)]
    gains = [float(np.sqrt(s * s + 4 * s) - s) / 2 for s in shares]
    likeliest = min([0.0, *gains], key=cost)
    left = min(error_beside(one.residuals, likeliest) for one in fits)
    return likeliest if left <= fit.noise.highest else 0.0
