"""What to record next, in words that hold for a deck that tilts and for a joint that slides."""

from dataclasses import replace

import pytest

from sysid.board import load_board
from sysid.diagnosis.experiment import Experiment
from sysid.diagnosis.wording import experiment_for_the_unknown, experiment_in_words
from sysid.workspace import shipped_data

DECK = load_board(shipped_data() / "boards" / "pink.toml")


@pytest.mark.parametrize(("angle", "side"), [(0.1, "positive"), (-0.1, "negative")])
def test_of_what_is_no_board_a_side_is_the_sign_of_its_angle(angle, side):
    found = Experiment(angle=angle, number=1, duration=1.0, difference=0.01)
    joint = replace(DECK, geometry={})
    assert f"Release once from 5.73° (to the {side} side)" in experiment_in_words(
        found, "a", "b", "", joint, 0.2
    )


def test_where_no_law_predicts_an_experiment_other_amplitudes_are_asked_for():
    """And it says that nothing was computed."""
    words = experiment_for_the_unknown(0.2, 0.3, DECK)
    assert words.startswith("None is computed")
    assert "from 5.7° and from 17° too" in words
    assert "and from" not in experiment_for_the_unknown(0.2, 0.2, DECK)
