"""Formulas of a learned torque in words."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from sysid.diagnosis.shapes import SHAPES, Formula


def formula(*names, widths=None, **changes):
    shapes = tuple(next(shape for shape in SHAPES if shape.name == name) for name in names)
    known = Formula(
        shapes=shapes, coefficients=(1.0,) * len(shapes), widths=widths or (0.0,) * len(shapes),
        peaks=(0.25,) * len(shapes), share=0.9, good=True,
    )  # fmt: skip
    return replace(known, **changes)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_a_shape_is_zero_at_rest_and_travels_between_processes(shape):
    assert shape.torque(np.zeros(1), np.zeros(1), 0.1) == pytest.approx(0.0)
    assert pickle.loads(pickle.dumps(shape)) == shape
    assert np.isfinite(shape.torque(np.linspace(-0.2, 0.2, 11), np.linspace(-5, 7, 11), 0.07)).all()


def test_torques_are_those_of_the_formulas():
    x, v = np.array([0.1, -0.1]), np.array([2.0, 3.0])
    assert formula("damping by the tilt squared").torque(x, v) == pytest.approx([-0.02, -0.03])
    assert formula("right bumper", widths=(0.04,)).torque(x, v) == pytest.approx([-0.06, 0.0])
    assert formula("cubic", "drag to one side").torque(x, v) == pytest.approx([-4.001, -8.999])


def test_shapes_of_the_catalogue_lead_to_its_effects():
    assert formula("cubic").effects == ("cubic-stiffness",)
    assert formula("dry friction").effects == ("coulomb",)
    assert formula("quadratic drag").effects == ("quadratic-damping",)
    assert formula("lopsided").effects == ("bilinear-stiffness",)
    assert formula("cubic", "fifth power").effects == ()


def test_of_a_joint_that_slides_widths_are_shown_in_mm_and_forces_in_newton():
    sliding = formula("right bumper", widths=(0.0125,), slides=True)
    assert sliding.law == "max(x - 12.5 mm, 0)"
    assert "x - 12.5 mm" in sliding.own_effect()[1]
    assert sliding.text.startswith("a stop beyond 12.5 mm on the right only, 0.25 N;")
    assert "0.716°" in formula("right bumper", widths=(0.0125,)).text


def test_a_formula_names_its_terms_its_share_and_its_causes():
    both = formula("damping by the tilt squared", "dry friction")
    assert both.text == (
        "damping that grows with angle (like x² v), 0.25 N·m and friction alike at all rates, 0.25 N·m; "
        "this formula carries 90 % of it. Possible causes: compressed rubber, a linkage, dry friction"
    )
    assert "softening" in formula("cubic", coefficients=(-1.0,)).text


def test_a_formula_that_carries_little_is_no_word_for_it():
    text = formula("cubic", share=0.3).text
    assert "hardening" not in text
    assert "30 %" in text


def test_the_effect_of_a_formula_has_its_torque():
    known = formula("magnet", widths=(0.02,), coefficients=(12.0,))
    name, source = known.own_effect()
    content = {}
    exec(source, content)
    effect, x = content["EFFECT"], np.linspace(-0.1, 0.1, 9)
    from sysid.effects._algebra import NUMPY
    from sysid.effects._base import JointState

    torque = effect.torque(NUMPY, JointState(x, 0 * x, x, 1.0), effect.named(list(effect.example)), ())
    assert name == "magnet"
    assert torque == pytest.approx(known.torque(x, 0 * x), rel=1e-3)
