"""A learned torque in words: the right shape, where it acts, and nothing where nothing was learned."""

import pickle

import numpy as np
import pytest
from light_board import BOARD, magnet, releases

from sysid.effects._algebra import NUMPY
from sysid.fitting.formula import SHAPES, Formula, formula_of
from sysid.fitting.joint import fit_joint


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_code_and_law_of_a_shape_are_one(shape):
    m, x, v, a = NUMPY, np.linspace(-0.2, 0.2, 11), np.linspace(-5, 7, 11), 0.07
    assert shape.law(m, x, v, a) == pytest.approx(eval(shape.code, {"m": m, "x": x, "v": v, "a": a}))


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_a_shape_travels_between_processes(shape):
    assert pickle.loads(pickle.dumps(shape)) is shape


def test_shapes_of_the_catalogue_lead_to_its_effects():
    def effects(*names):
        shapes = tuple(shape for shape in SHAPES if shape.name in names)
        return Formula(
            shapes=shapes, coefficients=(), widths=(), share=1, error=0, good=True, text=""
        ).effects

    assert effects("cubic") == ("cubic-stiffness",)
    assert effects("dry friction") == ("coulomb",)
    assert effects("quadratic drag") == ("quadratic-damping",)
    assert effects("lopsided") == ("bilinear-stiffness",)
    assert effects("cubic", "fifth power") == ()


def test_a_bumper_or_two_alike_are_a_stop_that_the_catalogue_has():
    def known(**angles):
        shapes = tuple(shape for shape in SHAPES if shape.name.split()[0] in angles)
        return Formula(
            shapes=shapes,
            coefficients=(),
            widths=tuple(angles.values()),
            share=1,
            error=0,
            good=True,
            text="",
        ).is_known

    assert known(right=0.1)
    assert known(right=0.1, left=0.103)
    assert not known(right=0.12, left=0.06)
    assert not known(fifth=0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("torque", "name", "said"),
    [
        (magnet, "magnet", "pulls to the middle within 1."),
        (lambda t, x, v: -0.08 * max(v, 0.0), "one-way damper", "damps in one direction"),
    ],
)
def test_the_right_shape_is_named(torque, name, said):
    words = formula_of(fit_joint(releases(torque), BOARD, ["learned"]))
    assert words.shapes[0].name.startswith(name)
    assert said in words.text
    assert words.share > 0.8
    assert words.coefficients[0] > 0


def test_of_nothing_no_formula_is_made():
    assert formula_of(fit_joint(releases(lambda t, x, v: 0.0), BOARD, ["learned"])) is None
