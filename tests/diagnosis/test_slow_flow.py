"""Amplitude and phase of a light decay: averaged laws are the textbook's, and cycles follow them."""

import numpy as np
import pytest
from decay_truth import integrated_decay
from made_motion import decaying, motion_of_angles

from sysid.diagnosis.laws import Laws
from sysid.diagnosis.posterior import Subject
from sysid.diagnosis.slow_flow import averaged, cycles_of, regression, whitened
from sysid.effects import effect

INERTIA, NODES = 0.02, 64
EXACT = {
    "coulomb": (lambda a, c: -2 * c / (np.pi * a), lambda a, c: 0 * a),
    "quadratic-damping": (lambda a, c: -4 * c * a / (3 * np.pi), lambda a, c: 0 * a),
    "cubic-stiffness": (lambda a, c: 0 * a, lambda a, c: 3 / 8 * c * a**2),
}
"""ȧ/a and ψ̇ - 1 by Krylov and Bogoliubov, of F sgn v, c v|v| and c x³ in units of the spring's torque in the widest swing."""


@pytest.mark.parametrize("name", EXACT)
def test_averaged_laws_are_those_of_krylov_and_bogoliubov(name):
    motion = motion_of_angles(decaying(NODES)[0], NODES)
    laws = Laws(motion, INERTIA, 1.0, 0.05)
    amplitudes, _, (term,) = averaged(laws, Subject(inertia=INERTIA, parts={name: effect(name)}), 0.05)
    power = {"coulomb": (0, 0), "quadratic-damping": (0, 2), "cubic-stiffness": (3, 0)}[name]
    a, w = motion.amplitude, motion.frequency
    strength = term.unit[0] * a ** sum(power) * w ** power[1] / (INERTIA * w**2 * a)
    for channel, exact in enumerate(EXACT[name]):
        expected = exact(amplitudes, strength)
        np.testing.assert_allclose(
            term.columns[:, channel, 0], expected, atol=4e-3 * max(np.abs(expected).max(), strength)
        )


@pytest.mark.parametrize(
    ("law", "name", "strength"),
    [
        (lambda x, v: -x - 0.04 * v * abs(v), "quadratic-damping", 0.04),
        (lambda x, v: -x - 0.01 * v - 0.06 * x**3, "cubic-stiffness", 0.06),
    ],
)
def test_cycles_of_a_simulated_decay_follow_the_averaged_law(law, name, strength):
    time = np.arange(NODES * 40) * 2 * np.pi / NODES
    angle, _ = integrated_decay(time, law)
    (cycles,) = cycles_of(motion_of_angles(angle[None], NODES, noise=1e-4))
    middle = np.sqrt(cycles.amplitude[1:] * cycles.amplitude[:-1])
    step = np.diff(cycles.time)
    loss, lead = (f(middle, strength) for f in EXACT[name])
    if name == "cubic-stiffness":
        assert np.sum(np.diff(cycles.phase)) == pytest.approx(np.sum(step * lead), rel=0.04)
        loss = loss - 0.005
    np.testing.assert_allclose(np.diff(np.log(cycles.amplitude)) / step, loss, atol=0.06 * np.abs(loss).max())


def test_increments_are_whitened_by_the_errors_that_neighbours_share():
    angle = decaying(NODES, periods=20)[0]
    (cycles,) = cycles_of(motion_of_angles(angle, NODES))
    flow = regression([cycles], np.geomspace(0.01, 1, 5), np.zeros((5, 2, 1)))
    gram, spread = whitened(flow, 1e-3, 1e-2)
    step, expected, determinant = np.diff(cycles.time), 0.0, 0.0
    for increments, walk in zip(flow.increments, (1e-3, 1e-2), strict=True):
        difference = np.diff(np.eye(len(cycles.std)), axis=0)
        covariance = difference @ np.diag(cycles.std**2) @ difference.T + np.diag(
            walk**2 * step / (2 * np.pi)
        )
        expected += increments @ np.linalg.solve(covariance, increments)
        determinant += np.linalg.slogdet(covariance)[1]
    assert gram[0, 0] == pytest.approx(expected)
    assert spread == pytest.approx(determinant)
    # A linear decay loses d/2 of ln a in a unit of time.
    assert np.sum(flow.columns[0, :, 1]) == pytest.approx(-step.sum() / 2)
