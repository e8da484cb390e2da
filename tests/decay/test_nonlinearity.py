"""Effects say what peaks show of them; synthetic logs of those effects show it."""

import math
from typing import get_args

import numpy as np
import pytest

from sysid.board import Board
from sysid.decay.nonlinearity import find_nonlinearities
from sysid.decay.peaks import find_peaks
from sysid.effects import catalogue
from sysid.effects._base import DecaySign
from sysid.free_decay import fit_decay
from sysid.quantity import Quantity
from sysid.recording import Recording
from sysid.roll import Release
from sysid.synth.log import SynthOptions
from sysid.synth.sensors import Sensor
from sysid.synth.synthesis import synthesise

SHOWN = [
    ("asymmetric-stiffness", (5.0,), 0.06, ["stops aside"]),
    ("bilinear-stiffness", (1.1,), 0.03, ["stops aside"]),
    ("bouc-wen", (0.132, 0.1, 0.5), 0.03, ["growing loss", "longer period"]),
    ("bouc-wen", (0.132, 0.1, 0.5), 0.11, ["scattered levels", "growing loss"]),
    ("coulomb", (0.132,), 0.03, ["constant loss", "stops aside"]),
    ("coulomb", (0.15,), 0.4, ["scattered levels"]),
    ("cubic-damping", (0.005,), 0.03, ["growing loss"]),
    ("cubic-stiffness", (-150.0,), 0.03, ["growing loss", "longer period"]),
    ("cubic-stiffness", (137.0,), 0.11, ["constant loss", "shorter period"]),
    ("dahl", (0.132, 0.006), 0.08, ["constant loss", "stops aside"]),
    ("end-stop", (0.1, 66.0, 0.0), 0.11, ["constant loss", "shorter period", "stops aside"]),
    ("freeplay", (0.016,), 0.03, ["shorter period", "stops aside"]),
    ("freeplay", (0.009,), 0.4, ["scattered levels", "constant loss"]),
    ("hanging-body", (0.0006, 18.2, 0.0), 0.03, ["stops aside"]),
    ("hysteresis", (3.3, 0.088), 0.03, ["growing loss", "longer period"]),
    ("hysteresis", (6.6, 0.66), 0.03, ["moving level", "stops aside"]),
    ("hysteresis", (6.6, 0.66), 0.11, ["scattered levels"]),
    ("one-sided-stop", (0.1, 66.0, 0.0), 0.03, ["shorter period", "stops aside"]),
    ("quadratic-damping", (0.03,), 0.03, ["growing loss"]),
    ("sensor-drift", (0.00114,), 0.03, ["moving level"]),
    ("stribeck", (0.0, 0.132, 2.42), 0.03, ["constant loss", "stops aside"]),
    ("stribeck", (0.08, 0.25, 0.5), 0.4, ["scattered levels"]),
    ("viscoelastic", (0.5, 0.4), 0.11, ["scattered levels", "stops aside"]),
]
"""Effect, its parameters, the damping beside it [N*m*s/rad], and what is to be seen."""


@pytest.mark.parametrize(("name", "values", "damping", "signs"), SHOWN)
def test_what_an_effect_says_is_seen(tmp_path, name, values, damping, signs):
    tilt = {
        "stiffness": Quantity(11.0, 0.0, "N*m/rad"), "damping": Quantity(damping, 0.0, "N*m*s/rad"),
        "rest_angle": Quantity(0.0, 0.0, "rad"), "range": Quantity(0.5, 0.0, "rad"),
    }  # fmt: skip
    board = Board(name="x", description="", source="", inertia=Quantity(0.012, 1e-6, "kg*m^2"), tilt=tilt)
    options = SynthOptions(
        angles=tuple(map(math.radians, (10, -8, 14, -5))), rate=200, duration=3.5, sensor=Sensor(noise=math.radians(0.05)),
    )  # fmt: skip
    path, _ = synthesise(board, {name: values}, options).save(tmp_path / "log.csv", command="")
    seen = fit_decay(Recording.read(path), board=board).nonlinearities
    assert {found.sign for found in seen if name in found.effects} >= set(signs)


def test_whatever_an_effect_says_is_tried_here_and_every_sign_has_several_causes():
    said = {(name, sign) for name, part in catalogue().items() for sign, _ in part.decay_signs}
    tried = {(name, sign) for name, _, _, signs in SHOWN for sign in signs}
    # Gravity bends at angles that no board reaches; a drift scatters what does not follow in time.
    assert said - {("gravity", "longer period"), ("sensor-drift", "scattered levels")} == tried
    for sign in get_args(DecaySign):
        assert sum(sign == other for _, other in said) > 1


@pytest.mark.parametrize("sticks", [False, True])
def test_what_still_swings_at_its_end_has_not_stopped_beside_its_middle(sticks):
    omega, noise = 12.6, 0.001
    time = np.arange(0, 20.1 * math.pi / omega, 0.005)
    roll = 0.2 * np.exp(-0.04 * omega * time) * np.cos(omega * time)
    if sticks:  # at its last turn, and stays there
        later = np.arange(1, 200) * 0.005
        time, roll = np.append(time, time[-1] + later), np.append(roll, np.full(len(later), roll[-1]))
    roll = roll + noise * np.random.default_rng(0).standard_normal(len(time))
    release = Release(
        log="", time=time, roll=roll, std=np.full_like(roll, noise), origin="", number=1, hold=1.0, end="rest",
        rest=float(np.median(roll[time >= time[-1] - math.pi / omega])),
    )  # fmt: skip
    assert abs(release.rest) > 0.004
    peaks = find_peaks(release, 0.0, omega, omega, noise)
    seen = [found.sign for found in find_nonlinearities([release], [peaks], noise)]
    assert ("stops aside" in seen) == sticks
