"""The variants of friction, stop and relaxation: fitted to logs that scipy made by formulas written out here."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from made import decays, release
from scipy.integrate import solve_ivp

from sysid.effects import effect
from sysid.effects._base import JointState
from sysid.fitting.joint import fit_joint
from sysid.joint import JointLaw, simulate
from sysid.roll import Release
from sysid.synth.law import catalogue_law
from sysid.workspace import Workspace

INERTIA, K, D, NOISE = 8.7e-3, 14.684, 0.04, float(np.radians(0.05))
PLAIN_WITHOUT_DAMPER = JointLaw(inertia=INERTIA, stiffness=K, damping=0.0)
Inner = Callable[[float, float, Sequence[float]], tuple[float, list[float]]]
"""Torque and rates of the inner states from tilt, rate and inner states."""


def dahl(x: float, v: float, z: Sequence[float]) -> tuple[float, list[float]]:
    return -0.08 * z[0], [(v - abs(v) * z[0]) / 0.006]


def stop(x: float, v: float, z: Sequence[float]) -> tuple[float, list[float]]:
    return (-80.0 * (x + 0.09) - 0.1 * v if x < -0.09 else 0.0), []


def hanging(x: float, v: float, z: Sequence[float]) -> tuple[float, list[float]]:
    pull = 30.0**2 * (x - z[0]) + 2 * 0.05 * 30.0 * (v - z[1])
    return -0.001 * pull, [z[1], pull]


def loaded(x: float, v: float, z: Sequence[float]) -> tuple[float, list[float]]:
    return -(0.04 + 1.2 * abs(x)) * float(np.tanh(v / 1e-4)), []


def releases(law: Inner, held: Callable[[float], list[float]]) -> list[Release]:
    """Return three noisy releases of the joint with a law; `held` gives the inner states at a release angle."""
    rng, time, made = np.random.default_rng(1), np.arange(0.0, 2.0, 2.5e-3), []
    for number, angle in enumerate((0.17, -0.14, 0.1), start=1):

        def slope(_: float, y: Sequence[float]) -> list[float]:
            torque, inner = law(y[0], y[1], y[2:])
            return [y[1], (-K * y[0] - D * y[1] + torque) / INERTIA, *inner]

        path = solve_ivp(
            slope, (0.0, 2.0), [angle, 0.0, *held(angle)], t_eval=time, rtol=1e-8, atol=1e-10, max_step=2e-3
        )
        made.append(release(time, path.y[0], NOISE, rng=rng, number=number))
    return made


@pytest.mark.parametrize(
    ("name", "law", "held", "truth"),
    [
        ("dahl", dahl, lambda a: [np.sign(a) * (1 - np.exp(-abs(a) / 0.006))], (0.08, 0.006)),
        ("one-sided-stop", stop, lambda a: [], (-0.09, 80.0, 0.1)),
        ("hanging-body", hanging, lambda a: [a, 0.0], (0.001, 30.0, 0.05)),
        ("load-friction", loaded, lambda a: [], (0.04, 1.2)),
    ],
)
def test_a_fit_recovers_the_truth(
    name: str, law: Inner, held: Callable[[float], list[float]], truth: tuple[float, ...]
):
    board = Workspace(Path()).load_board("pink")
    fit = fit_joint(releases(law, held), board, [name])
    assert fit.rmse < 1.02 * NOISE
    for parameter, value in zip(effect(name).parameters, truth, strict=True):
        found = fit.quantities[f"{name}.{parameter.name}"]
        assert abs(found.value - value) < max(4 * found.std, 0.02 * abs(value)), (parameter.name, found)
        assert found.std < 0.15 * abs(value), (parameter.name, found)


def test_a_soft_stop_that_shows_after_many_swings_is_found_on_its_own_side():
    """No descent leads from one side to the other, and the first swings do not tell them apart."""
    law = JointLaw(inertia=INERTIA, stiffness=K, damping=0.0089).with_effect(
        "one-sided-stop", -0.0885, 0.84, 0.0
    )
    made = decays(law, (0.132, -0.106), np.arange(0.0, 3.5, 2e-3), 7e-4, seed=1)
    fit = fit_joint(made, Workspace(Path()).load_board("pink"), ["one-sided-stop"])
    assert fit.quantities["one-sided-stop.angle"].value == pytest.approx(-0.0885, abs=0.004)


@pytest.mark.parametrize("name", ["dahl", "one-sided-stop", "hanging-body"])
def test_a_variant_gives_no_energy_away(name: str):
    """Moved there and back for a while, by any path, from rest to rest, it takes work in."""
    law = catalogue_law(
        effect(name), {name: effect(name).example, "one-sided-stop": (0.03, 60.0, 0.2)}[name], K
    )
    rng, most = np.random.default_rng(0), 0.0
    for _ in range(5):
        f, a = rng.uniform(5, 60, 3), rng.uniform(-0.07, 0.07, 3)

        def motion(t: float, f=f, a=a) -> JointState:
            window, slope = np.sin(np.pi * t) ** 2, np.pi * np.sin(2 * np.pi * t)
            x, v = (a * np.sin(f * t)).sum(), (a * f * np.cos(f * t)).sum()
            return JointState(window * x, window * v + slope * x, window * x, K)

        def slope(t: float, y: Sequence[float], motion=motion) -> list[float]:
            at, z = motion(t), y[1:]
            return [
                -law.torque(at.tilt, at.rate, at.roll, z) * at.rate,
                *law.rates(at.tilt, at.rate, at.roll, z),
            ]

        path = solve_ivp(slope, (0.0, 1.0), [0.0, *law.at_rest()], rtol=1e-8, atol=1e-10, max_step=2e-3)
        assert path.y[0, -1] > -1e-9
        most = max(most, path.y[0, -1])
    assert most > 1e-3


def test_friction_that_grows_with_the_load_holds_a_tilted_deck_and_takes_the_same_share_of_each_swing():
    """With b below k it never sticks away from rest, with b above k it never leaves; each half swing is (k - b) / (k + b) of the last."""
    free = PLAIN_WITHOUT_DAMPER.with_effect("load-friction", 0.0, 1.2)
    stuck = PLAIN_WITHOUT_DAMPER.with_effect("load-friction", 0.0, 15.0)
    time = np.arange(0.0, 1.0, 1e-4)
    roll = simulate(free, time, 0.15).roll
    turns = np.abs(roll[1:-1][np.diff(np.sign(np.diff(roll))) != 0])
    # Of the way out the friction helps the spring, of the way home it holds it back.
    assert turns[1:5] / turns[:4] == pytest.approx(np.sqrt((K - 1.2) / (K + 1.2)), rel=1e-3)
    assert simulate(stuck, time, 0.15).roll == pytest.approx(0.15)
