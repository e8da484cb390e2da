"""The synthetic truth against closed forms, matrix exponentials and a brute-force integrator."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from sysid.synth.hand import hand_motion
from sysid.synth.law import TrueLaw
from sysid.synth.motion import Condition, simulate

PINK = {"inertia": 8.7e-3, "stiffness": 14.684, "damping": 0.40221}
LIGHT = {**PINK, "damping": 0.03}
KINKED = {
    "coulomb": {"friction": 0.06, "static_friction": 0.06},
    "stribeck": {"friction": 0.05, "static_friction": 0.12, "stribeck_velocity": 0.4},
    "load-friction": {"friction": 0.04, "static_friction": 0.04, "friction_growth": 1.2},
    "quadratic": {"quadratic_damping": 0.01},
    "cubic-damping": {"cubic_damping": 0.002},
    "cubic": {"cubic_stiffness": 150.0},
    "even": {"even_stiffness": 20.0},
    "gravity": {"gravity": -3.0},
    "end-stop": {"stop_angle": 0.1, "stop_stiffness": 120.0, "stop_damping": 0.05},
    "freeplay": {"half_gap": 0.02},
    "preload": {"preload": 0.2},
    "offset": {"rest": 0.02},
    "arm": {"arm_stiffness": 5.0, "arm_time": 0.03},
    "slider": {"slider_stiffness": 6.0, "slider_torque": 0.15},
    "support": {"support_inertia": 0.02, "support_stiffness": 200.0, "support_damping": 0.1},
    "support and friction": {
        "support_inertia": 0.02, "support_stiffness": 200.0, "support_damping": 0.1,
        "friction": 0.06, "static_friction": 0.06,
    },
    "arm and friction": {"arm_stiffness": 5.0, "arm_time": 0.03, "friction": 0.06, "static_friction": 0.06},
    "stop, gap and slider": {
        "stop_angle": 0.1, "stop_stiffness": 120.0, "half_gap": 0.01, "slider_stiffness": 6.0,
        "slider_torque": 0.15,
    },
}  # fmt: skip


def released(law: TrueLaw, roll: float, rate: float = 0.0) -> Condition:
    """At rest, then put to a roll without any memory of the way."""
    condition = Condition.at_rest(law)
    state = condition.state.copy()
    state[:2] = roll, rate
    return Condition(state, condition.modes.regions(law, roll - float(state[2]) - law.rest))


def run(law: TrueLaw, roll: float = 0.17, seconds: float = 1.0, **tolerances: float) -> np.ndarray:
    time = np.arange(0, seconds, 1e-3)
    return simulate(law, released(law, roll), 0.0, seconds, time, accelerations=True, **tolerances)[0]


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


def brute_force(law: TrueLaw, roll: float, seconds: float, substeps: int) -> np.ndarray:
    """Semi-implicit steps of a few microseconds with the effects' table written out once more."""
    step = 1e-3 / substeps
    phi, v, s, w, z, slider = roll, 0.0, Condition.at_rest(law).state[2], 0.0, 0.0, 0.0
    if law.slider_stiffness:  # untouched at the equilibrium, so already yielding at the release
        reach = law.slider_torque / law.slider_stiffness
        slider = float(np.clip(roll - law.equilibrium(), -reach, reach)) * law.slider_stiffness
    path = []
    for count in range(round(seconds * 1e3) * substeps):
        if count % substeps == 0:
            path.append(phi)
        x, u = phi - s - law.rest, v - w
        torque = -law.stiffness * (x - min(max(x, -law.half_gap), law.half_gap)) - law.damping * u
        torque -= law.quadratic_damping * u * abs(u) + law.cubic_damping * u**3
        torque -= law.even_stiffness * x**2 + law.cubic_stiffness * x**3
        if abs(x) > law.stop_angle:
            torque -= law.stop_stiffness * (x - math.copysign(law.stop_angle, x)) + law.stop_damping * u
        torque += law.preload - law.arm_stiffness * z - slider
        outside = -law.gravity * math.sin(phi)
        support = -law.support_stiffness * s - law.support_damping * w
        # Friction: as much as it takes to stop the joint within the step, but no more than it has.
        ease = 1 / law.inertia + (1 / law.support_inertia if law.support_inertia else 0.0)
        drift = (torque + outside) / law.inertia
        if law.support_inertia:
            drift -= (support - torque) / law.support_inertia
        most = law.friction + (law.static_friction - law.friction) * math.exp(
            -((u / law.stribeck_velocity) ** 2)
        )
        most += law.friction_growth * abs(x)
        friction = min(max(-(u / step + drift) / ease, -most), most)
        v += step * (torque + outside + friction) / law.inertia
        if law.support_inertia:
            w += step * (support - torque - friction) / law.support_inertia
        phi, s = phi + step * v, s + step * w
        z += step * ((v - w) - z / law.arm_time)
        if law.slider_stiffness:
            slider = min(
                max(slider + law.slider_stiffness * step * (v - w), -law.slider_torque), law.slider_torque
            )
    return np.array(path)


@pytest.mark.parametrize("name", KINKED)
def test_every_effect_agrees_with_brute_force(name: str) -> None:
    """Two step lengths and Richardson's extrapolation, so that the first-order error does not hide a fault."""
    law = TrueLaw(**{**LIGHT, **KINKED[name]})
    start = 0.17
    samples, _ = simulate(law, led_over(law, start), 0.0, 0.3, np.arange(0, 0.3, 1e-3))
    coarse, fine = brute_force(law, start, 0.3, 20), brute_force(law, start, 0.3, 40)
    assert np.abs(samples[:, 0] - (2 * fine - coarse)).max() < 1e-4
    without = run(TrueLaw(**LIGHT), seconds=0.3)[:, 0]
    assert np.abs(samples[:, 0] - without).max() > 1e-3, "the effect changes nothing, in both"


def led_over(law: TrueLaw, roll: float) -> Condition:
    """Released from `roll` with the slider as a slow push leaves it, and arm and support as at rest."""
    condition = released(law, roll)
    if not law.slider_stiffness:
        return condition
    reach = law.slider_torque / law.slider_stiffness
    x, virgin = roll - law.rest, condition.modes.origin
    origin = x - float(np.clip(x - virgin, -reach, reach))
    return Condition(condition.state, type(condition.modes)(**{
        **{field: getattr(condition.modes, field) for field in condition.modes.__slots__}, "origin": origin
    }))  # fmt: skip


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
