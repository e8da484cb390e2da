import runpy

import inverse_kinematics as ik
import mujoco
import numpy as np
import pytest

from sim.skate.cycle.clock import Clock
from sim.skate.robot import g1
from sim.skate.robot.poses import CLIP_JOINTS, load_poses
from sim.skate.world.cycle import load_cycle
from sysid.workspace import shipped_data

pytestmark = pytest.mark.train

DECK_TOP, GROUND = 0.01, -0.10  # of both shipped boards, below and above the tilt axis [m]


def placed(model, name):
    data = mujoco.MjData(model)
    data.qpos[:] = load_poses()[name]
    mujoco.mj_forward(model, data)
    return data


def sole(model, data, side):
    """Return the lowest and highest point of the sole and its mean position in the plane."""
    geoms = [i for i in range(model.ngeom) if f"{side}_foot" in model.geom(i).name]
    ends = []
    for i in geoms:
        axis = data.geom_xmat[i].reshape(3, 3)[:, 2] * model.geom_size[i, 1]
        ends += [data.geom_xpos[i] + axis, data.geom_xpos[i] - axis]
    heights = np.array(ends)[:, 2] - model.geom_size[geoms[0], 0]
    return heights.min(), heights.max(), np.array(ends)[:, :2]


def test_the_cycle_holds_the_poses_and_goes_from_one_to_the_other_as_the_clips_do():
    clock, poses = Clock(), load_poses()
    cycle = load_cycle(clock)
    assert cycle.shape == (300, 30)
    for name, ends in (("push", (0, 119)), ("steer", (150, 284))):
        for step in (*ends, ends[0] - 1):  # what comes before leads there
            np.testing.assert_allclose(cycle[step], poses[name], atol=1e-3)
    for name, first, steps in (("mount", 120, 30), ("dismount", 285, 15)):
        clip = np.load(shipped_data() / "motions" / "transitions" / f"{name}-plain.npy")[1:]
        assert len(clip) == steps
        there = cycle[first : first + steps]
        np.testing.assert_allclose(there[:, :3], clip[:, :3] - [0.0, 0.0, 0.1], atol=1e-3)
        np.testing.assert_allclose(there[:, 3:], np.hstack((clip[:, 3:7], clip[:, CLIP_JOINTS])), atol=1e-9)
    quick = load_cycle(Clock(mount=10))
    assert len(quick) == 280
    np.testing.assert_allclose(quick[120:130], cycle[122:150:3])


def test_wherever_the_cycle_has_the_robot_feet_only_touch_the_deck_and_joints_are_in_range(model):
    data = mujoco.MjData(model)
    low, high = model.jnt_range[1:].T
    for step, qpos in enumerate(load_cycle(Clock())):
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        assert data.ncon == 0, step
        assert np.all((low < qpos[7:]) & (qpos[7:] < high)), step
        right, left = (sole(model, data, side)[:2] for side in ("right", "left"))
        np.testing.assert_allclose(right, DECK_TOP, atol=1e-3)
        lowest = DECK_TOP if 130 <= step < 293 else GROUND  # from over the deck to beside it
        assert left[0] > lowest - 2e-3, step


def test_push_has_the_right_foot_on_the_front_marker_and_the_left_above_the_ground(model):
    data = placed(model, "push")
    low, high, points = sole(model, data, "right")
    np.testing.assert_allclose([low, high], DECK_TOP, atol=5e-4)
    assert points[:, 0].min() < 0.2 < points[:, 0].max()  # the marker lies under the sole
    assert np.all(np.abs(points[:, 1]) < 0.1)  # on the deck
    low, high, points = sole(model, data, "left")
    np.testing.assert_allclose([low, high], GROUND + 0.02, atol=5e-4)
    assert points[:, 1].min() > 0.1 + 0.05  # beside the deck
    for foot in g1.FOOT_BODIES:
        assert data.body(foot).xmat.reshape(3, 3)[0, 0] > 0.999  # facing forward


def test_steer_stands_side_on_over_both_markers_and_balances_over_the_axis(model):
    data = placed(model, "steer")
    for side, x in (("left", -0.2), ("right", 0.2)):
        low, high, points = sole(model, data, side)
        np.testing.assert_allclose([low, high], DECK_TOP, atol=5e-4)
        assert data.body(f"{side}_ankle_roll_link").xpos[0] == pytest.approx(x, abs=1e-3)
        assert np.all(np.abs(points[:, 1]) < 0.1)
    np.testing.assert_allclose(data.subtree_com[1, :2], 0.0, atol=1e-3)
    facing = data.body("pelvis").xmat.reshape(3, 3)[:, 0]
    assert np.degrees(np.arctan2(facing[1], facing[0])) == pytest.approx(80, abs=2)


def test_the_file_is_what_the_recipe_gives(model):
    script = runpy.run_path(str(shipped_data() / "motions" / "make_poses.py"))
    for name, tasks in (("push", script["push_tasks"]()), ("steer", script["steer_tasks"]())):
        pose = load_poses()[name]
        start = pose.copy()
        start[7:] += 0.05  # another start finds the same pose
        np.testing.assert_allclose(ik.solve(model, start, tasks)[:3], pose[:3], atol=2e-4)
        np.testing.assert_allclose(ik.solve(model, start, tasks)[7:], pose[7:], atol=2e-3)
