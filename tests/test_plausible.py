"""A log in the wrong unit must not pass for a board that swings."""

from pathlib import Path

import numpy as np
import pytest

from sysid.errors import HuskyError
from sysid.plausible import amplitude_warnings
from sysid.roll import Release
from sysid.workspace import Workspace


def release(amplitude):
    time = np.linspace(0, 1, 50)
    return Release(
        log="log.csv", number=1, time=time, roll=amplitude * np.exp(-time), std=0 * time + 1e-3, origin="angle",
        rest=0.0, hold=1.0, end="rest",
    )  # fmt: skip


@pytest.fixture
def board():
    return Workspace(Path()).load_board("pink")


def test_degrees_taken_for_radians_are_refused(board):
    with pytest.raises(HuskyError, match=r"log\.csv: .* 10 rad from rest.*--unit deg"):
        amplitude_warnings([release(0.1), release(-10.0)], board)


@pytest.mark.parametrize(("amplitude", "word"), [(0.5, "allows ±0.2 rad"), (0.003, "only")])
def test_odd_amplitudes_are_named(board, amplitude, word):
    (warning,) = amplitude_warnings([release(amplitude)], board)
    assert word in warning


def test_an_ordinary_release_is_not_questioned(board):
    assert amplitude_warnings([release(0.17), release(-0.01)], board) == []
