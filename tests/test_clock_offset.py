"""Clocks are compared by one motion that both records show, and by no other."""

import pytest

from sysid.board import load_board
from sysid.clock_offset import clock_offset
from sysid.errors import HuskyError
from sysid.logs import read_roll
from sysid.synth import SynthOptions, synthesise
from sysid.workspace import shipped_data

BLACK = shipped_data() / "decays" / "black.csv"


def made(folder, name, **options):
    board = load_board(shipped_data() / "boards" / "black.toml")
    log = folder / name
    synthesise(board, {}, SynthOptions(duration=1.5, **options)).save(log)
    return read_roll(log)


@pytest.mark.parametrize("angles", [(0.17, -0.15), (0.16, -0.14, 0.12)])
def test_other_releases_of_the_same_board_are_no_common_motion(tmp_path, angles):
    with pytest.raises(HuskyError, match=r"do not show the same motion \(correlation 0\.[5-8]"):
        clock_offset(read_roll(BLACK), made(tmp_path, "other.csv", angles=angles))


def test_two_sensors_on_one_deck_agree(tmp_path):
    one = made(tmp_path, "angle.csv", angles=(0.17, -0.15))
    other = made(tmp_path, "gyro.csv", angles=(0.17, -0.15), dialect="gyro")
    assert abs(clock_offset(one, other).value) < 1e-3
