"""The frequency response has the joint's stiffness at rest and its quarter turn at the natural frequency."""

from pathlib import Path

import numpy as np

from reports.figures.bode import bode_figure
from sysid.workspace import Workspace


def test_response_has_the_joints_stiffness_and_natural_frequency():
    board = Workspace(Path()).load_board("pink")
    magnitude, phase = bode_figure(board, 9.0).axes
    frequency, tilt = magnitude.lines[0].get_data()
    assert np.isclose(np.radians(tilt[0]), 1 / board.stiffness, rtol=5e-3)
    natural = np.sqrt(board.stiffness / board.inertia.value) / (2 * np.pi)
    lag = np.interp(natural, frequency, phase.lines[0].get_ydata())
    assert np.isclose(lag, -90, atol=0.5)
