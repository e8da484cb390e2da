"""When a learned torque shows that what was named only mimics it."""

from dataclasses import replace

from sysid.diagnosis.remedy import Learned

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
