"""What is printed of a diagnosis."""

from types import SimpleNamespace

import pytest

from sysid.diagnosis.report import _predicted


@pytest.mark.parametrize(
    ("errors", "cut", "text"),
    [
        ((1.004, 0.0513), False, "each release, predicted from the others, is off by 100, 5.1 %"),
        ((9.96, 0.1), True, "each stretch, predicted from the others, is off by 996, 10 %"),
        ((0.5,), True, "each third, predicted from the others, is off by 50 %"),
    ],
)
def test_what_was_predicted_is_called_what_it_is(errors, cut, text):
    result = SimpleNamespace(
        heldout_before=errors, heldout_after=errors, status="missing", is_cut=cut, verdict=None
    )
    assert _predicted(result) == f"{text} of its RMS motion"
