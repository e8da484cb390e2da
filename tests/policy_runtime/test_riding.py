"""Worlds, scripts, evaluation, export, and the commands around them."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from command_line import called
from riding import HoldStill, make_onnx, our_metadata, pink, published_metadata

from policy_runtime.evaluation.plain import Protocol, evaluate_policy, riders, run_episode
from policy_runtime.evaluation.recording import Recorder
from policy_runtime.export import export_folder, load_folder
from policy_runtime.loop.commands import Command, constant
from policy_runtime.loop.gravity_load import GravityLoad, shares
from policy_runtime.loop.scripted import scripted, scripted_push, standing
from policy_runtime.loop.world import joint_limits, make_world
from policy_runtime.robots.simulated import Gantry
from policy_runtime.runtime import Runtime
from sim.skate.robot.g1 import SOLE_CENTRE
from sim.skate.robot.poses import load_poses
from sysid.board import save_board
from sysid.errors import SysidError
from sysid.progress import listening

pytestmark = pytest.mark.train

for module in ("mjlab", "onnxruntime"):
    pytest.importorskip(module, reason="rides need the robot and policies (extras 'train' and 'run')")


def ride(world, policy, duration):
    recorder = Recorder(world.robot)
    limits = joint_limits(world.robot.model)
    result = Runtime(
        robot=world.robot,
        policy=policy,
        commands=constant(Command(0.8, 0.0)),
        limits=limits,
        on_tick=recorder.add,
        stop_time=0.0,
    ).run(duration)
    return result, recorder.recording()


@pytest.fixture(scope="module")
def held_ride():
    """The steering pose on the rolling board, held upright by a gantry, 5 s."""
    world = make_world(pink(), start="steer", gantry=Gantry())
    world.reset(speed=1.0)
    return world, *ride(world, standing(), 5.0)


def test_feet_stay_on_the_deck_and_wheels_on_the_ground(held_ride):
    _, result, recording = held_ride
    assert result.stopped is None
    settled = recording.column("time") > 0.2
    assert recording.column("foot_on_deck")[settled].all()
    assert not recording.column("foot_on_ground")[settled].any()
    assert recording.column("wheel_on_ground")[settled].all()
    assert recording.column("other_contacts").max() == 0


def test_without_a_gantry_no_script_stays_up_and_the_guard_says_why():
    world = make_world(pink())
    world.reset()
    result, _ = ride(world, scripted("zero"), 5.0)
    assert result.stopped.startswith(("tilt", "joint limit"))


def test_pushing_script_pushes():
    world = make_world(pink(), start="push", gantry=Gantry())
    world.reset()
    result, recording = ride(world, scripted_push(), 2.4)
    assert result.stopped is None
    assert recording.column("board_speed").max() > 0.2  # from rest
    down = np.flatnonzero(recording.column("foot_on_ground")[:, 0])
    pushes = 1 + np.sum(np.diff(down) > 10)  # bounces of less than 0.2 s belong to one
    assert pushes == 3
    assert recording.column("foot_on_deck")[:, 1].mean() > 0.95


def test_unknown_script_is_refused_in_words():
    with pytest.raises(SysidError, match=r"unknown script 'pusch'.*Did you mean 'push'"):
        scripted("pusch")


def test_two_feet_share_the_weight_under_the_centre_of_mass():
    load = GravityLoad()
    pose = load_poses()["steer"]
    torque = load.torques(pose, (True, True))
    model, data = load.model, load.data
    forces = shares(
        [10, 11], [np.array([-0.2, 0.0, 0.0]), np.array([0.2, 0.05, 0.0])], np.array([0.1, 0.03, 0.7])
    )
    assert sum(share for *_, share in forces) == pytest.approx(1.0)
    np.testing.assert_allclose(sum(share * point for _, point, share in forces)[:2], [0.1, 0.03])
    # Weight and soles' forces leave nothing over that would move the pelvis.
    mujoco.mj_inverse(model, data)
    feet = [model.body(f"{side}_ankle_roll_link").id for side in ("left", "right")]
    soles = [data.xpos[foot] + data.xmat[foot].reshape(3, 3) @ SOLE_CENTRE for foot in feet]
    total = data.qfrc_bias.copy()
    jacobian = np.zeros((3, model.nv))
    for foot, point, share in shares(feet, soles, data.subtree_com[1]):
        mujoco.mj_jac(model, data, jacobian, None, point, foot)
        total -= jacobian[2] * share * model.body_subtreemass[1] * 9.81
    np.testing.assert_allclose(total[:6], 0.0, atol=1e-6)
    np.testing.assert_allclose(total[6:], torque, atol=1e-6)


def test_direct_coupling_sets_the_trucks():
    world = make_world(pink(), coupling="direct")
    world.reset()
    _, recording = ride(world, HoldStill(), 0.5)
    roll, trucks = recording.column("roll"), recording.column("trucks")
    expected = np.arctan(np.tan(pink().geometry["rake"].value) * np.sin(roll))
    np.testing.assert_allclose(trucks, np.column_stack([expected, expected]), atol=1e-6)


def test_episode_ends_when_the_robot_falls_and_is_repeatable():
    world = make_world(pink())
    first, ending = run_episode(world, scripted("zero"), Protocol(), np.random.default_rng([1, 2]))
    assert ending in ("fallen", "body contact", "off the board")
    assert first.column("time")[-1] < 5
    again, _ = run_episode(world, scripted("zero"), Protocol(), np.random.default_rng([1, 2]))
    np.testing.assert_array_equal(first.column("qpos"), again.column("qpos"))
    other, _ = run_episode(world, scripted("zero"), Protocol(), np.random.default_rng([1, 3]))
    assert first.column("command")[0, 0] != other.column("command")[0, 0]


def test_turns_are_drawn_anew_in_every_cycle():
    world = make_world(pink(), start="steer", gantry=Gantry())
    protocol = Protocol(duration=13.0, speed=(0.5, 0.5))
    recording, ending = run_episode(world, standing(), protocol, np.random.default_rng(5))
    assert ending == "time limit"
    turns = recording.column("command")[:, 1]
    assert len(np.unique(turns)) == 3  # none until steering begins, then one from each phase on
    assert np.all(np.abs(turns) <= np.pi / 4)
    changes = np.flatnonzero(np.diff(turns)) + 1
    assert (recording.column("step")[changes] % 300 == 150).all()
    begins = np.flatnonzero(recording.column("step") % 300 == 150)
    expected = recording.column("board_heading")[begins] + turns[begins]
    np.testing.assert_allclose(recording.column("target_heading")[begins], expected)


@pytest.mark.slow
def test_evaluation_is_the_same_whatever_the_workers():
    one = evaluate_policy("zero", pink(), episodes=3, seeds=(0, 1))
    with riders(2) as pool:
        two = evaluate_policy("zero", pink(), episodes=3, seeds=(0, 1), pool=pool)
    assert one.endings == two.endings
    assert one.duration.value == pytest.approx(two.duration.value)
    for name, quantity in one.errors.items():
        assert quantity.value == pytest.approx(two.errors[name].value, nan_ok=True), name
        assert quantity.ci95 == pytest.approx(two.errors[name].ci95, nan_ok=True), name
    assert one.success.value == 0
    assert sum(one.endings.values()) == 6
    assert one.errors["E_vel"].value > 0


# Export


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    where = tmp_path_factory.mktemp("export")
    make_onnx(where / "policy.onnx", size=395, metadata=published_metadata())
    export_folder(pink(), where / "out", policy=where / "policy.onnx")
    return where / "out"


def test_exported_scene_moves_as_the_original(folder):
    bundle = load_folder(folder)
    original = make_world(pink())
    exported = bundle.world()
    original.reset()
    exported.reset()
    np.testing.assert_allclose(exported.start, original.start, atol=1e-9)
    ride(original, HoldStill(), 0.4)
    ride(exported, HoldStill(), 0.4)
    np.testing.assert_allclose(exported.robot.data.qpos, original.robot.data.qpos, atol=1e-4)
    assert exported.robot.model.nmesh == 35


@pytest.mark.slow
def test_exported_folder_runs_without_mjlab(folder, monkeypatch, capsys, tmp_path):
    from sim.skate.robot import g1

    monkeypatch.setattr(g1, "find_spec", lambda name: None)
    with pytest.raises(SysidError, match="mjlab"):
        make_world(pink())
    assert called("play", folder, "--duration", "0.2", "-o", tmp_path) == 0
    assert "policy rode pink for 0.20 s" in capsys.readouterr().out
    assert (tmp_path / "ride-policy.rrd").stat().st_size > 100_000


def test_changed_or_missing_files_are_noticed(folder, tmp_path):
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (copy / "pink.toml").write_text((copy / "pink.toml").read_text() + "# changed\n")
    with pytest.raises(SysidError, match=r"pink\.toml: missing, or changed"):
        load_folder(copy)
    (copy / "pink.toml").unlink()
    with pytest.raises(SysidError, match=r"pink\.toml: missing, or changed"):
        load_folder(copy)
    (copy / "folder.json").write_text("{}")
    with pytest.raises(SysidError, match="not a folder that this version exports"):
        load_folder(copy)


def test_export_keeps_its_hands_off_other_folders(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(SysidError, match="not empty, and not an exported folder"):
        export_folder(pink(), tmp_path)
    assert (tmp_path / "thesis.txt").read_text() == "years of work"


# Commands


def call(capsys, *arguments):
    return called(*arguments), capsys.readouterr()


@pytest.mark.slow
def test_play_writes_picture_and_recording(capsys, tmp_path, monkeypatch):
    told = {}
    monkeypatch.setattr("sysid.cli.play.working", lambda _: listening(told.setdefault))
    code, said = call(
        capsys, "play", "stand", "--board", "pink", "--start", "steer", "--gantry",
        "--duration", 1, "-o", tmp_path, "--json", "-",
    )  # fmt: skip
    assert code == 0
    result = json.loads(said.out)
    assert result["stopped"] is None
    assert result["duration_s"] == pytest.approx(1.0)
    for kind in ("picture", "numbers", "recording"):
        assert (tmp_path / result["files"][kind].split("/")[-1]).stat().st_size > 10_000
    assert told == {"riding": 0.0, "drawing the ride": 0.3}


def test_run_ends_with_one_when_the_robot_was_stopped(capsys, tmp_path):
    code, said = call(capsys, "run", "zero", "--board", "pink", "--duration", 4, "-o", tmp_path)
    assert code == 1
    assert "ended: tilt" in said.out or "ended: joint limit" in said.out
    log = json.loads((tmp_path / "run-zero.json").read_text())
    assert log["events"][-1]["kind"] == "stop"
    assert log["timing"]["decide"]["p99_ms"] > 0


def test_rehearsal_drives_the_simulated_robot_over_the_network(capsys, tmp_path):
    pytest.importorskip("cyclonedds", reason="the robot's interface needs cyclonedds (extra 'robot')")
    code, said = call(
        capsys, "run", "stand", "-b", "pink", "--start", "stand", "--robot", "rehearsal",
        "--domain", 79, "--duration", 0.5, "--ramp", 0.2, "--link-timeout", 10, "-o", tmp_path, "--json", "-",
    )  # fmt: skip
    result = json.loads(said.out)
    assert result["ticks"] > 0
    assert result["delay"]["median_ms"] > 0
    assert code == (0 if result["stopped"] is None else 1)  # a crowded computer may be too slow to rehearse


def test_the_real_robot_takes_only_boards_that_passed(capsys, tmp_path):
    save_board(replace(pink(), last_check={}), tmp_path / "data" / "boards" / "pink.toml")
    with pytest.raises(SysidError, match="has not passed `check`") as caught:
        call(
            capsys, "run", "zero", "-b", "pink", "--robot", "unitree", "--workspace", tmp_path, "-o", tmp_path
        )
    assert caught.value.exit_code == 3


def test_evaluate_prints_a_table_and_writes_json(capsys, tmp_path):
    code, said = call(
        capsys, "evaluate", "zero", "-b", "pink", "--episodes", 2, "--seeds", 1, "--workers", 1,
        "-o", tmp_path, "--json", tmp_path / "e.json",
    )  # fmt: skip
    assert code == 0
    assert "E_succ" in said.out
    assert "0.000 [0.000, 0.658]" in said.out  # Wilson's of 0 in 2; no ± would say it
    result = json.loads((tmp_path / "e.json").read_text())
    assert result["E_succ"]["value"] == 0
    assert result["E_yaw"]["value"] is None
    assert (tmp_path / "evaluate-zero-mujoco.png").stat().st_size > 10_000


def test_motions_lists_plots_and_plays(capsys, tmp_path):
    code, said = call(
        capsys, "motions", "push-low-slow", "--plot", tmp_path / "m.png", "--rerun", tmp_path / "m.rrd",
        "--json", tmp_path / "m.json",
    )  # fmt: skip
    assert code == 0
    assert "push-low-slow" in said.out
    listed = json.loads((tmp_path / "m.json").read_text())["motions"]
    assert [entry["name"] for entry in listed] == ["push-low-slow"]
    assert (tmp_path / "m.png").stat().st_size > 10_000
    assert (tmp_path / "m.rrd").stat().st_size > 100_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("play", "zero"), "zero: not an exported folder.* --board"),
        (("play", "zero", "-b", "pinck"), "Did you mean 'pink'"),
        (("run", "zero", "-b", "pink", "--dry-run", "--robot", "rehearsal"), "was not trained on anything"),
        (("play", "zero", "-b", "pink", "--speed", "9"), "--speed 9: policies are trained for 0 to 1.5"),
        (("play", "zero", "-b", "pink", "--commands", "none.csv"), "none.csv: cannot be read"),
        (("evaluate", "zero", "-b", "pink", "--board-scale", "k:4"), "expected --board-scale NAME=VALUE"),
    ],
)
def test_wrong_use_is_refused_in_words(capsys, arguments, message):
    with pytest.raises(SysidError, match=message):
        call(capsys, *arguments)


def test_a_policy_for_another_board_is_refused(capsys, tmp_path):
    make_onnx(tmp_path / "p.onnx", size=390, metadata=our_metadata(pink()))
    with pytest.raises(SysidError, match="trained on board 'pink', not on 'black'"):
        call(capsys, "play", tmp_path / "p.onnx", "-b", "black")


# The same protocol in the training's simulator


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # the training stack's own
def test_parallel_evaluation_agrees_with_the_plain_one_on_what_falls():
    from policy_runtime.evaluation.parallel import evaluate_in_parallel

    protocol = Protocol(duration=2.0, speed=(0.5, 0.5))
    parallel = evaluate_in_parallel("zero", pink(), episodes=8, seeds=(0,), protocol=protocol, device="cpu")
    plain = evaluate_policy("zero", pink(), episodes=8, seeds=(0,), protocol=protocol)
    assert parallel.success.value == plain.success.value == 0
    assert sum(parallel.endings.values()) == 8
    assert parallel.duration.value == pytest.approx(plain.duration.value, rel=0.15)
    assert parallel.errors["E_vel"].value == pytest.approx(plain.errors["E_vel"].value, rel=0.3)
    assert parallel.errors["E_smth"].value == pytest.approx(plain.errors["E_smth"].value, rel=0.3)


def test_parallel_evaluation_answers_many_observations_as_one_by_one(tmp_path):
    from policy_runtime.evaluation.parallel import BatchPolicy
    from policy_runtime.loop.policy_file import open_policy

    make_onnx(tmp_path / "p.onnx", size=390, metadata=our_metadata(pink()))
    observations = np.random.default_rng(0).normal(size=(7, 390)).astype(np.float32)
    together = BatchPolicy(str(tmp_path / "p.onnx"), pink()).act(observations)
    session = open_policy(tmp_path / "p.onnx").session
    apart = [session.run(["actions"], {"obs": row[None]})[0][0] for row in observations]
    np.testing.assert_allclose(together, apart, atol=1e-6)
    make_onnx(tmp_path / "release.onnx", size=395, metadata=published_metadata())
    with pytest.raises(SysidError, match=r"takes 395 numbers, the task gives 390"):
        BatchPolicy(str(tmp_path / "release.onnx"), pink())


def test_ending_a_run_from_outside_brakes_and_is_logged(tmp_path):
    import signal
    import subprocess
    import sys
    import time

    command = [
        *(sys.executable, "-m", "sysid.cli", "run", "stand", "-b", "pink", "--start", "steer", "--gantry"),
        *("--duration", "60", "-o", str(tmp_path)),
    ]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    for line in process.stderr:
        if "start: policy" in line:
            break
    time.sleep(0.3)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert process.returncode == 1
    assert json.loads((tmp_path / "run-stand.json").read_text())["stopped"] == "interrupted"
