"""`compare`, `fit` and `check` of a driven joint, as a user types them."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from command_line import called

from sysid.errors import SysidError

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
LOG, MODEL = EXAMPLES / "driven_arm.csv", EXAMPLES / "driven_arm.xml"
COMMAND = ("--joint", "shoulder", "--input", "action_shoulder_rad", "--input-is", "command")


@pytest.fixture
def true_arm(tmp_path):
    """The arm with the shoulder that made the log."""
    given = '<joint name="shoulder" type="hinge" axis="0 1 0" damping="0.1" armature="0.001"'
    true = given.replace("0.1", "0.24").replace("0.001", "0.0062") + ' frictionloss="0.11"'
    hard = ' solreffriction="0.002 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'
    text = MODEL.read_text()
    assert given in text
    text = text.replace(given, true + hard).replace('kv="0.3"', 'kv="0.3" delay="0.012" nsample="14"')
    (tmp_path / "true.xml").write_text(text)
    return tmp_path / "true.xml"


def test_a_joint_is_replayed_beside_the_measured_motion_of_the_others(tmp_path, true_arm, capsys):
    end = ("--workspace", tmp_path, "--json", "-")
    assert called("check", LOG, "--model", true_arm, *COMMAND, *end) == 0
    assert json.loads(capsys.readouterr().out)["nrmse"] < 0.01  # with the elbow held it is 0.09
    assert called("compare", LOG, "--model", MODEL, *COMMAND, *end) == 0
    assert json.loads(capsys.readouterr().out)["nrmse"] > 0.1


def test_a_comparison_names_the_next_command(tmp_path, capsys):
    called("compare", LOG, "--model", MODEL, *COMMAND, "--to", 4, "--workspace", tmp_path)
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("next: ")]
    assert f"husky-sysid fit {LOG} --model {MODEL} {' '.join(COMMAND)}" in line
    assert "--to 4.0" in line


@pytest.mark.parametrize("command", ["compare", "fit", "diagnose", "check"])
def test_a_motor_without_gains_follows_no_command(tmp_path, command):
    servo = '<position name="shoulder servo" joint="shoulder" kp="12" kv="0.3"/>'
    text = MODEL.read_text()
    assert servo in text
    motor = '<motor name="shoulder motor" joint="shoulder"/>'
    (tmp_path / "motor.xml").write_text(text.replace(servo, motor))
    with pytest.raises(SysidError, match=r"'shoulder motor'.*--gains KP KD"):
        called(command, LOG, "--model", tmp_path / "motor.xml", *COMMAND, "--workspace", tmp_path)


@pytest.mark.parametrize("option", [("--prior", "damping"), ("--profile",), ("--bootstrap", 400)])
def test_options_of_free_swings_are_refused(tmp_path, option):
    with pytest.raises(SysidError, match="--fix and --bound"):
        called("fit", LOG, "--model", MODEL, *COMMAND, "--to", 4, "--workspace", tmp_path, *option)


def test_an_input_that_is_missing_is_named_with_its_option(tmp_path):
    with pytest.raises(SysidError, match="--input 'torque': there is no such column"):
        called("fit", LOG, "--model", MODEL, "--joint", "shoulder", "--input", "torque", "--input-is", "torque",
               "--workspace", tmp_path)  # fmt: skip


def test_all_joints_of_a_log_are_replayed_together(tmp_path, capsys):
    every = ("--joint", "all", "--input", "action", "--input-is", "command")
    called("compare", LOG, "--model", MODEL, *every, "--to", 4, "--workspace", tmp_path, "--json", "-")
    found = json.loads(capsys.readouterr().out)
    assert [one["joint"] for one in found["joints"]] == ["shoulder", "elbow"]


def test_a_model_of_one_joint_and_one_that_is_missing(tmp_path, capsys):
    """A cart under forces in steps: its mass alone, in millimetres."""
    cart = tmp_path / "cart.xml"
    cart.write_text(
        '<mujoco><worldbody><body><joint name="rail" type="slide" damping="9"/><geom size=".1" mass="2"/></body></worldbody></mujoco>'
    )
    model = mujoco.MjModel.from_xml_path(str(cart))
    data, rows = mujoco.MjData(model), []
    for i in range(1500):
        data.qfrc_applied[0] = 5 * np.sign(np.sin(i / 40) + 0.3 * np.sin(i / 17))
        rows.append((i * 0.002, 1e3 * data.qpos[0], data.qfrc_applied[0]))
        mujoco.mj_step(model, data)
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="time_s,pos_mm,force_N", comments="")
    asked = ("compare", tmp_path / "log.csv", "--joint", "rail", "--input", "force_N", "--input-is", "force")
    end = ("--workspace", tmp_path, "--json", "-")
    assert called(*asked, "--model", cart, *end) == 0
    assert json.loads(capsys.readouterr().out)["nrmse"] < 0.01
    with pytest.raises(SysidError, match="no such model"):
        called(*asked, "--model", tmp_path / "lost.xml", *end)


def test_counts_and_degrees_of_a_servo_are_the_motion_in_radians(tmp_path, capsys):
    """Of 4096 counts a turn the model's zero is 2048; degrees have no unit in their names, as in LeRobot's logs."""
    table = np.loadtxt(LOG, delimiter=",", skiprows=1)[:1000]
    found = []
    for size, zero, names, options in (
        (1.0, 0.0, "q_shoulder_rad,q_elbow_rad,action_shoulder_rad,action_elbow_rad", ()),
        (4096 / (2 * np.pi), 2048.0, "q_0,q_1,action_0,action_1", ("--unit", 2 * np.pi / 4096, "--zero", 2048)),
        (180 / np.pi, 0.0, "state.shoulder.pos,state.elbow.pos,action.shoulder.pos,action.elbow.pos", ("--column", "state")),
        (180 / np.pi, 90.0, "q_0,q_1,action_0,action_1", ("--zero", 90)),
        (180 / np.pi, 90.0, "q_shoulder_deg,q_elbow_deg,action_shoulder,action_elbow", ("--zero", 90)),
        (0.5 / np.pi, 0.25, "q_0,q_1,action_0,action_1", ("--unit", "turn", "--zero", 0.25)),
    ):  # fmt: skip
        log = np.column_stack([table[:, 0], table[:, 1:] * size + zero])
        np.savetxt(tmp_path / "log.csv", log, delimiter=",", header=f"time_s,{names}", comments="")
        every = ("--joint", "all", "--input", "action", "--input-is", "command", *options)
        asked = ("--model", MODEL, *every, "--workspace", tmp_path, "--json", "-")
        called("compare", tmp_path / "log.csv", *asked)
        found.append(json.loads(capsys.readouterr().out)["nrmse"])
    assert found == pytest.approx([found[0]] * len(found), rel=1e-3)
