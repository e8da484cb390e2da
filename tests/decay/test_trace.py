"""Errors that last from frame to frame: what decay makes of a film's roll."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from decay_truth import linear_decay
from made import release

from sysid.decay.linear_fit import fit_traces
from sysid.fitting.joint import FitOptions, fit_joint
from sysid.free_decay import fit_decay
from sysid.noise.lasting import PER_PERIOD
from sysid.workspace import Workspace

OMEGA, ZETA = 41.083, 0.56265
STD = np.radians(0.05)


def errors(time, rng):
    """An Ornstein–Uhlenbeck process of unit variance that lasts for an eighth of the period."""
    kept = np.exp(-np.diff(time) * OMEGA * PER_PERIOD / np.pi)
    x = np.empty(len(time))
    x[0] = rng.normal()
    for i, share in enumerate(kept, start=1):
        x[i] = share * x[i - 1] + np.sqrt(1 - share**2) * rng.normal()
    return x


def filmed(seed, *, rate=120.0, own=True, slant=0.0, jitter=0.0):
    """Two releases with lasting errors; a slant shrinks the swing and widens the deviations with it."""
    rng = np.random.default_rng(seed)
    releases = []
    for number, angle in enumerate((0.35, -0.3), start=1):
        steps = 1 / rate * (1 + jitter * rng.uniform(-1, 1, round(0.45 * rate)))
        time = np.cumsum(steps) - steps[0]
        roll, _ = linear_decay(time, OMEGA, ZETA, angle)
        seen = (1 - slant) * roll + STD * errors(time, rng)
        stated = {
            "std": np.hypot(STD, 0.02 * np.abs(roll)),
            "own_std": np.full(len(time), STD) if own else None,
        }
        filmed_by = {"origin": "video", "zero": "constant", "errors_last": True, "hold": 0.2, "end": "rest"}
        releases.append(release(time, seen, number=number, **stated, **filmed_by))
    return releases


def stiffness(releases):
    """k over the true one, and its standard deviation."""
    fit = fit_traces(releases)
    return (fit.omega_n / OMEGA) ** 2, np.sqrt(fit.covariance[0, 0]) * (fit.omega_n / OMEGA) ** 2


@pytest.mark.parametrize(("rate", "jitter"), [(60.0, 0.0), (240.0, 0.3)])
def test_intervals_of_a_film_hold_at_any_rate(rate, jitter):
    found = np.array([stiffness(filmed(seed, rate=rate, jitter=jitter)) for seed in range(60)])
    score = (found[:, 0] - 1) / found[:, 1]
    assert np.mean(np.abs(score) < 1.96) > 0.95 - 3 * 0.028  # of 60 logs
    assert np.std(score) == pytest.approx(1.0, abs=3 / np.sqrt(2 * 60))


def test_a_slant_does_not_take_the_weight_from_the_large_swing():
    apart = np.array(
        [[stiffness(filmed(seed, own=own, slant=0.01))[0] - 1 for own in (True, False)] for seed in range(24)]
    )
    assert np.sqrt(np.mean(apart[:, 0] ** 2)) < 0.85 * np.sqrt(np.mean(apart[:, 1] ** 2))


def test_lasting_errors_of_a_film_are_no_other_law():
    """Scatter shows half of what a camera that shakes adds: that was more than a linear decay leaves."""
    time = np.arange(150) / 60
    swing, _ = linear_decay(time, OMEGA / 2, 0.08, 0.15)
    harder, _ = linear_decay(time + 0.03 * np.exp(-2 * time), OMEGA / 2, 0.08, 0.15)

    def linear(roll, seed):
        roll = roll + 2 * STD * errors(time / 2, np.random.default_rng(seed))
        stated = np.full(150, 2 * STD)
        one = replace(filmed(0)[0], time=time, roll=roll, std=stated, own_std=stated)
        return fit_decay([one]).linear

    assert np.mean([linear(swing, seed) for seed in range(8)]) > 0.8
    assert not any(linear(harder, seed) for seed in range(8))


def test_intervals_of_a_fit_hold_for_a_short_film():
    """27 frames of one release: too few for their errors to be seen to last, so the fit takes them up."""
    board = Workspace(Path()).load_board("pink")
    fits = [fit_joint(filmed(seed, rate=60.0)[:1], board, (), FitOptions()) for seed in range(30)]
    truth = board.inertia.value * OMEGA**2
    score = np.array(
        [(fit.quantities["stiffness"].value - truth) / fit.quantities["stiffness"].std for fit in fits]
    )
    assert np.mean(np.abs(score) < 1.96) > 0.95 - 3 * 0.04  # of 30 logs
    assert np.std(score) == pytest.approx(1.0, abs=3 / np.sqrt(2 * 30))
