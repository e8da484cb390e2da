"""`fit` changes the record once, wholly, and only when it is sure."""

import json

import pytest
from command_line import called

from sysid.board import load_board
from sysid.errors import SysidError
from sysid.files import sha256
from sysid.workspace import shipped_data

LOG = shipped_data() / "decays" / "pink_hidden.csv"


def run(folder, *effects, log=LOG):
    options = [word for name in effects for word in ("--effect", name)]
    place = ("--workspace", folder, "--json", folder / "fit.json")
    return called("fit", log, "--board", "pink", *options, *place)


def test_record_gets_values_provenance_and_a_line_of_history(tmp_path):
    assert run(tmp_path, "coulomb") == 0
    board = load_board(tmp_path / "data" / "boards" / "pink.toml")
    (coulomb,) = board.effects
    torque = coulomb.parameters["torque"]
    assert abs(torque.value - 0.15) < 3 * torque.std
    assert board.fit["logs"][0]["sha256"] == sha256(LOG)
    assert board.fit["rmse"] < 1.1 * board.fit["noise_floor"]
    assert board.last_check == {}
    (line,) = board.history
    assert line["effects"] == ["coulomb"]
    assert line["rmse_before"] > 2 * line["rmse"]
    content = json.loads((tmp_path / "fit.json").read_text())
    errors = [rung["rmse_rad"] for rung in content["ladder"]]
    assert len(errors) == 2
    assert errors[1] < 0.8 * errors[0]
    assert (tmp_path / "reports" / "pink" / "ladder.png").is_file()
    assert "coulomb" not in (shipped_data() / "boards" / "pink.toml").read_text()


def test_a_law_that_is_not_that_of_the_log_is_said(tmp_path, capsys):
    """Its numbers go into the record all the same, and nothing else says that they are no measurement."""
    for effects, said in (((), True), (("coulomb",), False)):
        assert run(tmp_path, *effects) == 0
        printed = capsys.readouterr()
        assert ("a compromise" in printed.err) == said
        assert ("next: find the missing effect: husky-sysid diagnose" in printed.out) == said
        warnings = json.loads((tmp_path / "fit.json").read_text())["warnings"]
        assert any("a compromise" in warning for warning in warnings) == said


def test_errors_of_a_rate_are_given_as_angles(tmp_path):
    """What ends in `_rad` is one: an error of the rate over the joint's frequency, as `compare` gives it."""
    from sysid.joint import JointLaw
    from sysid.synth import SynthOptions, synthesise

    record = load_board(shipped_data() / "boards" / "pink.toml")
    log = tmp_path / "gyro.csv"
    synthesise(record, {}, SynthOptions(angles=(0.17, -0.15), duration=1.0, dialect="gyro")).save(log)
    run(tmp_path, log=log)
    content = json.loads((tmp_path / "fit.json").read_text())
    board = load_board(tmp_path / "data" / "boards" / "pink.toml")
    assert content["signal"] == "rate"
    assert board.fit["unit"] == "rad/s"
    frequency = JointLaw.from_board(board).frequency
    (rung,) = content["ladder"]
    for name, entry in (
        ("rmse_rad", "rmse"),
        ("heldout_rmse_rad", "heldout_rmse"),
        ("noise_floor_rad", "noise_floor"),
    ):
        assert content[name] == pytest.approx(board.fit[entry] / frequency, rel=1e-6)
    assert content["rmse_before_rad"] == pytest.approx(board.history[-1]["rmse_before"] / frequency, rel=1e-6)
    assert (rung["rmse_rad"], rung["heldout_rmse_rad"]) == (content["rmse_rad"], content["heldout_rmse_rad"])


@pytest.mark.parametrize(
    ("effect", "reason"),
    [("inertia", "only k/I"), ("end-stop", "unchanged"), ("frobnicate", "unknown effect")],
)
def test_a_refused_fit_leaves_no_trace(tmp_path, effect, reason):
    with pytest.raises(SysidError, match=reason):
        run(tmp_path, effect)
    assert not (tmp_path / "data").exists()
