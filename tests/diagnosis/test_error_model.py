"""The error model: noise, jitter and a discrepancy that follows the motion are told apart."""

import numpy as np
import pytest

from sysid.diagnosis.error_model import Rounding, blocks_of, fit_errors

STEP, PERIOD = 4e-3, 0.16
TIME = np.arange(0.0, 4.0, STEP)
OMEGA = 2 * np.pi / PERIOD
SWING = 0.15 * np.exp(-0.8 * TIME) * np.cos(OMEGA * TIME)
RATE = np.gradient(SWING, STEP)


@pytest.fixture(scope="module")
def blocks():
    return blocks_of([SWING] * 3, [RATE] * 3, [STEP] * 3, PERIOD)


def noise(seed, *, white=0.0, coloured=0.0, jitter=0.0, discrepancy=0.0):
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)

    def slow(memory):
        a = np.exp(-STEP / memory)
        drawn = lfilter([np.sqrt(1 - a * a)], [1, -a], rng.standard_normal(len(TIME) + 500))
        return np.asarray(drawn)[500:]

    envelope = 0.15 * np.exp(-0.8 * TIME)
    return (
        white * rng.standard_normal(len(TIME)) + coloured * slow(0.03)
        + jitter * rng.standard_normal(len(TIME)) * RATE + discrepancy * envelope * slow(PERIOD / 8)
    )  # fmt: skip


def test_white_noise_is_white(blocks):
    fitted = fit_errors(blocks, [noise(i, white=1e-3) for i in range(3)])
    assert fitted.white == pytest.approx(1e-3, rel=0.05)
    assert fitted.discrepancy < 0.003
    assert fitted.coloured < 3e-4


def test_time_stamps_that_jitter_are_told_from_noise(blocks):
    fitted = fit_errors(blocks, [noise(i, white=3e-4, jitter=4e-4) for i in range(3)])
    assert fitted.jitter == pytest.approx(4e-4, rel=0.15)
    assert fitted.white == pytest.approx(3e-4, rel=0.1)


def test_a_discrepancy_is_a_share_of_the_swing(blocks):
    fitted = fit_errors(blocks, [noise(i, white=3e-4, discrepancy=0.03) for i in range(3)])
    assert 0.015 < fitted.discrepancy < 0.045


def test_coloured_noise_stays_when_the_motion_has_faded(blocks):
    fitted = fit_errors(blocks, [noise(i, white=3e-4, coloured=2e-3) for i in range(3)])
    assert fitted.coloured == pytest.approx(2e-3, rel=0.2)
    assert fitted.discrepancy < 0.02


def test_the_smaller_error_is_the_likelier_by_what_it_is_smaller(blocks):
    """White errors a tenth larger: n ln 1.1 less likely, each with its own size fitted."""
    small, large = ([scale * noise(i, white=1e-3) for i in range(3)] for scale in (1.0, 1.1))
    gap = fit_errors(blocks, small).log_likelihood - fit_errors(blocks, large).log_likelihood
    assert gap == pytest.approx(3 * len(TIME) * np.log(1.1), rel=0.01)


def test_a_reading_that_stays_says_the_same_again():
    """A deck that rests within a step of its sensor: how far beside, its readings tell once a block, however many there are."""
    step = 4e-4
    readings = np.round(SWING * np.exp(-3 * TIME) / step) * step
    rounding = [Rounding(step, readings, 1)] * 3
    plain, known = (
        blocks_of([SWING * np.exp(-3 * TIME)] * 3, [RATE] * 3, [STEP] * 3, PERIOD, r) for r in ((), rounding)
    )
    rng = np.random.default_rng(0)
    moves = step / np.sqrt(12) * rng.standard_normal((3, len(TIME))) * (np.abs(readings) > 0)
    near, far = ([m + beside * (readings == 0) for m in moves] for beside in (2e-5, 1e-4))
    told = [fit_errors(b, near).log_likelihood - fit_errors(b, far).log_likelihood for b in (plain, known)]
    assert told[1] < 0.3 * told[0]


def test_steps_that_the_motion_passes_at_every_reading_are_white_noise():
    step = 4e-4
    rounding = Rounding(step, np.arange(400.0) * step, 4)
    frequency = np.arange(100) / 200
    assert rounding.variance(frequency, 0, 100) == pytest.approx(step**2 / 12 / 4)
