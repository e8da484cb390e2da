import math

import pytest
from riding import pink

from sim.board.scaled import scaled_board
from sim.board.scene import TILT_JOINT, board_spec
from sysid.errors import SysidError


def test_factors_reach_record_and_model_and_nothing_else():
    board = pink()
    scaled = scaled_board(board, {"k": 4.0, "d": 0.5, "rake": 0.9, "inertia": 1.1})
    assert scaled.stiffness == pytest.approx(4 * board.stiffness)
    assert scaled.tilt["stiffness"].std == pytest.approx(4 * board.tilt["stiffness"].std)
    assert scaled.damping == pytest.approx(0.5 * board.damping)
    assert scaled.inertia.value == pytest.approx(1.1 * board.inertia.value)
    assert math.degrees(scaled.geometry["rake"].value) == pytest.approx(54)
    assert scaled.mass == board.mass
    plain, stiff = (board_spec(one).compile() for one in (board, scaled_board(board, {"k": 4.0})))
    ratio = stiff.joint(TILT_JOINT).stiffness[0] / plain.joint(TILT_JOINT).stiffness[0]
    assert ratio == pytest.approx(4, rel=0.02)  # a step's compensation is in both


@pytest.mark.parametrize(
    ("name", "factor", "message"),
    [
        ("q", 2, "--board-scale q=2: unknown. Known: k, d, inertia, rake"),
        ("k", -1, "--board-scale k=-1: must be a finite factor"),
        ("inertia", 0, "must be a finite factor"),
        ("rake", 1.4, "makes it 84°, at most 80°"),
    ],
)
def test_what_is_no_board_is_refused(name, factor, message):
    with pytest.raises(SysidError, match=message):
        scaled_board(pink(), {name: factor})
