"""From a stranger's model to a mended one, by the commands; the truth is integrated by formulas of its own."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import robots
from command_line import husky

from sim.model.setup import Setup
from sim.model.subject import board_of
from sysid.synth import SynthOptions, synthesise
from sysid.synth.sensors import Sensor

KNEE = {"damping": 0.035, "coulomb.torque": 0.02, "armature.inertia": 0.002}
LIFT = {"stiffness": 212.0, "damping": 1.1, "rest_angle": 0.028}


def knee_log(path: Path, model: Path, *, seed: int = 0) -> Path:
    """A pendulum of the arm's inertia and moment, about where it hangs, with the truth of `KNEE`."""
    board = board_of(Setup(file=model, joint="knee"))[0]
    moment = 9.81 * float(np.hypot(0.4 * 0.1 + 0.2 * 0.3, 0.4 * 0.01))
    truth = robots.plain(board.inertia.value + KNEE["armature.inertia"], 0.0, KNEE["damping"])
    options = SynthOptions(
        angles=(0.8, -0.6, 0.5), rate=250.0, duration=4.0, seed=seed, sensor=Sensor(noise=1e-3)
    )
    synthesise(truth, {"gravity": (moment,), "coulomb": (KNEE["coulomb.torque"],)}, options).save(path)
    return path


def lift_log(path: Path) -> Path:
    """A mass on a spring under its weight, in m."""
    truth = robots.plain(1.5, LIFT["stiffness"], LIFT["damping"], LIFT["rest_angle"])
    options = SynthOptions(angles=(0.06, -0.17), rate=500.0, duration=4.0, sensor=Sensor(noise=2e-4))
    synthesise(truth, {"preload": (-1.5 * 9.81,)}, options).save(path)
    return path


@pytest.fixture(scope="module")
def mended(tmp_path_factory):
    """The arm's model, a log of its knee, and what `fit` made of both."""
    folder = tmp_path_factory.mktemp("stranger")
    model = robots.write(folder)["arm"]
    log = knee_log(folder / "swing.csv", model)
    done = husky(
        "fit", log, "--model", model, "--joint", "knee", "--effect", "coulomb", "--effect", "armature",
        "-o", folder / "mended.xml", "--workspace", folder, "--json", folder / "fit.json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder, done


def test_fit_finds_the_truth_and_shows_the_change(mended):
    folder, done = mended
    found = json.loads((folder / "fit.json").read_text())["parameters"]
    assert set(found) == set(KNEE)
    robots.assert_near(found, KNEE)
    assert "+++ " in done.stdout
    assert 'range="-150 150" damping="0.03' in done.stdout
    (following,) = (line for line in done.stdout.splitlines() if line.startswith("next: check it in MuJoCo"))
    assert f"--model {folder / 'mended.xml'}" in following
    assert "known from the model, not fitted" in done.stderr


def test_the_gate_lets_only_the_mended_model_pass(mended):
    folder, _ = mended
    ours = ("check", folder / "swing.csv", "--joint", "knee", "--workspace", folder)
    stranger = husky(*ours, "--model", folder / "arm.xml")
    assert stranger.returncode == 3
    assert "does not decay like joint 'arm_knee'" in stranger.stderr
    copy = husky(*ours, "--model", folder / "mended.xml", "--json", folder / "check.json")
    assert copy.returncode == 0, copy.stderr
    assert json.loads((folder / "check.json").read_text())["nrmse"] < 0.01
    by_name = husky("check", folder / "swing.csv", "--board", "arm_knee", "--workspace", folder)
    assert by_name.returncode == 0, by_name.stderr
    assert "mended.xml, implicitfast at 2 ms" in by_name.stdout


def test_a_slide_is_fitted_in_metres_with_its_weight_known(tmp_path):
    model, log = robots.write(tmp_path)["slider"], lift_log(tmp_path / "bounce.csv")
    done = husky(
        "fit", log, "--unit", "m", "--model", model, "--joint", "lift", "-o", tmp_path / "mended.xml",
        "--workspace", tmp_path, "--json", tmp_path / "fit.json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "fit.json").read_text())["parameters"]
    assert {name: q["unit"] for name, q in found.items()} == {
        "stiffness": "N/m",
        "damping": "N*s/m",
        "rest_angle": "m",
    }
    robots.assert_near(found, LIFT)
    checked = husky("check", log, "--unit", "m", "--board", "slider_lift", "--workspace", tmp_path)
    assert checked.returncode == 0, checked.stderr
    assert "mrad" not in checked.stdout
    assert "° " not in done.stdout
    own = ("--unit", "m", "--board", "slider_lift", "--workspace", tmp_path)
    measured = husky("decay", log, *own).stdout
    assert re.search(r"│ 1 +│ [\d.]+ +│ [-+][\d.]+ mm ", measured)
    assert "roll" not in measured
    assert husky("report", log, *own, "-o", tmp_path / "lift.html").returncode == 0
    page = (tmp_path / "lift.html").read_text()
    text = re.sub(r"<(script|style).*?</\1>|<[^>]*>", " ", page, flags=re.S).lower()
    assert not re.search(r"\broll\b|\bangle\b|training", text)
    for command in (("boards",), ("history", "--board", "slider_lift")):
        listed = husky(*command, "--workspace", tmp_path).stdout
        assert "mrad" not in listed
        assert "[rad]" not in listed


@pytest.mark.parametrize(
    ("arguments", "says", "code"),
    [
        ((), "whose joint is it?", 2),
        (("--joint", "knee"), "--joint: only with --model", 2),
        (("--board", "pink", "--model", "arm.xml", "--joint", "knee"), "--board and --model", 2),
        (("--model", "arm.xml", "--joint", "knee", "--pose", "ankle"), "expected --pose NAME=VALUE", 1),
        (("--model", "arm.xml", "--joint", "knee", "--effect", "weight"), None, 1),
    ],
)
def test_what_does_not_go_together_is_said(tmp_path, monkeypatch, arguments, says, code):
    robots.write(tmp_path)
    monkeypatch.chdir(tmp_path)
    knee_log(tmp_path / "swing.csv", tmp_path / "arm.xml") if says is None else (
        tmp_path / "swing.csv"
    ).touch()
    done = husky("fit", "swing.csv", *arguments)
    if says is None:  # the weight is there already
        assert done.returncode == 0
        return
    assert done.returncode == code
    assert says in done.stderr


def test_known_masses_tell_armature_and_weight_apart(tmp_path):
    """One pose leaves both open; with two masses on the tip the fit finds both, and says what all poses fix."""
    model = robots.write(tmp_path)["arm"]
    board = board_of(Setup(file=model, joint="knee"))[0]
    entries = []
    for number, load in enumerate((0.0, 0.3)):
        truth = robots.plain(board.inertia.value + 0.002 + load * 0.2**2, 0.0, 0.035)
        moment = 1.06 * 9.81 * float(np.hypot(0.1, 0.004)) + load * 9.81 * 0.2
        options = SynthOptions(
            angles=(0.8, -0.6), rate=125.0, duration=3.0, seed=number, sensor=Sensor(noise=1e-3)
        )
        synthesise(truth, {"gravity": (moment,)}, options).save(tmp_path / f"{number}.csv")
        entries.append(f'[[log]]\nfile = "{number}.csv"\n' + (f'payload = ["{load}@tip"]\n' if load else ""))
    (tmp_path / "runs.toml").write_text("\n".join(entries))
    options = (
        "--model", model, "--joint", "knee", "--plain", "--effect", "armature", "--bound", "weight.scale=0.5:2",
        "--workspace", tmp_path, "-o", tmp_path / "mended.xml",
    )  # fmt: skip
    both = husky("fit", tmp_path / "runs.toml", *options, "--json", tmp_path / "fit.json")
    assert both.returncode == 0, both.stderr
    found = json.loads((tmp_path / "fit.json").read_text())["parameters"]
    robots.assert_near(found, {"armature.inertia": 0.002, "weight.scale": 1.06, "damping": 0.035})
    assert "best pose alone" in both.stdout
    alone = husky("fit", tmp_path / "0.csv", *options)
    assert alone.returncode == 1, alone.stdout
    assert "these logs do not fix it" in alone.stderr


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[log]\nfile = 1", "expected tables"),
        ('[[log]]\nfile = "a.csv"\nposes = {}', "unknown field 'poses'. Did you mean 'pose'"),
        ("[[log", "cannot read the list of logs"),
    ],
)
def test_a_list_of_logs_says_what_is_wrong_with_it(tmp_path, text, says):
    model = robots.write(tmp_path)["arm"]
    (tmp_path / "runs.toml").write_text(text)
    done = husky("fit", tmp_path / "runs.toml", "--model", model, "--joint", "knee")
    assert done.returncode == 1
    assert says in done.stderr
