"""The synthetic truth and the model that is fitted: two independent accounts of the same physics agree.

One integrates by DOP853 between events, with its own torque laws where it has one; the other steps the effect
catalogue's laws by CasADi. So what they agree on is the law as it was meant, or, of an effect without a law of the
truth's own, the motion that it makes.
"""

from dataclasses import replace

import numpy as np
import pytest

from sysid import joint
from sysid.board import Board
from sysid.effects import catalogue
from sysid.synth import SynthOptions, synthesise
from sysid.synth.sensors import Sensor

VALUES = {name: effect.example for name, effect in catalogue().items()} | {
    "end-stop": (0.1, 60.0, 0.02), "second-mode": (0.02, 300.0, 0.2), "lowpass": (0.01,), "linkage": (0.0, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0),
    "payload": (0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
}  # fmt: skip
STEPPED_OVER = {"end-stop": 3e-4, "one-sided-stop": 3e-5, "freeplay": 2e-5}
"""Roll error [rad] of a fixed step that goes over a kink instead of stopping at it."""
STUCK_ON_SUPPORT = 1e-3
"""Roll error [rad] of a joint that sticks while its support still moves: the fitted law lets it stand."""


TOGETHER = {
    "support and friction": {"second-mode": (0.02, 200.0, 0.1), "coulomb": (0.06,)},
    "arm and friction": {"viscoelastic": (5.0, 0.03), "coulomb": (0.06,)},
    "stop, gap and slider": {"end-stop": (0.1, 120.0, 0.0), "freeplay": (0.01,), "hysteresis": (6.0, 0.15)},
}
CASES = {name: {name: values} for name, values in VALUES.items()} | TOGETHER


@pytest.mark.parametrize("name", CASES)
def test_same_motion(pink: Board, name: str) -> None:
    effects = CASES[name]
    board = pink.with_tilt(damping=replace(pink.tilt["damping"], value=0.15))
    options = SynthOptions(
        angles=(0.17,), rate=200.0 if name == "discretisation" else 1000.0, tremor=0.0, hold=12.0, hand=False,
        duration=1.0, sensor=Sensor(),
    )  # fmt: skip
    truth = synthesise(board, effects, options)
    law = replace(joint.JointLaw.from_board(board), effects=tuple(effects.items()))
    model = joint.simulate(law, truth.time, 0.17, 0.0, hold=12.0)
    stuck = STUCK_ON_SUPPORT if {*effects} == {"second-mode", "coulomb"} else 0.0
    error = max(stuck, *(STEPPED_OVER.get(part, 5e-6) for part in effects))
    assert np.abs(model.roll - truth.channels[:, 0]).max() < error
