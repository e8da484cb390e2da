"""What a sensor makes of a motion is one thing, whoever asks: the simulation, a fit, or the gate."""

import numpy as np
import pytest
from made import release

from sysid.fitting.initial_state import fit_initial_states
from sysid.fitting.records import make_records
from sysid.joint import JointLaw, simulate
from sysid.joint.sensor import sense
from sysid.roll import Release

LAW = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.1, rest_angle=0.01)
TIME = np.arange(0.0, 1.5, 2e-3)
SENSORS = {
    "sensor-bias": (0.02,), "sensor-drift": (0.01,), "lowpass": (0.01,), "clock": (1.05,),
}  # fmt: skip


def measured(law: JointLaw, *, begin: float) -> Release:
    roll = simulate(law, TIME, 0.2, begin=begin).roll
    return release(begin + TIME, roll, 1e-6, rng=np.random.default_rng(1), rest=0.01)


def test_drift_grows_with_the_log_and_not_with_the_release():
    drifting = LAW.with_effect("sensor-drift", 0.01)
    late = simulate(drifting, TIME, 0.2, begin=10.0).roll - simulate(LAW, TIME, 0.2).roll
    assert late == pytest.approx(0.01 * (10.0 + TIME), abs=1e-12)


@pytest.mark.parametrize("name", SENSORS)
def test_a_fit_sees_what_the_simulation_shows(name):
    """Only roll and rate at release are fitted, so the residual is the noise if both have the same sensor."""
    law = LAW.with_effect(name, *SENSORS[name])
    made = measured(law, begin=7.0)
    residuals, starts = fit_initial_states(law, make_records([made], 1e-6, rate=False))
    assert np.std(residuals[0]) < 1.2e-6
    assert starts[0][0] == pytest.approx(0.2, abs=1e-4)


@pytest.mark.parametrize("name", [name for name in SENSORS if name != "clock"])
def test_the_gate_senses_what_the_simulation_shows(name):
    law = LAW.with_effect(name, *SENSORS[name])
    seen = sense(law, 3.0 + TIME, simulate(LAW, TIME, 0.2).roll)
    assert seen == pytest.approx(simulate(law, TIME, 0.2, begin=3.0).roll, abs=5e-5)
