"""What a log leaves open of an effect that the record has is as the record says."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made import decays

from sysid.errors import SysidError
from sysid.fit_mjcf import fit
from sysid.joint import JointLaw
from sysid.quantity import Quantity
from sysid.workspace import Workspace

NOISE = 5e-4
LAW = JointLaw(inertia=8.7e-3, stiffness=14.7, damping=0.06)
STOP = LAW.with_effect("end-stop", 0.12, 60.0, 0.0)


def releases_of(law, angles):
    return decays(law, angles, np.arange(0.0, 1.5, 2e-3), NOISE, seed=4)


@pytest.fixture(scope="module")
def recorded():
    """A board whose stop was found in wide swings."""
    pink = replace(
        Workspace(Path()).load_board("pink"), inertia=Quantity(8.7e-3, 1e-5, "kg*m^2"), decay={}, fit={}
    )
    return fit(releases_of(STOP, (0.18, -0.17, 0.15)), pink, ("end-stop",)).board


def test_a_stop_that_small_swings_never_meet_is_kept(recorded):
    known = recorded.effects[0].parameters
    assert known["angle"].value == pytest.approx(0.12, abs=1e-3)
    narrow = fit(releases_of(STOP, (0.08, -0.07, 0.06)), recorded)
    assert any("leave end-stop.angle" in warning for warning in narrow.warnings)
    kept = narrow.board
    assert kept.effects[0].parameters["angle"].value == pytest.approx(
        known["angle"].value, abs=known["angle"].std
    )
    assert kept.effects[0].parameters["angle"].std == pytest.approx(known["angle"].std, rel=0.1)
    assert kept.stiffness == pytest.approx(14.7, rel=0.01)


def test_what_the_logs_contradict_is_not_kept(recorded):
    """Swings as wide as before, and no stop."""
    with pytest.raises(SysidError, match="end-stop"):
        _ = fit(releases_of(LAW, (0.18, -0.17, 0.15)), recorded).board
