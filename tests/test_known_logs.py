"""Whole commands on logs whose truth is known: what they say lies within their own stated uncertainty of it."""

import json
import shlex

import mujoco
import pytest
from command_line import husky

from sysid.quantity import Z95

Z = 4.0
"""Standard deviations by which an estimate may miss the truth: once in 16,000 by chance."""
LOGS = {
    "angle": ("", "--seed 11 --releases 3"),
    "black": ("", "--board black --seed 12 --releases 3 --rate 500"),
    "gaps": ("", "--seed 14 --releases 3 --rate 300 --jitter 0.2 --dropout 0.05"),
    "quantised": ("", "--seed 13 --releases 3 --rate 500 --noise 0 --quantisation 0.1"),
    "degrees": ("", "--seed 17 --releases 2 --rate 400 --dialect angle-deg"),
    "gyro": ("", "--seed 21 --releases 3 --rate 400 --dialect gyro"),
    "imu": ("", "--board black --seed 24 --releases 2 --rate 200 --dialect imu --lever-arm 0 0 0.04"),
    "phyphox": ("", "--seed 26 --releases 2 --rate 200 --dialect phyphox"),
    "sensor_logger": ("", "--seed 27 --releases 2 --rate 100 --dialect sensor-logger"),
    "coulomb": ("coulomb", "--seed 31 --releases 3 --rate 500 --effect coulomb=0.15"),
    "cubic_stiffness": (
        "cubic-stiffness",
        "--seed 33 --releases 3 --rate 500 --noise 0.02 --effect cubic-stiffness=400",
    ),
}
"""Effect that the record lacks, and how `synth` makes the log."""
ENDINGS = {"phyphox": "zip", "sensor_logger": "zip"}


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("known")
    for name, (_, recipe) in LOGS.items():
        board = "" if "--board" in recipe else "--board pink"
        done = husky("synth", *shlex.split(f"{recipe} {board}"), "-o", log_of(folder, name))
        assert done.returncode == 0, done.stderr
    return folder


def log_of(folder, name):
    return folder / f"{name}.{ENDINGS.get(name, 'csv')}"


def board_of(name):
    return "black" if "--board black" in LOGS[name][1] else "pink"


def truth_of(folder, name):
    """Return the true parameters of a log: 'stiffness', 'effect.parameter'."""
    content = json.loads((folder / f"{name}.truth.json").read_text())
    own = {key: part["value"] for key, part in content["parameters"].items()}
    for part in content["effects"]:
        own |= {f"{part['name']}.{key}": value["value"] for key, value in part["parameters"].items()}
    return own


def run(command, *arguments, workspace, code=0):
    result = workspace / "result.json"
    done = husky(command, *arguments, "--workspace", workspace, "--json", result)
    assert done.returncode == code, done.stderr
    return json.loads(result.read_text())


def within(quantity, truth):
    """Assert that a quantity is known, and that the truth lies within `Z` of its standard deviations."""
    low, high = quantity["ci95"]
    assert high > low
    assert abs(quantity["value"] - truth) <= Z / Z95 * (high - low) / 2, (quantity, truth)


@pytest.mark.parametrize("name", [name for name, (effect, _) in LOGS.items() if not effect])
def test_a_linear_decay_is_measured(logs, name, tmp_path):
    found = run("decay", log_of(logs, name), "--board", board_of(name), "--no-picture", workspace=tmp_path)
    truth = truth_of(logs, name)
    for key in ("stiffness", "damping"):
        within(found[key], truth[key])
        assert found[key]["ci95"][1] - found[key]["ci95"][0] < 0.2 * truth[key]
    assert found["residual"]["linear"]
    compared = run(
        "compare", log_of(logs, name), "--board", board_of(name), "--no-picture", workspace=tmp_path
    )
    assert compared["passed"]
    assert 0.8 < compared["rmse_rad"] / compared["noise_floor_rad"] < 1.2


@pytest.mark.parametrize("name", [name for name, (effect, _) in LOGS.items() if effect])
def test_an_effect_is_seen_and_fitted(logs, name, tmp_path):
    effect, log = LOGS[name][0], log_of(logs, name)
    before = run("compare", log, "--board", "pink", "--no-picture", workspace=tmp_path)
    assert not before["passed"]
    fitted = run("fit", log, "--board", "pink", "--effect", effect, workspace=tmp_path)
    truth = truth_of(logs, name)
    for key, quantity in fitted["parameters"].items():
        within(quantity, truth[key])
    assert 0.85 < fitted["rmse_rad"] / fitted["noise_floor_rad"] < 1.15
    after = run("compare", "--board", "pink", "--no-picture", workspace=tmp_path)
    assert after["passed"]
    assert after["nrmse"] < before["nrmse"] / 2


@pytest.mark.parametrize("board", ["pink", "black"])
def test_the_whole_way(board, tmp_path):
    log = f"data/decays/{board}.csv"
    record = run("fit", log, "--board", board, workspace=tmp_path)
    assert run("compare", "--board", board, workspace=tmp_path)["passed"]
    checked = run("check", "--board", board, workspace=tmp_path)
    assert checked["passed"]
    assert checked["nrmse"] < checked["tolerance"]
    made = run("mjcf", "--board", board, "-o", tmp_path / "scene.xml", workspace=tmp_path)
    assert made["decay_nrmse"] < 0.02
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "scene.xml"))
    assert model.joint("board_tilt_joint").stiffness[0] == pytest.approx(
        made["written"]["stiffness_nm_rad"], rel=1e-4
    )
    shown = run("boards", board, workspace=tmp_path)
    assert shown["tilt"]["stiffness"]["value"] == pytest.approx(
        record["parameters"]["stiffness"]["value"], rel=1e-9
    )
    (row,) = (row for row in run("boards", workspace=tmp_path)["boards"] if row["board"] == board)
    assert row["passed"]


@pytest.mark.slow
@pytest.mark.parametrize("film", ["marker", "dots"])
def test_a_film_is_measured(film, film_of, tmp_path):
    made = film_of(film)
    found = run("decay", made.path, "--board", "pink", "--no-picture", workspace=tmp_path)
    assert 0.8 < found["stiffness"]["value"] / 14.684 < 1.25
    assert found["stiffness"]["ci95"][0] < 14.684 < found["stiffness"]["ci95"][1]
