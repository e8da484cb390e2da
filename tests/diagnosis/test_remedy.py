"""When a learned torque shows that what was named only mimics it."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from sysid.board import load_board
from sysid.diagnosis import diagnose, remedy
from sysid.diagnosis.diagnose import UNNOTICED
from sysid.diagnosis.remedy import Learned, described, tables
from sysid.fitting.formula import SHAPES, Formula
from sysid.joint import JointLaw
from sysid.workspace import shipped_data

MAGNET = Learned(
    error_after=1.0, heldout_rmse=1.05, formula=("magnet",), known=False, text="a magnet", smooth=True, spread=1.02,
    compared="",
)  # fmt: skip
"""In units of the noise."""


def unmet(learned: Learned, named: float = 2.6, samples: float = 100.0, enough: float = 0.5) -> bool:
    return learned.is_unmet(named, samples, floor=1.0, enough=enough)


def test_a_formula_that_the_catalogue_lacks_and_that_reaches_the_noise_is_unmet():
    assert unmet(MAGNET)
    assert unmet(replace(MAGNET, smooth=False), enough=3.0)


def test_it_is_not_where_what_is_named_describes_the_log_as_well():
    assert not unmet(MAGNET, named=1.02, samples=1e4)


def test_it_is_not_where_few_residuals_are_independent():
    assert not unmet(MAGNET, named=1.2, samples=60)
    assert unmet(MAGNET, named=1.2, samples=100)


def test_it_is_not_where_the_catalogue_has_it_or_nothing_reaches_the_noise():
    assert not unmet(replace(MAGNET, known=True))
    assert not unmet(replace(MAGNET, spread=1.3))


def test_tables_without_a_formula_are_unmet_where_they_alone_take_away_what_is_missed():
    tables = replace(MAGNET, formula=(), known=True)
    assert unmet(tables)
    assert not unmet(tables, enough=3.0)
    assert not unmet(replace(tables, smooth=False))
    assert not unmet(replace(tables, spread=1.3))


@pytest.mark.parametrize(("choices", "unmet"), [(2, False), (4, True)])
def test_a_simple_law_may_leave_what_nobody_misses(monkeypatch, choices, unmet):
    monkeypatch.setattr(diagnose, "_independent", lambda _: 1e3)
    tables, winner = replace(MAGNET, formula=(), known=True), SimpleNamespace()
    scored = [SimpleNamespace(model=winner, choices=choices)]
    field = SimpleNamespace(motion=2.0 / UNNOTICED, floor=1.0, scored=scored)
    assert diagnose._is_unmet(tables, winner, SimpleNamespace(rmse=1.9), field) == unmet
    assert diagnose._is_unmet(tables, winner, SimpleNamespace(rmse=2.6), field)


def test_what_fit_would_not_record_is_known_before_it_is_told_to(monkeypatch):
    formula = Formula(
        shapes=SHAPES[:1],
        coefficients=(1.0,),
        widths=(0.0,),
        share=0.5,
        error=1.0,
        good=False,
        text="softens",
    )
    monkeypatch.setattr(remedy, "spread", lambda *_: 1.0)
    found = SimpleNamespace(
        formula=formula, is_rate=True, noise=SimpleNamespace(std=1.0), rmse=1.0, heldout_rmse=1.0,
        law=JointLaw(inertia=1.0, stiffness=1.0, damping=0.0).with_effect("coulomb", 0.1),
        joint=SimpleNamespace(minimum=SimpleNamespace(status="out of iterations"), status="out of iterations", problem=None),
    )  # fmt: skip
    monkeypatch.setattr(remedy, "fit", lambda *_, **__: found)
    board = load_board(shipped_data() / "boards" / "pink.toml")
    fitted = tables([], board, (), signal="auto", fixed=None)
    assert fitted is not None
    learned, beside = described(fitted, ()), described(fitted, ("coulomb",))
    assert learned is not None
    assert beside is not None
    assert "did not converge" in learned.refused
    assert learned.compared == "that formula alone is not as good: error 1 rad/s"
    assert learned.smooth
    assert not beside.smooth


@pytest.mark.parametrize("whole", [False, True])
def test_formula_and_held_out_error_are_worked_out_when_they_are_asked_for(monkeypatch, whole):
    """Tables that are only asked whether they reach the noise cost half as much without."""
    asked: list[str] = []

    class Found:
        formula = property(lambda self: asked.append("formula") or "magnet")
        heldout_rmse = property(lambda self: asked.append("held out"))

    monkeypatch.setattr(remedy, "fit", lambda *_, **__: Found())
    board = load_board(shipped_data() / "boards" / "pink.toml")
    assert tables([], board, (), signal="auto", fixed=None, whole=whole)
    assert asked == (["formula", "held out"] if whole else [])
