"""What the board does by itself under a load of 40 kg."""

import numpy as np
import pytest
from hands_off import let_go
from riding import pink

from sim.skate.world.scene import SceneOptions, as_written


@pytest.fixture(scope="module")
def board():
    return as_written(pink(), SceneOptions())


@pytest.mark.parametrize("coasting", [False, True])
def test_its_energy_does_not_grow(board, coasting):
    run = let_go(board, speed=2.0, tilt=0.0 if coasting else 0.14, held=not coasting, time=2.0)
    assert run.largest_rise() < 1e-3 * run.energy[0]
    assert run.energy[-1] < 0.9 * run.energy[0]


def test_a_tilted_deck_rights_itself_and_gains_nothing_while_it_rolls(board):
    run = let_go(board, speed=1.0, tilt=0.1, time=1.0)
    assert run.largest_rise() < 1e-3 * run.energy[0]
    assert np.abs(run.roll[-20:]).max() < 2e-3


def test_it_coasts_as_its_documentation_says(board):
    """Table in benchmarks/results/hands_off.md."""
    for load, losses in ((0.0, (0.084, 0.127, 0.202)), (40.0, (0.053, 0.082, 0.119))):
        for speed, loss in zip((0.5, 1.0, 2.0), losses, strict=True):
            run = let_go(board, load=load, speed=speed, time=1.0)
            assert run.deceleration() == pytest.approx(loss, rel=0.02)
