"""A joint of a model as a record: inertia, weight and what else the model says, against mechanics by hand and MuJoCo's own."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
import robots

from sim.model.arc import walk
from sim.model.scene import scene_of
from sim.model.setup import Payload, Setup
from sim.model.subject import board_of, known_of
from sysid.board import Board
from sysid.errors import SysidError
from sysid.joint import JointLaw


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return robots.write(tmp_path_factory.mktemp("robots"))


def of(file: Path, joint: str, **options) -> Board:
    return board_of(Setup(file=file, joint=joint, **options))[0]


def test_a_slide_is_its_mass_spring_and_constant_weight(files):
    board = of(files["slider"], "lift")
    assert (board.inertia.value, board.inertia.unit) == (pytest.approx(1.5), "kg")
    assert {name: (q.value, q.unit) for name, q in board.tilt.items()} == {
        "stiffness": (200.0, "N/m"), "damping": (0.8, "N*s/m"), "rest_angle": (0.03, "m"), "range": (pytest.approx(0.23), "m"),
    }  # fmt: skip
    (weight,) = board.effects
    assert weight.parameters["constant"].value == pytest.approx(-1.5 * 9.81)
    assert weight.parameters["constant"].unit == "N"
    assert weight.parameters["sine"].value == 0.0


def test_a_held_chain_is_a_physical_pendulum(files):
    """With the ankle straight the foot hangs 0.3 m below the knee; the link's own inertia is the compiled body's."""
    board = of(files["arm"], "knee")
    model = mujoco.MjModel.from_xml_path(str(files["arm"]))
    link, foot = model.body("link"), model.body("foot")
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, link.iquat)
    about_own = float((turn.reshape(3, 3) @ np.diag(link.inertia) @ turn.reshape(3, 3).T)[1, 1])
    by_hand = 0.001 + about_own + 0.4 * (0.01**2 + 0.1**2) + float(foot.inertia[1]) + 0.2 * 0.3**2
    assert board.inertia.value == pytest.approx(by_hand, rel=1e-9)
    weight = next(part for part in board.effects if "sine" in part.parameters).parameters
    assert weight["sine"].value == pytest.approx(-9.81 * (0.4 * 0.1 + 0.2 * 0.3))
    assert weight["cosine"].value == pytest.approx(9.81 * 0.4 * 0.01)
    assert board.rest_angle == pytest.approx(math.atan(0.004 / 0.1), abs=1e-4)
    assert board.damping == 0.02
    assert {part.name for part in board.effects} == {"coulomb", "weight"}


def test_another_pose_or_payload_is_another_weight_and_inertia(files):
    plain, bent = of(files["arm"], "knee"), of(files["arm"], "knee", keyframe="bent")
    assert of(files["arm"], "knee", pose={"ankle": 0.5}).inertia == bent.inertia
    assert bent.inertia.value < plain.inertia.value
    loaded = known_of(of(files["arm"], "knee", payload=(Payload.parse("0.3@tip"),)))
    assert loaded["inertia"] - plain.inertia.value == pytest.approx(0.3 * 0.2**2, rel=1e-6)
    assert loaded["payload.sine"] == pytest.approx(-0.3 * 9.81 * 0.2)
    assert loaded["weight.sine"] == known_of(plain)["weight.sine"]
    assert known_of(of(files["arm"], "knee", payload=(Payload.parse("0.3@0,0,-0.2"),))) == pytest.approx(
        loaded
    )


@pytest.mark.parametrize("joint", ["hip", "crank"])
def test_a_loop_moves_along_and_accelerates_as_mujoco_says(files, joint):
    """MuJoCo's own solver, which knows nothing of the reduced mass matrix, gives the same acceleration from rest."""
    setup = Setup(file=files["leg"], joint=joint)
    board, notes = board_of(setup)
    assert any("carries along" in note and "knee" in note for note in notes)
    law, scene = JointLaw.from_board(board), scene_of(setup)
    data = mujoco.MjData(scene.model)
    where = scene.model.joint(joint)
    scene.model.opt.timestep = 1e-5
    for start in (-0.35, 0.3):
        mujoco.mj_resetData(scene.model, data)
        scene.begin(scene.model, data, start, 0.0)
        mujoco.mj_step(scene.model, data, nstep=2000)
        moved = float(data.qpos[where.qposadr[0]]) - start
        from sysid.joint import simulate

        predicted = simulate(law, np.linspace(0.0, 0.02, 50), start).roll[-1] - start
        assert moved == pytest.approx(predicted, rel=0.01)


def test_free_joints_follow_by_the_schur_complement(files):
    setup = Setup(file=files["arm"], joint="knee", pose={"ankle": 0.5}, free=("ankle",))
    model = setup.load().compile()
    data = mujoco.MjData(model)
    data.qpos[1] = 0.5
    mujoco.mj_forward(model, data)
    mass = np.zeros((2, 2))
    mujoco.mj_fullM(model, data, mass)
    arc = walk(setup, setup.load())
    assert arc.at(0.0, arc.inertia) == pytest.approx(mass[0, 0] - mass[0, 1] ** 2 / mass[1, 1], rel=1e-6)
    assert arc.loose


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"joint": "kne"}, "no joint 'kne'. Did you mean 'knee'"),
        ({"keyframe": "straight"}, "no keyframe 'straight'. Keyframes: bent"),
        ({"pose": {"hip": 1.0}}, "no hinge or slide 'hip'"),
        ({"free": ("toe",)}, "no hinge or slide 'toe'"),
        ({"payload": (Payload(0.1, "heel"),)}, "no site 'heel'"),
        ({"file": Path("missing.xml")}, "missing.xml: there is no such model"),
    ],
)
def test_what_is_not_there_is_said(files, change, says):
    with pytest.raises(SysidError, match=says):
        board_of(Setup(file=files["arm"], joint="knee").with_(**change))


def test_a_joint_that_an_equality_holds_is_not_passive(tmp_path):
    held = robots.SLIDER.replace(
        "</mujoco>", '<equality><joint joint1="lift" polycoef="0.1 0 0 0 0"/></equality></mujoco>'
    )
    (tmp_path / "held.xml").write_text(held)
    with pytest.raises(SysidError, match="an equality constraint holds the joint"):
        of(tmp_path / "held.xml", "lift")


def test_a_record_remembers_how_it_was_measured(files, tmp_path):
    setup = Setup(
        file=files["arm"], joint="knee", keyframe="bent", pose={"ankle": 0.2}, free=("ankle",),
        payload=(Payload.parse("0.3@tip"), Payload.parse("0.1@0,0.1,-0.2")),
    )  # fmt: skip
    board = board_of(setup)[0]
    board.save(tmp_path / f"{board.name}.toml")
    read = Board.load(tmp_path / f"{board.name}.toml")
    assert Setup.of_entry(read.model) == setup
    assert JointLaw.from_board(read) == JointLaw.from_board(board)
