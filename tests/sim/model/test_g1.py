"""A joint of a robot as it ships: the G1's ankle, of the installed mjlab."""

import json
from pathlib import Path

import numpy as np
import pytest
import robots
from command_line import husky

from sim.model.setup import Setup
from sim.model.subject import board_of
from sysid.synth import SynthOptions, synthesise
from sysid.synth.sensors import Sensor

mjlab = pytest.importorskip("mjlab", reason="the G1's model comes with mjlab")

JOINT = "left_ankle_roll_joint"
TRUTH = {"armature.inertia": 3e-4, "coulomb.torque": 1.5e-3, "damping": 6e-4}


@pytest.mark.train
@pytest.mark.slow
def test_the_ankle_of_the_g1_is_fitted_and_its_file_mended(tmp_path):
    folder = Path(mjlab.__file__).parent / "asset_zoo/robots/unitree_g1/xmls"
    (tmp_path / "assets").symlink_to(folder / "assets")
    model = tmp_path / "g1.xml"
    model.write_bytes((folder / "g1.xml").read_bytes())
    board = board_of(Setup(file=model, joint=JOINT))[0]
    weight = next(part for part in board.effects if "sine" in part.parameters).parameters
    moment = float(np.hypot(weight["sine"].value, weight["cosine"].value))
    truth = robots.plain(board.inertia.value + TRUTH["armature.inertia"], 0.0, TRUTH["damping"])
    options = SynthOptions(angles=(0.22, -0.2, 0.17), rate=500.0, duration=3.0, sensor=Sensor(noise=3e-4))
    log = tmp_path / "ankle.csv"
    synthesise(truth, {"gravity": (moment,), "coulomb": (TRUTH["coulomb.torque"],)}, options).save(log)
    done = husky(
        "fit", log, "--model", model, "--joint", JOINT, "--effect", "coulomb", "--effect", "armature",
        "--workspace", tmp_path, "--json", tmp_path / "fit.json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "fit.json").read_text())["parameters"]
    robots.assert_near(found, TRUTH)
    before, after = model.read_text().splitlines(), (tmp_path / f"g1_{JOINT}.xml").read_text().splitlines()
    changed = [new for old, new in zip(before, after, strict=True) if old != new]
    assert len(changed) == 1
    assert JOINT in changed[0]
    # By its own 2 ms within 1 %; Euler at the 5 ms of mjlab's scenes is what adds to it there.
    for step, most in (((), 0.01), (("--timestep", "0.005"), 0.015)):
        checked = husky(
            "check", log, "--board", f"g1_{JOINT}", "--workspace", tmp_path, *step, "--json", tmp_path / "check.json",
        )  # fmt: skip
        assert checked.returncode == 0, checked.stderr
        assert json.loads((tmp_path / "check.json").read_text())["nrmse"] < most
