"""The synthetic truth against closed forms and matrix exponentials.

`tests/joint/test_two_accounts.py` compares every effect with the integrator of the fit.
"""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from sysid.synth.hand import hand_motion
from sysid.synth.law import TrueLaw
from sysid.synth.motion import Condition, simulate

PINK = {"inertia": 8.7e-3, "stiffness": 14.684, "damping": 0.40221}


def released(law: TrueLaw, roll: float, rate: float = 0.0) -> Condition:
    """At rest, then put to a roll without any memory of the way."""
    condition = Condition.at_rest(law)
    state = condition.state.copy()
    state[:2] = roll, rate
    return Condition(state, condition.modes.regions(law, roll - float(state[2]) - law.rest))


def run(law: TrueLaw, roll: float = 0.17, seconds: float = 1.0) -> np.ndarray:
    time = np.arange(0, seconds, 1e-3)
    return simulate(law, released(law, roll), 0.0, seconds, time, accelerations=True)[0]


def linear_decay(law: TrueLaw, time: np.ndarray, x0: float, v0: float = 0.0) -> np.ndarray:
    natural = math.sqrt(law.stiffness / law.inertia)
    rate = law.damping / (2 * law.inertia)
    damped = math.sqrt(natural**2 - rate**2)
    return np.exp(-rate * time) * (
        x0 * np.cos(damped * time) + (v0 + rate * x0) / damped * np.sin(damped * time)
    )


@pytest.mark.parametrize("damping", [0.0, 0.03, 0.40221, 0.6])
def test_linear_motion_is_the_closed_form(damping: float) -> None:
    law = TrueLaw(**{**PINK, "damping": damping})
    time = np.arange(0, 1, 1e-3)
    assert np.abs(run(law)[:, 0] - linear_decay(law, time, 0.17)).max() < 5e-8


def coulomb_closed_form(law: TrueLaw, time: np.ndarray, x0: float) -> np.ndarray:
    """Half-cycle after half-cycle: a linear decay about ±F/k, until the spring cannot overcome friction."""
    natural = math.sqrt(law.stiffness / law.inertia)
    rate = law.damping / (2 * law.inertia)
    half = math.pi / math.sqrt(natural**2 - rate**2)
    shift = law.friction / law.stiffness
    roll, start, begin = np.empty_like(time), x0, 0.0
    while abs(start) > shift:
        centre = math.copysign(shift, start)
        part = (time >= begin) & (time < begin + half)
        roll[part] = centre + linear_decay(law, time[part] - begin, start - centre)
        start = centre - (start - centre) * math.exp(-rate * half)
        begin += half
    roll[time >= begin] = start
    return roll


@pytest.mark.parametrize("damping", [0.0, 0.03, 0.4])
@pytest.mark.parametrize("friction", [0.02, 0.1, 0.5])
def test_dry_friction_is_the_closed_form_and_sticks(damping: float, friction: float) -> None:
    law = TrueLaw(**{**PINK, "damping": damping}, friction=friction, static_friction=friction)
    samples = run(law, seconds=2.0)
    time = np.arange(0, 2, 1e-3)
    expected = coulomb_closed_form(law, time, 0.17)
    assert np.abs(samples[:, 0] - expected).max() < 1e-7
    if expected[-1] == expected[-100]:  # it has stopped: exactly, and where the spring is outweighed
        assert np.ptp(samples[-50:, 0]) == 0.0
        assert np.all(samples[-50:, 1] == 0.0)
        assert abs(law.stiffness * samples[-1, 0]) <= friction


@pytest.mark.parametrize("phase", [0.0, 0.3, 0.7, 1.2])
def test_stop_that_is_only_grazed_is_not_stepped_over(phase: float) -> None:
    """The deck is beyond the stop for a fraction of one step; its peak follows from energy."""
    k, ks, edge, top = 14.684, 100.0, 0.0995, 0.1
    law = TrueLaw(inertia=8.7e-3, stiffness=k, damping=0.0, stop_angle=edge, stop_stiffness=ks)
    natural = math.sqrt(k / law.inertia)
    start = released(law, top * math.sin(phase), top * natural * math.cos(phase))
    time = np.linspace(0, (math.pi - phase) / natural, 20_000)
    samples, _ = simulate(law, start, 0.0, float(time[-1]), time)
    peak = (ks * edge + math.sqrt((ks * edge) ** 2 - (k + ks) * (ks * edge**2 - k * top**2))) / (k + ks)
    assert samples[:, 0].max() == pytest.approx(peak, abs=1e-8)


@pytest.mark.parametrize("seed", [3, 8])
def test_arm_forgets_the_hold(seed: int) -> None:
    """The arm's stretch at the release is the fading integral of the hand's rate; then it is a linear system.

    A step over a knot of the hand's spline would be wrong by 1e-6 rad with the second seed.
    """
    law = TrueLaw(**PINK, arm_stiffness=6.0, arm_time=0.2)
    rng = np.random.default_rng(seed)
    hand = hand_motion(0.0, (0.0, 0.0), 0.15, push=0.4, hold=0.3, tremor=1e-3, rng=rng)
    _, condition = simulate(
        law, Condition.at_rest(law), 0.0, hand.end, np.empty(0), hand, tolerances=(1e-11, 1e-13)
    )
    grid = np.linspace(0.0, hand.end, 200_001)
    faded = hand.sample(grid)[:, 1] * np.exp((grid - hand.end) / law.arm_time)
    z = float(np.sum((faded[1:] + faded[:-1]) / 2 * np.diff(grid)))
    assert condition.state[4] == pytest.approx(z, abs=1e-11)
    assert condition.state[:2] == pytest.approx(hand.sample(np.array([hand.end]))[0, :2], abs=1e-11)
    matrix = np.array(
        [
            [0, 1, 0],
            [-law.stiffness / law.inertia, -law.damping / law.inertia, -6.0 / law.inertia],
            [0, 1, -5.0],
        ]
    )
    time = np.linspace(0, 0.5, 50)
    samples, _ = simulate(law, condition, 0.0, 0.5, time)
    start = condition.state[[0, 1, 4]]
    assert samples[:, 0] == pytest.approx([(expm(matrix * t) @ start)[0] for t in time], abs=1e-7)


@pytest.mark.parametrize("seed", range(2))
def test_hand_takes_over_without_a_jump_and_holds(seed: int) -> None:
    hand = hand_motion(
        1.0, (0.03, -0.4), -0.12, push=0.5, hold=0.8, tremor=1e-3, rng=np.random.default_rng(seed)
    )
    time = np.linspace(1.0, hand.end, 20_000)
    samples = hand.sample(time)
    assert samples[0, :2] == pytest.approx([0.03, -0.4])
    assert np.abs(np.gradient(samples[:, 0], time) - samples[:, 1])[1:-1].max() < 1e-3
    held = samples[time > 1.5 + 0.2, 0]
    assert np.abs(held + 0.12).max() < 3e-3
    assert 5e-4 < held.std() < 2e-3
    assert hand.acceleration(1.6) == pytest.approx(np.interp(1.6, time, samples[:, 2]), rel=1e-3)
