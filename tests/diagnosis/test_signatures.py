"""Signatures: what these releases can show, and what looks the same in them."""

import numpy as np
import pytest

from sysid.diagnosis.signatures import look_alikes
from sysid.joint import JointLaw, simulate
from sysid.roll import Release

LAW = JointLaw(inertia=8.7e-3, stiffness=14.7, damping=0.1)
TIME = np.arange(0, 1.2, 0.004)
ANGLES = (0.2, -0.15, 0.08)
NOISE = 1e-3


def signatures(law=LAW, noise=NOISE):
    releases = [
        Release(
            log="made", number=i, time=TIME, roll=simulate(law, TIME, angle).roll, std=np.full(len(TIME), noise), origin="angle",
            rest=0.0, hold=1.0, end="log",
        )
        for i, angle in enumerate(ANGLES)
    ]  # fmt: skip
    return look_alikes(releases, law, noise, rate=False)


@pytest.fixture(scope="module")
def found():
    return signatures()


def test_what_is_known_to_look_alike_does(found):
    def cosine(a, b):
        return found.cosine[found.names.index(a), found.names.index(b)]

    assert cosine("gravity", "cubic-stiffness") > 0.95  # sin φ ≈ φ - φ³/6
    assert cosine("cubic-damping", "quadratic-damping") > 0.9
    assert cosine("cubic-stiffness", "coulomb") < 0.6
    assert cosine("asymmetric-stiffness", "coulomb") < 0.6
    assert "cubic-stiffness" in found.alike("gravity")
    np.testing.assert_allclose(np.diag(found.cosine), 1.0)


def test_visibility_is_what_a_least_squares_fit_leaves(found):
    """A signature is what remains of an effect after fitting everything that the linear joint can do."""
    from scipy.optimize import least_squares

    index = found.names.index("cubic-stiffness")
    strength = found.strength[index]["coefficient"] * 0.02
    changed = LAW.with_effect("cubic-stiffness", strength)
    target = np.concatenate([simulate(changed, TIME, angle, 0.0).roll for angle in ANGLES])

    def residual(x):
        law = JointLaw(inertia=8.7e-3, stiffness=14.7 * x[0], damping=0.1 * x[1], rest_angle=0.01 * x[2])
        own = x[3:].reshape(-1, 2)
        path = [
            simulate(law, TIME, angle + 0.01 * a, v).roll for angle, (a, v) in zip(ANGLES, own, strict=True)
        ]
        return np.concatenate(path) - target

    left = least_squares(residual, np.r_[1.0, 1.0, np.zeros(7)], diff_step=1e-5).fun
    assert np.linalg.norm(left) / NOISE == pytest.approx(0.02 * found.visibility[index], rel=0.3)


def test_an_inertia_of_an_effect_counts_as_the_joints_own():
    own = JointLaw(inertia=2 * LAW.inertia, stiffness=LAW.stiffness, damping=LAW.damping)
    added, plain = signatures(LAW.with_effect("armature", LAW.inertia)), signatures(own)
    at = [one.names.index("cubic-stiffness") for one in (added, plain)]
    assert added.strength[at[0]]["coefficient"] == pytest.approx(plain.strength[at[1]]["coefficient"])
    assert added.visibility[at[0]] == pytest.approx(plain.visibility[at[1]])


def test_an_effect_of_the_law_has_its_own_strength():
    own = signatures(LAW.with_effect("coulomb", 0.05))
    assert own.strength[own.names.index("coulomb")] == {"torque": 0.05}
