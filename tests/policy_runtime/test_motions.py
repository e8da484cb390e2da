import importlib.util

import mujoco
import numpy as np
import pytest

from policy_runtime.motion import motions
from policy_runtime.motion.motion_check import motion_facts
from sim.skate.robot import g1
from sysid.errors import SysidError
from sysid.workspace import shipped_data

pytestmark = pytest.mark.train

CLIPS = sorted(path.stem for path in (shipped_data() / "motions").glob("*.npy"))
CLIPS_OF_TRANSITIONS = shipped_data() / "motions" / "transitions"
RELEASE = {  # ranges over the two clips of the HUSKY release [rad]
    "left_hip_pitch": (-0.89, 0.29),
    "left_knee": (0.00, 1.19),
    "left_ankle_pitch": (-0.74, 0.56),
    "right_hip_pitch": (-1.36, -0.73),
    "right_knee": (0.71, 1.55),
    "right_ankle_pitch": (-0.55, 0.15),
    "waist_yaw": (-0.32, 0.08),
    "waist_pitch": (0.12, 0.39),
    "left_shoulder_pitch": (-0.66, 0.39),
    "left_shoulder_roll": (0.30, 1.06),
    "left_elbow": (-0.19, 1.14),
    "right_shoulder_roll": (-0.69, -0.23),
    "right_elbow": (0.20, 1.20),
}


@pytest.fixture(scope="module")
def facts(model):
    return {clip.name: motion_facts(clip, model) for clip in motions.load_motions()}


def test_there_are_two_speeds_in_two_styles(facts):
    assert len(facts) >= 4
    for style in ("upright", "low"):
        assert facts[f"push-{style}-fast"].speed > facts[f"push-{style}-slow"].speed + 0.3


@pytest.mark.parametrize("name", CLIPS)
def test_contacts_hold(facts, name):
    fact = facts[name]
    assert fact.slide < 0.01  # m/s, against a board at 0.6 m/s and more
    assert fact.penetration < 1e-3
    assert fact.bobbing < 1e-3  # the right foot stays on the level deck
    assert fact.right_foot_tilt < 2e-3
    assert 0.3 < fact.stance < 0.55
    assert fact.self_contacts == 0


@pytest.mark.parametrize("name", CLIPS)
def test_robot_can_do_it(facts, name):
    fact = facts[name]
    assert fact.limit_margin > 0.015
    assert fact.peak_speed < 12.0  # the knee motor turns at up to 20 rad/s
    assert 0.8 <= fact.period <= 1.0
    assert fact.support_margin > 0.0  # balanced over the right sole while the left foot swings


@pytest.mark.parametrize("name", CLIPS)
def test_ranges_lie_in_the_neighbourhood_of_human_pushing(facts, name):
    fact = facts[name]
    for joint, (low, high) in RELEASE.items():
        i = g1.JOINTS.index(f"{joint}_joint")
        assert fact.joint_low[i] > low - 0.3, joint
        assert fact.joint_high[i] < high + 0.3, joint


@pytest.mark.parametrize("name", CLIPS)
def test_clip_repeats_without_a_seam(name):
    clip = motions.load_motion(shipped_data() / "motions" / f"{name}.npy")
    steps = np.abs(np.diff(np.vstack([clip.joints, clip.joints[:1]]), axis=0))
    assert steps[-1].max() <= steps[:-1].max()


@pytest.mark.parametrize("name", CLIPS)
def test_board_and_right_foot_move_together_at_constant_height(model, name):
    clip = motions.load_motion(shipped_data() / "motions" / f"{name}.npy")
    data = mujoco.MjData(model)
    feet = []
    for qpos in clip.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        feet.append(data.body("right_ankle_roll_link").xpos.copy())
    speed = np.diff(np.array(feet), axis=0) * clip.rate
    assert np.all(speed[:, 0] > 0)
    assert np.ptp(speed[:, 0]) < 0.2 * speed[:, 0].mean()  # pushed and coasting, never jerked
    assert np.abs(speed[:, 1:]).max() < 0.02


def test_file_is_what_the_script_makes(model):
    path = shipped_data() / "motions" / "make_motions.py"
    spec = importlib.util.spec_from_file_location("make_motions", path)
    make_motions = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_motions)
    style = make_motions.STYLES[0]
    made = make_motions.make(style)
    stored = motions.load_motion(path.with_name(f"push-{style.name}.npy"))
    np.testing.assert_allclose(made.joints, stored.joints, atol=2e-3)


def good_table(frames=10):
    table = np.zeros((frames, 36))
    table[:, 3] = 1.0
    table[:, 7:] = np.arange(29)
    return table


def test_columns_of_the_release_layout_leave_out_the_wrists(tmp_path):
    path = tmp_path / "clip.npy"
    np.save(path, good_table())
    clip = motions.load_motion(path)
    assert clip.joints.shape == (10, 23)
    np.testing.assert_array_equal(clip.joints[0], [*range(19), *range(22, 26)])
    table = clip.table()
    assert table.shape == (10, 36)
    np.testing.assert_array_equal(table[:, [26, 27, 28, 33, 34, 35]], 0.0)


def test_round_trip(tmp_path):
    clip = motions.load_motions()[0]
    motions.save_motion(clip, tmp_path / "again.npy")
    again = motions.load_motion(tmp_path / "again.npy")
    np.testing.assert_allclose(again.qpos, clip.qpos, atol=1e-15)


def bad(change):
    table = good_table()
    change(table)
    return table


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (good_table()[:, :30], r"shape \(10, 30\); expected \(frames, 36\)"),
        (good_table(3), "has 3 frames"),
        (bad(lambda t: t.__setitem__((4, 9), np.nan)), "frame 4, column 9 is nan"),
        (bad(lambda t: t.__setitem__((4, 9), np.inf)), "frame 4, column 9 is inf"),
        (bad(lambda t: t.__setitem__((slice(None), 3), 0.0)), "quaternion of frame 0 .* length 0"),
        (np.zeros((2, 3, 4)), r"float64 of shape \(2, 3, 4\)"),
        (np.zeros((10, 36), dtype=int), "int64"),
    ],
)
def test_wrong_content_is_refused_in_words(tmp_path, content, message):
    path = tmp_path / "clip.npy"
    np.save(path, content)
    with pytest.raises(SysidError, match=message):
        motions.load_motion(path)


def test_files_that_are_not_arrays_are_refused_in_words(tmp_path):
    text = tmp_path / "text.npy"
    text.write_text("hello")
    with pytest.raises(SysidError, match="not a NumPy array file"):
        motions.load_motion(text)
    empty = tmp_path / "empty.npy"
    empty.touch()
    with pytest.raises(SysidError, match="not a NumPy array file"):
        motions.load_motion(empty)
    pickled = tmp_path / "object.npy"
    np.save(pickled, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(SysidError, match="not a NumPy array file"):
        motions.load_motion(pickled)
    with pytest.raises(SysidError, match="cannot be read"):
        motions.load_motion(tmp_path / "missing.npy")


def test_motions_are_found_by_name_file_and_folder(tmp_path):
    named = motions.motion_paths([motions.Path("push-low-slow")])
    assert named == [shipped_data() / "motions" / "push-low-slow.npy"]
    np.save(tmp_path / "mine.npy", good_table())
    assert motions.motion_paths([tmp_path]) == [tmp_path / "mine.npy"]
    with pytest.raises(SysidError, match=r"push-low-slo.*Did you mean 'push-low-slow'"):
        motions.motion_paths([motions.Path("push-low-slo")])
    (tmp_path / "empty").mkdir()
    with pytest.raises(SysidError, match="no motion"):
        motions.motion_paths([tmp_path / "empty"])


def test_windows_are_successive_frames():
    clip = motions.load_motions()[0]
    seen = motions.windows(clip)
    assert seen.shape == (len(clip.joints) - 4, 5, 23)
    np.testing.assert_array_equal(seen[7], clip.joints[7:12])


def test_sliding_foot_is_measured(model):
    clip = motions.load_motion(shipped_data() / "motions" / "push-low-slow.npy")
    position = clip.position.copy()
    position[:, 0] *= 1.1  # ten per cent too fast for its steps
    faster = motions.Motion(name="x", position=position, quaternion=clip.quaternion, joints=clip.joints)
    assert motion_facts(faster, model).slide > 0.05


def test_facts_of_a_motionless_clip(model):
    table = np.zeros((60, 36))
    table[:, 2], table[:, 3] = 0.78, 1.0
    still = motions.motion_from_table(table, "still", "still")
    fact = motion_facts(still, model)
    assert np.isnan(fact.period)
    assert fact.peak_speed == 0
    assert fact.stance == 1.0


def test_the_list_says_where_the_clips_of_transitions_are(model, tmp_path, capsys):
    from sysid.cli.console import Common
    from sysid.cli.motions import motions as command

    assert command(common=Common(workspace=tmp_path)) == 0
    assert (
        f"8 clips of mounting and dismounting: husky-sysid motions {CLIPS_OF_TRANSITIONS}"
        in capsys.readouterr().err
    )
    assert command(CLIPS_OF_TRANSITIONS, common=Common(workspace=tmp_path)) == 0
    shown = capsys.readouterr()
    assert "mount-plain" in shown.out
    assert "husky-sysid motions" not in shown.err
