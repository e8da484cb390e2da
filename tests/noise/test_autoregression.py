"""The noise behind residuals: size and memory recovered, and what the fit took made good."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.noise.autoregression import ResidualNoise, residual_noise


def smooth_columns(n: int, q: int) -> np.ndarray:
    """Orthonormal directions as a fit has: slow waves."""
    t = np.linspace(0, 1, n)
    return np.linalg.qr(np.column_stack([np.cos(np.pi * i * t) for i in range(q)]))[0]


def made(rho: float, n: int, rng: np.random.Generator) -> np.ndarray:
    return ResidualNoise(1 - rho**2, np.array([rho]) if rho else np.zeros(0)).drawn(n, rng)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_size_and_memory_are_not_biased_by_the_fit(rho):
    """Twelve fitted directions in 600 samples take a fifth of the slow power away."""
    rng, u = np.random.default_rng(1), smooth_columns(600, 12)
    fitted, naive = [], []
    for _ in range(200):
        noise = made(rho, 600, rng)
        left = noise - u @ (u.T @ noise)
        fitted.append(residual_noise([left], [u]))
        naive.append(residual_noise([left]))
    memory = (1 + rho) / (1 - rho)
    assert np.mean([f.std**2 for f in fitted]) == pytest.approx(1.0, abs=0.04)
    assert np.mean([f.memory for f in fitted]) == pytest.approx(memory, rel=0.08)
    if rho:
        assert np.mean([f.memory for f in naive]) < 0.93 * memory


def test_scatter_of_a_linear_fit_is_foretold():
    """Covariance of the fitted coefficients against what the noise model says, AR(1) noise."""
    rng, u = np.random.default_rng(2), smooth_columns(500, 6)
    draws = np.array([u.T @ made(0.8, 500, rng) for _ in range(3000)])
    expected = u.T @ ResidualNoise(1 - 0.64, np.array([0.8])).applied(u)
    assert np.cov(draws.T) == pytest.approx(expected, abs=0.08 * expected.max())


def test_longer_memories_and_waves():
    rng = np.random.default_rng(3)
    white = rng.standard_normal(20_000)
    coefficients = np.array([1.6, -0.8])
    wave = lfilter([1.0], [1.0, *-coefficients], white)
    found = residual_noise([wave[:9000], wave[9000:]])
    assert found.coefficients[:2] == pytest.approx(coefficients, abs=0.05)
    assert found.std == pytest.approx(float(np.std(wave)), rel=0.03)
