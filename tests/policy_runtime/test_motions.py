import runpy

import mujoco
import numpy as np
import pytest

from policy_runtime.motion import motions
from policy_runtime.motion.motion_check import left_stance, motion_facts
from sim.skate.cycle.clock import CONTROL_PERIOD
from sysid.errors import SysidError
from sysid.workspace import shipped_data

pytestmark = pytest.mark.train

CLIPS = sorted(path.stem for path in (shipped_data() / "motions").glob("*.npy"))


@pytest.fixture(scope="module")
def facts(model):
    return {clip.name: motion_facts(clip, model) for clip in motions.load_motions()}


@pytest.mark.parametrize("name", CLIPS)
def test_a_clip_holds_its_contacts_and_a_robot_can_do_it(facts, name):
    fact = facts[name]
    assert fact.slide < 0.01  # m/s, against a board at 0.6 m/s and more
    assert fact.penetration < 1e-3
    assert fact.bobbing < 1e-3  # the right foot stays on the level deck
    assert fact.right_foot_tilt < 2e-3
    assert 0.3 < fact.stance < 0.55
    assert fact.self_contacts == 0
    assert fact.limit_margin > 0.015
    assert fact.peak_speed < 12.0  # the knee motor turns at up to 20 rad/s
    assert 0.8 <= fact.period <= 1.0
    assert fact.support_margin > 0.0  # balanced over the right sole while the left foot swings


@pytest.mark.parametrize("name", CLIPS)
def test_a_clip_repeats_without_a_seam_and_the_right_foot_moves_with_the_board(model, name):
    clip = motions.load_motion(shipped_data() / "motions" / f"{name}.npy")
    steps = np.abs(np.diff(np.vstack([clip.joints, clip.joints[:1]]), axis=0))
    assert steps[-1].max() <= steps[:-1].max()
    data = mujoco.MjData(model)
    feet = []
    for qpos in clip.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        feet.append(data.body("right_ankle_roll_link").xpos.copy())
    speed = np.diff(np.array(feet), axis=0) / CONTROL_PERIOD
    assert np.all(speed[:, 0] > 0)
    assert np.ptp(speed[:, 0]) < 0.2 * speed[:, 0].mean()  # pushed and coasting, never jerked
    assert np.abs(speed[:, 1:]).max() < 0.02


def test_file_is_what_the_script_makes(model):
    folder = shipped_data() / "motions"
    script = runpy.run_path(str(folder / "make_motions.py"))
    style = script["STYLES"][0]
    made = script["make"](style)
    stored = motions.load_motion(folder / f"push-{style.name}.npy")
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
    motions.save_motion(clip, tmp_path / "again.npy")
    table = np.load(tmp_path / "again.npy")
    np.testing.assert_array_equal(table[:, [26, 27, 28, 33, 34, 35]], 0.0)
    np.testing.assert_allclose(motions.load_motion(tmp_path / "again.npy").qpos, clip.qpos, atol=1e-15)


def bad(change):
    table = good_table()
    change(table)
    return table


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (good_table()[:, :30], r"shape \(10, 30\); expected .*\(frames, 36\)"),
        (good_table(3), "has 3 frames"),
        (bad(lambda t: t.__setitem__((4, 9), np.nan)), "frame 4, column 9 is nan"),
        (bad(lambda t: t.__setitem__((slice(None), 3), 0.0)), "quaternion of frame 0 .* length 0"),
        (np.zeros((10, 36), dtype=int), "expected floats"),
    ],
)
def test_wrong_content_is_refused_in_words(tmp_path, content, message):
    path = tmp_path / "clip.npy"
    np.save(path, content)
    with pytest.raises(SysidError, match=message):
        motions.load_motion(path)


def test_files_that_are_not_arrays_are_refused_in_words(tmp_path):
    (tmp_path / "clip.npy").write_bytes(b"hello")
    with pytest.raises(SysidError, match="not a NumPy array file"):
        motions.load_motion(tmp_path / "clip.npy")
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


def test_sliding_foot_is_measured(model):
    clip = motions.load_motion(shipped_data() / "motions" / "push-low-slow.npy")
    position = clip.position.copy()
    position[:, 0] *= 1.1  # ten per cent too fast for its steps
    faster = motions.Motion(name="x", position=position, quaternion=clip.quaternion, joints=clip.joints)
    assert motion_facts(faster, model).slide > 0.05


def recorded(name, pushes=3, noise=0.0, wander=0.0, seed=0):
    """Return a clip of several pushes as a recording has it: shaken from frame to frame, wandering slowly [m]."""
    clip = motions.load_motion(shipped_data() / "motions" / f"{name}.npy")
    rng = np.random.default_rng(seed)
    step = clip.position[-1] - clip.position[0] + (clip.position[-1] - clip.position[-2])
    step[1:] = 0
    position = np.concatenate([clip.position + n * step for n in range(pushes)])
    time = CONTROL_PERIOD * np.arange(len(position))
    for frequency in (0.3, 0.7, 1.3):
        position[:, 2] += wander * np.sin(2 * np.pi * frequency * time + rng.uniform(0, 6)) * np.sqrt(2 / 3)
    return motions.Motion(
        name=name,
        position=position + rng.normal(0, noise, position.shape) if noise else position,
        quaternion=np.tile(clip.quaternion, (pushes, 1)),
        joints=np.tile(clip.joints, (pushes, 1)),
    )


@pytest.mark.parametrize("name", CLIPS)
@pytest.mark.parametrize(("noise", "wander"), [(0.005, 0.0), (0.0, 0.005), (0.004, 0.004)])
def test_a_foot_with_five_millimetres_of_noise_is_planted(model, name, noise, wander):
    truth = left_stance(recorded(name), model)
    found = left_stance(recorded(name, noise=noise, wander=wander), model)
    assert np.mean(found.planted == truth.planted) > 0.9
    assert abs(found.planted.mean() - truth.planted.mean()) < 0.1


def test_recorded_pushes_are_cut_from_touchdown_to_touchdown(model, tmp_path):
    from policy_runtime.train import push_clips

    clip = recorded("push-low-slow", noise=0.003)
    cut = motions.Motion(
        name="mine", position=clip.position[30:], quaternion=clip.quaternion[30:], joints=clip.joints[30:]
    )
    motions.save_motion(cut, tmp_path / "mine.npy")
    ((_, mine),) = push_clips([tmp_path])
    period = motion_facts(clip, model).period / CONTROL_PERIOD
    assert len(mine) / period == pytest.approx(round(len(mine) / period), abs=0.15)
    assert 0 < len(mine) < len(cut.joints)
    still = motions.Motion(
        name="still",
        position=cut.position[:1].repeat(20, 0),
        quaternion=cut.quaternion[:20],
        joints=cut.joints[:1].repeat(20, 0),
    )
    motions.save_motion(still, tmp_path / "still.npy")
    with pytest.raises(SysidError, match=r"still: its left foot comes down 0 times"):
        push_clips([tmp_path / "still.npy"])


def test_a_runs_own_motions_are_kept_with_it_and_make_its_style(tmp_path):
    from policy_runtime.learning.run_folder import RunConfig, RunFolder
    from policy_runtime.motion.motions import style_reference
    from sim.skate.options import SkateOptions

    mine = recorded("push-low-slow")
    (tmp_path / "mocap").mkdir()
    motions.save_motion(mine, tmp_path / "mocap" / "mine.npy")
    folder, plain = RunFolder(tmp_path / "run"), RunFolder(tmp_path / "plain")
    record = shipped_data() / "boards" / "pink.toml"
    folder.begin(RunConfig(), record, motions=[tmp_path / "mocap"])
    plain.begin(RunConfig(), record)
    assert [path.stem for path in folder.motions()] == ["mine"]
    assert [path.stem for path in plain.motions()] == CLIPS
    assert "mine.npy" in folder.origin.read_text()
    windows = style_reference(SkateOptions(), motions.load_motions(folder.motions()))
    assert windows.shape == (len(mine.joints) - 4, 115)
    np.testing.assert_array_equal(windows[3], mine.joints[3:8].ravel())
    with pytest.raises(SysidError, match="no motion"):
        RunFolder(tmp_path / "third").begin(RunConfig(), record, motions=[tmp_path])
    folder.discard()
    assert not folder.path.exists()
