import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest
from riding import answer_of, make_onnx, our_metadata, pink, published_metadata

from policy_runtime.loop.commands import Command
from policy_runtime.loop.observing import FeedbackObservation, PaperObservation, ReleaseObservation
from policy_runtime.loop.policy import OnnxPolicy, action_for
from policy_runtime.loop.policy_file import find_policy, open_policy
from policy_runtime.robots import RobotState
from sim.skate.robot.g1 import default_pose, servos
from sysid.errors import QualityGateError, SysidError
from sysid.workspace import shipped_data

pytestmark = pytest.mark.train


@pytest.fixture
def runtime():
    return pytest.importorskip("onnxruntime", reason="policies need onnxruntime (extra 'run')")


def state_of(rng, time=0.0):
    quaternion = rng.normal(size=4)
    return RobotState(
        time=time,
        age=0.0,
        quaternion=quaternion / np.linalg.norm(quaternion),
        angular_velocity=rng.normal(size=3),
        joint_position=rng.normal(size=23),
        joint_velocity=rng.normal(size=23),
        joint_torque=np.zeros(23),
    )


def test_shipped_policies_are_found_by_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert find_policy("pink") == find_policy("pink.onnx") == shipped_data() / "policies" / "pink.onnx"
    assert find_policy("stand") is None
    (tmp_path / "pink.onnx").write_bytes(b"mine")
    assert find_policy("pink.onnx").read_bytes() == b"mine"


def gravity_in(quaternion):
    w, x, y, z = quaternion
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return rotation.T @ [0, 0, -1], np.arctan2(rotation[1, 0], rotation[0, 0])


def frames_by_hand(states, commands, actions, steps):
    """The parts of each frame, written out from the interface's description."""
    parts = []
    for state, command, action, step in zip(states, commands, actions, steps, strict=True):
        gravity, heading = gravity_in(state.quaternion)
        parts.append(
            {
                "command": [2.0 * command.speed, command.turn],
                "heading": [heading / np.pi],
                "gyro": 0.25 * state.angular_velocity,
                "gravity": gravity,
                "position": state.joint_position - default_pose(),
                "velocity": 0.05 * state.joint_velocity,
                "action": action,
                "phase": [(step % 300) / 300],
            }
        )
    return parts


@pytest.fixture
def ride():
    rng = np.random.default_rng(7)
    steps = [3, 4, 5, 6, 7, 308]
    states = [state_of(rng) for _ in steps]
    commands = [Command(*rng.uniform(0, 1, 2)) for _ in steps]
    actions = [rng.normal(size=23) for _ in steps]
    return states, commands, actions, steps


def test_ours_is_frame_by_frame_and_the_releases_term_by_term_with_heading_oldest_first(ride):
    ours, release = PaperObservation(), ReleaseObservation()
    for row in zip(*ride, strict=True):
        seen, theirs = ours.build(*row), release.build(*row)
    frames = frames_by_hand(*ride)[1:]
    expected = np.concatenate([np.concatenate([v for k, v in f.items() if k != "heading"]) for f in frames])
    np.testing.assert_allclose(seen, expected, atol=1e-9)
    by_term = np.concatenate([np.concatenate([f[key] for f in frames]) for key in frames[0]])
    np.testing.assert_allclose(theirs, by_term, atol=1e-9)


def test_feedback_takes_what_the_pelvis_has_yawed_off_the_turn():
    rng = np.random.default_rng(3)
    state = state_of(rng)

    def yawed(angle):
        return dataclasses.replace(state, quaternion=np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2)]))

    builder, action = FeedbackObservation(), np.zeros(23)
    seen = [
        builder.frame(yawed(angle), Command(1.0, turn), action, step)[1]
        for angle, turn, step in [(3.0, 0.5, 120), (3.2, 0.5, 121), (-3.0, -0.4, 150), (3.2, -0.4, 151)]
    ]
    # From 3.0 to 3.2 a turn of 0.5 has 0.3 left; at step 150 steering begins and the yaw counts anew,
    # across the jump at ±π: from -3.0 to 3.2 is -0.083.
    np.testing.assert_allclose(seen, [0.5, 0.3, -0.4, -0.4 + 2 * np.pi - 6.2], atol=1e-9)
    builder.reset()
    assert builder.frame(yawed(1.0), Command(1.0, 0.2), action, 7)[1] == pytest.approx(0.2)


@pytest.mark.parametrize("size", [390, 395])
def test_policy_of_either_interface_answers_as_computed_by_hand(tmp_path, runtime, ride, size):
    metadata = published_metadata() if size == 395 else our_metadata(pink())
    constants = make_onnx(tmp_path / "policy.onnx", size=size, metadata=metadata)
    policy = OnnxPolicy(open_policy(tmp_path / "policy.onnx", pink()))
    states, commands, _, steps = ride
    policy.reset(states[0])
    builder = ReleaseObservation() if size == 395 else FeedbackObservation()
    action = np.zeros(23) if size == 395 else action_for(states[0].joint_position)
    for state, command, step in zip(states, commands, steps, strict=True):
        target = policy.act(state, command, step)
        action = answer_of(constants, builder.build(state, command, action, step))
        np.testing.assert_allclose(policy.action, action, atol=1e-5)
        np.testing.assert_allclose(target, default_pose() + servos().action_scale * action, atol=1e-5)


def changed(key, index, value):
    metadata = our_metadata(pink())
    parts = metadata[key].split(",")
    parts[index] = value
    return metadata | {key: ",".join(parts)}


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        (lambda: {}, "made for another robot"),
        (lambda: changed("joint_names", 4, "left_toe_joint"), "made for another robot.*left_toe_joint"),
        (lambda: changed("joint_stiffness", 3, "120"), "joint stiffness of left_knee_joint is 120"),
        (lambda: changed("action_scale", 22, "0.25"), "action scale of right_elbow_joint is 0.25"),
        (lambda: changed("joint_stiffness", 3, "x"), "expected 23 numbers"),
        (lambda: our_metadata(pink()) | {"board": "black"}, "trained on board 'black', not on 'pink'"),
        (lambda: our_metadata(pink()) | {"board_stiffness": "34.8"}, "trained with board stiffness 34.8"),
    ],
)
def test_a_mismatch_refuses_in_words(tmp_path, runtime, metadata, message):
    make_onnx(tmp_path / "policy.onnx", size=390, metadata=metadata())
    with pytest.raises(SysidError, match=message):
        open_policy(tmp_path / "policy.onnx", pink())


def test_a_board_that_no_longer_passes_is_the_gate_and_force_overrides(tmp_path, runtime):
    passed = pink().checked({"passed": True})
    make_onnx(tmp_path / "policy.onnx", size=390, metadata=our_metadata(passed))
    open_policy(tmp_path / "policy.onnx", passed)
    failing = pink().checked({"passed": False})
    with pytest.raises(QualityGateError, match="has not as it is recorded now"):
        open_policy(tmp_path / "policy.onnx", failing)
    forced = open_policy(tmp_path / "policy.onnx", failing, force=True)
    assert any("forced" in note for note in forced.notes)


def test_a_refit_within_the_spread_of_training_is_noted_and_rides(tmp_path, runtime):
    metadata = our_metadata(pink()) | {"board_stiffness": f"{1.03 * pink().stiffness}"}
    make_onnx(tmp_path / "policy.onnx", size=390, metadata=metadata)
    notes = open_policy(tmp_path / "policy.onnx", pink()).notes
    assert any("board stiffness 15.12" in note and "14.68" in note for note in notes)


def test_wrong_files_are_refused_in_words(tmp_path, runtime):
    with pytest.raises(SysidError, match="no such policy"):
        open_policy(tmp_path / "none.onnx")
    (tmp_path / "text.onnx").write_text("hello")
    with pytest.raises(SysidError, match="not an ONNX model"):
        open_policy(tmp_path / "text.onnx")
    make_onnx(tmp_path / "small.onnx", size=48, metadata=published_metadata())
    with pytest.raises(SysidError, match=r"not a skating policy.*obs \[1, 48\].*expected one input of 390"):
        open_policy(tmp_path / "small.onnx")
    make_onnx(tmp_path / "twelve.onnx", size=390, metadata=published_metadata(), actions=12)
    with pytest.raises(SysidError, match="output of 23"):
        open_policy(tmp_path / "twelve.onnx")


def test_opening_a_policy_writes_nothing_anywhere(tmp_path):
    """onnxruntime would put a device's number and a database into the home folder, to send home."""
    home, code = (
        tmp_path / "home",
        "import sys; from pathlib import Path; from policy_runtime.loop import policy_file",
    )
    home.mkdir()
    subprocess.run(
        [
            sys.executable,
            "-c",
            f"{code}; policy_file.open_policy(Path(sys.argv[1]))",
            shipped_data() / "policies/pink.onnx",
        ],
        env={**os.environ, "HOME": str(home), "TMPDIR": str(home)},
        check=True,
    )
    assert not list(home.iterdir())
