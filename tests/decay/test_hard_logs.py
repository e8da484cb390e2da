"""Logs that are easily read wrong: each is approved, with the truth in its intervals."""

import numpy as np
import pytest
from decay_suite import free, judged

from sysid.free_decay import fit_decay
from sysid.recording import Recording

HARD = [
    ("caught", 731800006),  # held beside its rest and put back slowly, as dry friction might hold it
    ("caught", 731800003),
    ("geared", 731700003),  # the lift is as long as the return
    ("critical", 731700004),  # lifts and returns alternate like swings
    ("wander", 731800003),  # rest levels that a random walk of the sensor moves
    ("pendulum", 731700000),
    ("pendulum", 731700003),
    ("touched", 9200014),  # a light hand stops a swing of five times the noise
    ("touched", 9200048),
    ("caught", 9300017),
]


@pytest.mark.parametrize(("kind", "seed"), HARD)
def test_a_hard_log_is_approved_with_its_truth(kind, seed):
    row = judged((kind, seed))
    assert row["status"] == "linear", row["text"]
    assert all(row["held"])


@pytest.mark.parametrize("seed", [9300004, 9300022])
def test_friction_that_stops_a_joint_is_no_hand(seed):
    assert judged(("friction", seed))["status"] == "not linear"


def test_one_swing_of_a_leg_that_friction_stops_gets_no_tick():
    """Without its stop the swing is that of a pendulum to the noise, with a stiffness 10 % too low."""
    time = np.arange(0, 1.85, 2e-3)
    angle, _ = free(
        time, 6.94, 0.514, 1.2, 0.0, lambda x, v: 48.2 * (np.sin(x) - x) + 5.88 * np.tanh(v / 0.01)
    )
    angle += np.random.default_rng(1).normal(0, 4.5e-4, time.size)
    assert not fit_decay(Recording.from_arrays(time, angle=angle)).linear


@pytest.mark.parametrize("rate", [False, True])
def test_the_noise_of_a_wide_pendulum_stays_out_of_its_numbers(rate):
    """Its sine is taken of the modelled angle: one measured with noise would drive the model like a torque."""
    time = np.arange(0, 40, 1 / 30)
    omega, zeta = 4.833, 0.00414
    angle, speed = free(time, omega, zeta, 0.75, 0.0, lambda x, v: omega**2 * (np.sin(x) - x))
    noise = np.random.default_rng(3).normal(0, 1e-3, time.size)
    log = (
        Recording.from_arrays(time, rate=speed + omega * noise)
        if rate
        else Recording.from_arrays(time, angle=angle + noise)
    )
    decay = fit_decay(log)
    assert (decay.linear, decay.trace.law) == (True, "pendulum")
    assert "sin φ" in decay.report()
    assert decay.judgement.over_noise == pytest.approx(1, abs=0.1)
    for found, truth in ((decay.numbers.omega_n, omega), (decay.numbers.damping_ratio, zeta)):
        assert abs(found.value - truth) < 4 * found.std < 3e-3 * truth
