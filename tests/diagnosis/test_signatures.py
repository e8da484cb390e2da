"""Signatures: what these releases can show, and what looks the same in them."""

import numpy as np
import pytest

from sysid.diagnosis.signatures import GENTLE, Start, look_alikes
from sysid.joint import JointLaw, simulate

LAW = JointLaw(inertia=8.7e-3, stiffness=14.7, damping=0.1)
TIME = np.arange(0, 1.2, 0.004)
STARTS = [Start(TIME, angle, 0.0, 1.0) for angle in (0.2, -0.15, 0.08)]
NOISE = 1e-3


@pytest.fixture(scope="module")
def found():
    return look_alikes(LAW, STARTS, NOISE)


def test_what_is_known_to_look_alike_does(found):
    def cosine(a, b):
        return found.cosine[found.names.index(a), found.names.index(b)]

    assert cosine("gravity", "cubic-stiffness") > 0.95  # sin φ ≈ φ - φ³/6
    assert cosine("cubic-damping", "quadratic-damping") > 0.9
    assert cosine("cubic-stiffness", "coulomb") < 0.6
    assert cosine("asymmetric-stiffness", "coulomb") < 0.6
    assert "cubic-stiffness" in found.alike("gravity")
    np.testing.assert_allclose(np.diag(found.cosine), 1.0)


def test_visibility_goes_with_the_noise(found):
    noisier = look_alikes(LAW, STARTS, 2 * NOISE)
    np.testing.assert_allclose(noisier.visibility, found.visibility / 2)


def test_visibility_is_what_a_least_squares_fit_leaves(found):
    """A signature is what remains of an effect after fitting everything that the linear joint can do."""
    from scipy.optimize import least_squares

    index = found.names.index("cubic-stiffness")
    strength = found.strength[index]["coefficient"] * 0.02
    changed = LAW.with_effect("cubic-stiffness", strength)
    target = np.concatenate([simulate(changed, s.time, s.angle, s.rate).roll for s in STARTS])

    def residual(x):
        law = JointLaw(inertia=8.7e-3, stiffness=14.7 * x[0], damping=0.1 * x[1], rest_angle=0.01 * x[2])
        own = x[3:].reshape(-1, 2)
        path = [
            simulate(law, s.time, s.angle + 0.01 * a, v).roll for s, (a, v) in zip(STARTS, own, strict=True)
        ]
        return np.concatenate(path) - target

    left = least_squares(residual, np.r_[1.0, 1.0, np.zeros(7)], diff_step=1e-5).fun
    assert np.linalg.norm(left) / NOISE == pytest.approx(0.02 * found.visibility[index], rel=0.05)


def test_effects_of_the_law_are_taken_out(found):
    law = LAW.with_effect("coulomb", 0.05)
    own = look_alikes(law, STARTS, NOISE)
    assert own.strength[own.names.index("coulomb")] == {"torque": 0.05}
    assert GENTLE < 1


def test_a_law_that_runs_away_has_no_signatures():
    law = LAW.with_effect("cubic-stiffness", -2000.0)
    assert look_alikes(law, STARTS, NOISE) is None
