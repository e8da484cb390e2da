"""The synthetic truth and the model that is fitted: two independent accounts of the same physics agree.

One integrates by DOP853 between events with its own torque laws; the other steps the effect catalogue's laws
by CasADi. Neither knows the other, so what they agree on is the law as it was meant.
"""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid import joint
from sysid.effects import catalogue
from sysid.synth import SynthOptions, synthesise
from sysid.synth.effects import PARAMETERS
from sysid.synth.sensors import Sensor
from sysid.workspace import Workspace

VALUES = {
    "coulomb": (0.1,), "stribeck": (0.05, 0.15, 0.5), "quadratic-damping": (0.02,), "cubic-damping": (0.002,),
    "cubic-stiffness": (200.0,), "asymmetric-stiffness": (15.0,), "gravity": (2.0,), "end-stop": (0.1, 60.0, 0.02),
    "freeplay": (0.02,), "preload": (0.3,), "offset": (0.02,), "viscoelastic": (6.0, 0.1),
    "hysteresis": (6.0, 0.2), "second-mode": (0.02, 300.0, 0.2), "inertia": (1.3,), "discretisation": (0.005,),
    "sensor-bias": (0.02,), "sensor-drift": (0.005,), "clock": (1.03,), "lowpass": (0.01,),
}  # fmt: skip
STEPPED_OVER = {"end-stop": 3e-4, "freeplay": 2e-5}
"""Roll error [rad] of a fixed step that goes over a kink instead of stopping at it."""


def test_same_names_parameters_and_units() -> None:
    synthetic = {name: [(p.name, p.unit) for p in parameters] for name, parameters in PARAMETERS.items()}
    fitted = {name: [(p.name, p.unit) for p in effect.parameters] for name, effect in catalogue().items()}
    # A new effect of the catalogue may lack a synthetic truth; what both have must mean the same.
    assert synthetic == {name: fitted[name] for name in synthetic}


@pytest.mark.parametrize("damping", [0.4022, 0.15])
@pytest.mark.parametrize("name", VALUES)
def test_same_motion(name: str, damping: float) -> None:
    pink = Workspace(Path()).load_board("pink")
    board = pink.with_tilt(damping=replace(pink.tilt["damping"], value=damping))
    options = SynthOptions(
        angles=(0.17,), rate=200.0 if name == "discretisation" else 1000.0, tremor=0.0, hold=2.0, hand=False,
        duration=1.0, sensor=Sensor(),
    )  # fmt: skip
    truth = synthesise(board, {name: VALUES[name]}, options)
    law = joint.JointLaw.from_board(board).with_effect(name, *VALUES[name])
    model = joint.simulate(law, truth.time, 0.17, 0.0, hold=2.0)
    assert np.abs(model.roll - truth.channels[:, 0]).max() < STEPPED_OVER.get(name, 5e-6)


def test_synthetic_truth_knows_nothing_of_the_model() -> None:
    code = (
        "import sys, pathlib; from sysid.synth import *; from sysid.workspace import Workspace\n"
        "synthesise(Workspace(pathlib.Path()).load_board('pink'), {'coulomb': (0.1,)})\n"
        "print(*sys.modules)"
    )
    modules = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    foreign = ("casadi", "mujoco", "sysid.effects", "sysid.joint", "sysid.fit")
    assert not [module for module in modules if module.startswith(foreign)]
