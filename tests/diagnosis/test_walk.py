"""Residuals of a right law beside a wandering zero are white noise again; a missing law is no walk."""

from types import SimpleNamespace

import numpy as np
import pytest

from sysid.diagnosis.nuisances import DRIFT
from sysid.diagnosis.walk import error_beside, likeliest_gain

NOISE, WIDE, FREQUENCY, STEP = 1e-3, 0.4, 6.0, 0.01


def fit(residuals, *, is_rate=False, counts=False):
    """Return what the walk asks of a fit."""
    time = STEP * np.arange(len(residuals[0]))
    signal = WIDE * np.cos(FREQUENCY * time)
    record = SimpleNamespace(is_rate=is_rate, time=time, signal=signal)
    return SimpleNamespace(
        residuals=residuals,
        records=[record],
        noise=SimpleNamespace(std=NOISE, highest=1.03 * NOISE, counts=counts),
        law=SimpleNamespace(frequency=FREQUENCY),
    )


def residuals(walk, seed, wave=0.0):
    """Return residuals of two releases: noise, a random walk of a deviation in the square root of a period, and a wave."""
    rng, n = np.random.default_rng(seed), 4000
    step = walk * np.sqrt(STEP * FREQUENCY / (2 * np.pi))
    wave = wave * np.sin(FREQUENCY * STEP * np.arange(n))
    return tuple(
        NOISE * rng.standard_normal(n) + np.cumsum(step * rng.standard_normal(n)) + wave for _ in range(2)
    )


@pytest.mark.parametrize("seed", range(3))
def test_beside_a_walk_the_noise_is_left(seed):
    walked = residuals(0.5 * DRIFT * WIDE, seed)
    gain = likeliest_gain([fit(walked)])
    assert gain > 0
    assert error_beside(walked, gain) == pytest.approx(NOISE, rel=0.03)
    assert error_beside(walked, 0.0) > 2 * NOISE


def test_noise_alone_has_no_walk():
    white = residuals(0.0, 5)
    assert error_beside(white, likeliest_gain([fit(white)])) == pytest.approx(NOISE, rel=0.03)


def test_a_missing_law_is_no_walk():
    assert likeliest_gain([fit(residuals(0.0, 6, wave=0.05))]) == 0.0


def test_the_zero_of_a_rate_or_a_counter_does_not_wander():
    walked = residuals(0.5 * DRIFT * WIDE, 7)
    assert likeliest_gain([fit(walked, is_rate=True)]) == 0.0
    assert likeliest_gain([fit(walked, counts=True)]) == 0.0
