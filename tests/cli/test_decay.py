"""`husky-sysid decay` as a user calls it."""

import json
from pathlib import Path

import pytest
from command_line import called
from decay_truth import Recipe, make_roll, write_log

from sysid.errors import SysidError
from sysid.workspace import shipped_data

NAMES = [
    "log_decrement",
    "damping_ratio",
    "period_s",
    "omega_d",
    "omega_n",
    "inertia",
    "stiffness",
    "damping",
]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    roll = make_roll(Recipe(sampling=500, amplitudes=(0.2, -0.18, 0.15)))
    return write_log(tmp_path_factory.mktemp("logs") / "rock.csv", roll)


def test_prints_releases_table_law_verdict_and_paths(log, tmp_path, capsys):
    assert called("decay", log, "--board", "pink", "--workspace", tmp_path) == 0
    out, err = capsys.readouterr()
    assert out.startswith(f"{log} · ")
    said = (
        "amplitude",
        "value ± 95 %",
        "log decrement δ",
        "stiffness k = I ω_n²",
        "\n8.70e-3 φ̈ + 0.",
        "✓ linear",
        f"next: compare the model with it: husky-sysid compare {log} --board pink",
    )
    for text in (*said, "0.0087000 ± 0.0000057", str(tmp_path / "reports" / "pink" / "decay.json")):
        assert text in out
    assert "  signal   from 'roll_rad'\n" in err  # what was inferred
    picture = tmp_path / "reports" / "pink" / "decay.png"
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert not list(picture.parent.glob(".*"))


def test_result_file_is_what_the_design_says(log, tmp_path, capsys):
    called("decay", log, "--board", "pink", "--workspace", tmp_path, "--json", "-", "--no-picture")
    content = json.loads(capsys.readouterr().out)  # nothing else on stdout
    assert content == json.loads((tmp_path / "reports" / "pink" / "decay.json").read_text())
    assert not (tmp_path / "reports" / "pink" / "decay.png").exists()
    for name in NAMES:
        quantity = content[name]
        assert set(quantity) == {"value", "std", "ci95", "unit"}
        assert quantity["ci95"][0] <= quantity["value"] <= quantity["ci95"][1]
    assert (content["board"], content["log"], content["warnings"]) == ("pink", str(log), [])
    assert len(content["releases"]) == 3
    for release in content["releases"]:
        assert release["t_start_s"] < release["t_end_s"]
        assert {"t_s", "angle_rad"} <= set(release["peaks"][0])
    assert content["stiffness"]["value"] == pytest.approx(
        content["inertia"]["value"] * content["omega_n"]["value"] ** 2
    )
    assert content["omega_n"]["value"] == pytest.approx(41.083, rel=0.05)


def test_json_to_a_file_and_a_given_release(log, tmp_path, capsys):
    target = tmp_path / "deep" / "result.json"
    arguments = ("--board", "black", "--workspace", tmp_path, "--json", target, "--no-picture")
    assert called("decay", log, *arguments, "--from", "2", "--to", "5", "--release", "2.28") == 0
    content = json.loads(target.read_text())
    assert [round(release["t_start_s"], 2) for release in content["releases"]] == [2.28]
    assert "2.2" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "text"),
    [(("--board", "pnk"), "Did you mean 'pink'"), (("--board", "pink", "--from", "90"), "the log runs from")],
)
def test_expected_failures_write_nothing(log, tmp_path, arguments, text):
    with pytest.raises(SysidError, match=text):
        called("decay", log, *arguments, "--workspace", tmp_path)
    assert not (tmp_path / "reports").exists()


def test_friction_in_the_rest_levels_is_no_linear_decay(tmp_path, capsys):
    """The log with hidden friction: k from a linear decay is 80 % too stiff, and is not handed out as good."""
    log = shipped_data() / "decays" / "pink_hidden.csv"
    asked = ("decay", log, "--board", "pink", "--workspace", tmp_path, "--no-picture")
    called(*asked, "--json", tmp_path / "d.json")
    content = json.loads((tmp_path / "d.json").read_text())
    assert content["residual"]["linear"] is False
    assert "come to rest at" in content["warnings"][0]
    out = capsys.readouterr().out
    assert "husky-sysid diagnose" in out
    assert "✓" not in out


@pytest.mark.parametrize("command", ["decay", "fit"])
def test_a_log_with_an_input_sends_to_driven_joints(tmp_path, capsys, command):
    examples = Path(__file__).parents[2] / "docs" / "examples"
    (tmp_path / "arm.xml").write_bytes((examples / "driven_arm.xml").read_bytes())
    joint = ("--model", tmp_path / "arm.xml", "--joint", "shoulder", "--column", "q_shoulder_rad")
    called(command, examples / "driven_arm.csv", *joint, "--workspace", tmp_path)
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "docs/driven.md" in line]
    assert "--input action_shoulder_rad --input-is command" in line
