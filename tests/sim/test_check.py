"""The gate passes what decays as measured, and says why where it does not."""

import json
import runpy
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from command_line import called
from made import release

from sim.board.scene import board_spec
from sim.check.decays import check_scene
from sim.check.rules.departures import departures
from sim.compensation.parasitics import measure, measure_parasitics
from sim.compensation.scene import compensate, training_scene
from sim.model.scene import scene_from_file
from sysid.board import Board, BoardEffect, load_board
from sysid.errors import QualityGateError, SysidError
from sysid.joint import JointLaw, simulate
from sysid.logs import LogOptions, read_roll
from sysid.quantity import Quantity
from sysid.releases import find_releases
from sysid.roll import Release
from sysid.workspace import Workspace, shipped_data

DECAYS = shipped_data() / "decays"
LYING = Path(__file__).parents[2] / "docs" / "examples" / "lying_scene.xml"


def measured(board: Board, *, angle: float = 0.17, noise: float = 0.0, bias: float = 0.0) -> Release:
    """A clean release by the continuous law, or with white noise and a sensor's offset."""
    time = np.arange(0.0, 0.5, 0.002)
    roll = simulate(JointLaw.from_board(board), time, angle).roll + bias
    return release(
        time, roll, noise, rng=np.random.default_rng(4), rest=board.rest_angle + bias, hold=0.5, end="rest"
    )


@pytest.mark.parametrize("coupling", ["equality", "direct"])
def test_our_scene_decays_like_the_board_within_a_percent(board: Board, coupling: str):
    written = compensate(board, "in-scene", coupling=coupling)
    scene = training_scene(written.board, coupling=coupling)
    releases = find_releases(read_roll(DECAYS / f"{board.name}.csv", LogOptions()))
    result = check_scene(board, scene, releases)
    assert len(result.releases) == 4
    assert result.nrmse < 0.01
    clean = check_scene(board, scene, [measured(board), measured(board, angle=-0.12)])
    assert clean.nrmse < 0.005
    assert written.board.stiffness == board.stiffness
    assert written.decay_error < 0.005 < 0.02 < written.decay_error_before


def test_noise_and_an_unknown_zero_do_not_count_against_the_scene(board: Board):
    scene = training_scene(compensate(board, "step-compensated").board, coupling="direct")
    clean = check_scene(board, scene, [measured(board)])
    glued_on_askew = replace(measured(board, noise=0.003, bias=0.05), zero="constant")
    noisy = check_scene(board, scene, [glued_on_askew])
    assert noisy.rmse > 0.0025
    assert clean.hidden < 0.005 < noisy.hidden
    assert noisy.nrmse == pytest.approx(clean.nrmse, abs=0.008)
    assert noisy.releases[0].zero == pytest.approx(0.05, abs=1e-3)


def test_decays_beyond_the_scenes_range_are_compared_from_where_they_come_within(board: Board):
    scene = training_scene(compensate(board, "in-scene").board)
    result = check_scene(board, scene, [measured(board, angle=0.583)])
    assert result.releases[0].cut > 0.01
    assert result.nrmse < 0.01
    outside = replace(measured(board), roll=np.full(250, 0.5), rest=0.0)
    with pytest.raises(SysidError, match="within the scene's tilt range"):
        check_scene(board, scene, [outside])


def test_what_the_scene_adds_is_found_where_it_was_put(board: Board):
    """A spring on both trucks adds 2 k tan²λ, more damping and inertia of the deck show as themselves."""
    spec_scene = training_scene(board, coupling="equality")
    plain = measure(board, spec_scene)
    assert plain.stiffness == pytest.approx(board.stiffness, rel=1e-4)
    spec = board_spec(board)
    spec.delete(spec.joint("board_free_joint"))
    for end in ("front", "rear"):
        servo = spec.add_actuator(name=f"{end}_servo", target=f"{end}_truck_joint")
        servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
        servo.set_to_position(kp=1.0, kv=0.02)
    found = measure_parasitics(board, replace(spec_scene, model=spec.compile()))
    assert dict(found.parts)["servos"].stiffness == pytest.approx(2 * 1.0 * 3.0, rel=0.03)
    assert dict(found.parts)["servos"].damping == pytest.approx(2 * 0.02 * 3.0, rel=0.3)
    assert any("servos +" in reason for reason in departures(found))


def test_effects_of_the_record_are_not_blamed_on_the_scene(board: Board):
    effects = (
        BoardEffect("coulomb", {"torque": Quantity(0.1, 0.0, "N*m")}),
        BoardEffect("gravity", {"moment": Quantity(1.0, 0.0, "N*m")}),
    )
    rich = replace(board, effects=effects)
    scene = training_scene(compensate(rich, "in-scene").board)
    assert list(departures(measure_parasitics(rich, scene))) == []
    assert check_scene(rich, scene, [measured(rich)]).nrmse < 0.01


def test_the_lying_scene_is_made_by_its_script():
    script = runpy.run_path(str(LYING.with_name("make_lying_scene.py")))
    assert script["lying_scene"](load_board(shipped_data() / "boards" / "pink.toml")) == LYING.read_text()


def test_a_scene_that_lies_is_found_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    place = ("--workspace", tmp_path, "--json", tmp_path / "out.json")
    with pytest.raises(QualityGateError) as error:
        called("check", DECAYS / "pink.csv", "--board", "pink", "--scene-file", LYING, *place)
    assert error.value.exit_code == 3
    for words in (
        "does not swing", "servos +45", "stop the deck at ±0.0577", "weighs 7.58 kg", "deck by itself"
    ):  # fmt: skip
        assert words in str(error.value)
    out = json.loads((tmp_path / "out.json").read_text())
    assert out["passed"] is False
    assert out["nrmse"] > 0.2
    assert len(out["reasons"]) >= 5
    assert not (tmp_path / "data").exists(), "a foreign scene says nothing about the board's own"
    assert "servos" in capsys.readouterr().out


def test_check_writes_its_verdict_into_the_workspace(tmp_path: Path):
    shipped = (shipped_data() / "boards" / "pink.toml").read_bytes()
    assert called("check", DECAYS / "pink.csv", "--board", "pink", "--workspace", tmp_path) == 0
    board = Workspace(tmp_path).load_board("pink")
    assert board.passed
    assert board.last_check["nrmse"] < 0.01
    assert "equality coupling" in board.last_check["scene"]
    with pytest.raises(
        QualityGateError, match=r"inertia .*expected.*5 ms step and the export alone cost 5\.\d %"
    ):
        options = ("--export", "physical", "--workspace", tmp_path)
        called("check", DECAYS / "black.csv", "--board", "black", *options)
    assert not Workspace(tmp_path).load_board("black").passed
    assert (shipped_data() / "boards" / "pink.toml").read_bytes() == shipped


def test_bad_scene_files_are_refused_in_words(tmp_path: Path):
    with pytest.raises(SysidError, match=r"no joint .board_tilt.\..*board_tilt_joint"):
        scene_from_file(LYING, joint="board_tilt")
    with pytest.raises(SysidError, match="turns about"):
        scene_from_file(LYING, joint="front_truck_joint")
    broken = tmp_path / "broken.xml"
    broken.write_text("<mujoco><worldbody>")
    with pytest.raises(SysidError, match="cannot read it"):
        scene_from_file(broken)


def rests_at(board: Board, angle: float, std: float = 0.0) -> Board:
    return board.with_tilt(rest_angle=Quantity(angle, std, "rad"))


@pytest.mark.parametrize("angle", [0.02, 0.1])
def test_a_scene_that_rests_elsewhere_fails_and_says_so(board: Board, angle: float):
    off = rests_at(board, angle)
    scene = training_scene(compensate(off, "in-scene").board)
    made = measured(board)
    result = check_scene(off, scene, [made])
    assert result.nrmse > result.tolerance
    assert result.rest_error == pytest.approx(-angle, rel=0.05)
    known_no_better = rests_at(board, angle, std=angle)
    assert check_scene(known_no_better, scene, [made]).nrmse < 0.02
    unknown_zero = replace(made, zero="constant")
    assert check_scene(off, scene, [unknown_zero]).nrmse < 0.02


def test_a_rest_angle_beyond_the_range_is_refused(board: Board):
    scene = training_scene(compensate(board, "in-scene").board)
    with pytest.raises(SysidError, match="lean on its stop"):
        check_scene(rests_at(board, 3.0), scene, [measured(board)])
