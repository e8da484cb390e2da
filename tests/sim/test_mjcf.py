"""The written file is the board: it loads, says where its numbers come from, and decays as it should."""

import json
import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from command_line import called
from made import release, with_effect

from sim.check.decays import check_scene
from sim.mjcf import board_mjcf
from sim.model.scene import scene_from_file
from sysid.board import Board, BoardEffect, load_board, save_board
from sysid.effects import catalogue
from sysid.errors import SysidError
from sysid.joint import JointLaw, simulate
from sysid.quantity import Quantity
from sysid.roll import Release
from sysid.workspace import shipped_data

pytestmark = pytest.mark.train


def decay_of(board: Board, angle: float = 0.17) -> Release:
    time = np.arange(0.0, 0.5, 0.002)
    return release(time, simulate(JointLaw.from_board(board), time, angle).roll, end="rest")


@pytest.mark.parametrize(
    ("kind", "integrator", "timestep"),
    [
        ("bench", "implicitfast", 0.005),
        ("bench", "RK4", 0.002),
        ("scene", "implicitfast", 0.005),
        ("scene", "Euler", 0.002),
    ],
)
def test_the_file_decays_like_the_board(
    board: Board, kind: str, integrator: str, timestep: float, tmp_path: Path
):
    made = board_mjcf(board, kind, integrator=integrator, timestep=timestep)
    path = tmp_path / "board.xml"
    path.write_text(made.xml)
    scene = scene_from_file(path)
    assert scene.model.opt.timestep == timestep
    assert check_scene(board, scene, [decay_of(board)]).nrmse < 0.006
    assert scene.model.jnt_stiffness[scene.model.joint("board_tilt_joint").id] == pytest.approx(
        board.stiffness
    )


@pytest.mark.parametrize("name", ["bouc-wen", "dahl", "hysteresis", "stribeck", "viscoelastic"])
def test_a_file_needs_nothing_newer_than_mujoco_3_11(name: str):
    """What MuJoCo 3.12 (`input`) and 4.0 (`springyield`) have stands in no file; this test runs in both."""
    xml = board_mjcf(with_effect(Board.load("pink"), name), "bench", timestep=0.001).xml
    assert catalogue()[name].mujoco.means in xml
    assert " input=" not in xml
    assert "springyield=" not in xml


def test_what_mujoco_cannot_hold_is_said_with_its_cost(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    from sysid.errors import QualityGateError

    save_board(with_effect(Board.load("pink"), "bouc-wen"), tmp_path / "data" / "boards" / "pink.toml")
    place = ("--workspace", tmp_path, "--json", tmp_path / "out.json")
    path = tmp_path / "board.xml"
    assert called("mjcf", "--board", "pink", "-o", path, "--bench", "--timestep", 0.001, *place) == 0
    assert "warning: effect 'bouc-wen': MuJoCo has nothing that unloads so" in (
        said := capsys.readouterr().err
    )
    assert "is 3.0 % off the board" in said
    assert "LuGre" in json.loads((tmp_path / "out.json").read_text())["substitutes"][0]
    with pytest.raises(QualityGateError, match=r"Why: .*bouc-wen"):
        called("check", shipped_data() / "decays" / "pink.csv", "--board", "pink", *place)


def test_the_command_writes_file_and_json(tmp_path: Path):
    path = tmp_path / "deep" / "board.xml"
    place = ("--workspace", tmp_path, "--json", tmp_path / "out.json")
    assert called("mjcf", "--board", "black", "-o", path, "--bench", *place) == 0
    out = json.loads((tmp_path / "out.json").read_text())
    assert out["export"] == "step-compensated"
    assert out["written"]["inertia_kgm2"] == pytest.approx(0.831 * 0.00715, rel=1e-3)
    assert out["decay_nrmse"] < 1e-3 < out["decay_nrmse_uncompensated"]
    assert mujoco.MjModel.from_xml_path(str(path)).nv == 1


def test_a_scene_that_is_unstable_is_refused_and_leaves_no_log_of_mujoco(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A body a thousand times as heavy as the deck hangs on it by next to no spring."""
    heavy = BoardEffect(
        "hanging-body",
        {
            "inertia": Quantity(27.7, 0.0, "kg*m^2"),
            "frequency": Quantity(26.1, 0.0, "rad/s"),
            "damping_ratio": Quantity(0.02, 0.0, "1"),
        },
    )
    pink = load_board(shipped_data() / "boards" / "pink.toml")
    soft = pink.with_tilt(
        stiffness=Quantity(0.22, 0.0, "N*m/rad"), damping=Quantity(0.0067, 0.0, "N*m*s/rad")
    )
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SysidError, match=r"unstable at a step of 0\.005 s"):
        board_mjcf(replace(soft, effects=(heavy,)), "scene")
    assert not list(tmp_path.iterdir())
    assert mujoco.get_mju_user_warning() is None


def write_light(tmp_path: Path, damping: float, *options: str) -> None:
    pink = load_board(shipped_data() / "boards" / "pink.toml")
    board = pink.with_tilt(damping=Quantity(damping, 0.0, "N*m*s/rad"))
    save_board(board, tmp_path / "data" / "boards" / "pink.toml")
    called("mjcf", "--board", "pink", "-o", tmp_path / "board.xml", "--workspace", tmp_path, *options)


@pytest.mark.slow
def test_a_scene_that_is_known_to_be_wrong_is_not_written_without_a_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """The wheels, dragged by the joint equality, damp more than a very light board does."""
    write_light(tmp_path, 0.01)
    assert re.search(
        r"29\.\d % off the board's.*--coupling direct", " ".join(capsys.readouterr().err.split())
    )
    write_light(tmp_path, 0.01, "--coupling", "direct")
    assert "off the board's" not in capsys.readouterr().err
    write_light(tmp_path, 0.045)
    assert "2.2 % off the board's" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("bench", (0.03191392236868486, -0.020157432476494243, 0.002537127046792464, 2.783436167048193e-05)),
        ("scene", (0.03332761689698728, -0.01939404881479037, 0.0018291725904868584, 8.313932657950853e-05)),
    ],
)
def test_a_file_decays_the_same_in_every_mujoco(kind: str, expected: tuple[float, ...]):
    """Files written under MuJoCo 4.0 (`husky-sysid mjcf --board black`), rolls as stepped there."""
    model = mujoco.MjModel.from_xml_path(str(Path(__file__).parents[1] / "data" / f"black_{kind}.xml"))
    data = mujoco.MjData(model)
    tilt = model.joint("board_tilt_joint").qposadr[0]
    data.qpos[tilt] = 0.15
    rolls = []
    for _ in range(40):
        mujoco.mj_step(model, data)
        rolls.append(data.qpos[tilt])
    assert [rolls[step] for step in (4, 9, 19, 39)] == pytest.approx(expected, abs=1e-9)
