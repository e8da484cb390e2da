"""When a learned torque shows that what was named only mimics it."""

from dataclasses import replace
from types import SimpleNamespace

from sysid.board import load_board
from sysid.diagnosis import remedy
from sysid.diagnosis.remedy import Learned, learn
from sysid.workspace import shipped_data

MAGNET = Learned(error_after=1.0, heldout_rmse=1.05, formula=("magnet",), known=False, text="a magnet")
"""In units of the noise."""


def test_a_formula_that_the_catalogue_lacks_and_that_reaches_the_noise_is_unmet():
    assert MAGNET.is_unmet(named=2.6, floor=1.0)


def test_it_is_not_where_what_is_named_reaches_the_noise_too():
    assert not MAGNET.is_unmet(named=1.1, floor=1.0)
    assert not replace(MAGNET, error_after=1.1).is_unmet(named=1.2, floor=1.0)


def test_it_is_not_where_the_catalogue_has_it_or_nothing_reaches_the_noise():
    assert not replace(MAGNET, known=True).is_unmet(named=2.6, floor=1.0)
    assert not replace(MAGNET, formula=()).is_unmet(named=2.6, floor=1.0)
    assert not replace(MAGNET, error_after=1.3).is_unmet(named=2.6, floor=1.0)


def test_what_fit_would_not_record_is_known_before_it_is_told_to(monkeypatch):
    formula = SimpleNamespace(text="softens", good=True, shapes=(), is_known=True, error=1.0)
    found = SimpleNamespace(
        formula=formula, noise=SimpleNamespace(std=1.0), rmse=1.0, heldout_rmse=1.0,
        joint=SimpleNamespace(minimum=SimpleNamespace(status="out of iterations"), status="out of iterations"),
    )  # fmt: skip
    monkeypatch.setattr(remedy, "fit", lambda *_, **__: found)
    board = load_board(shipped_data() / "boards" / "pink.toml")
    learned = learn([], board, (), signal="auto", fixed=None)
    assert learned is not None
    assert "did not converge" in learned.refused
