"""The skating scene: the same physics in MuJoCo and in MuJoCo Warp, and what the board does under a load."""

import math

import mujoco
import numpy as np
import pytest
from made import with_effect

from sim.board.scene import TILT_JOINT, TRUCK_JOINTS
from sim.skate.robot import g1
from sim.skate.world.scene import ITERATIONS, LINE_SEARCH_ITERATIONS, SceneOptions, skate_spec, standing_state
from sim.skate.world.terrain import SLOPES_DEG, STEPS, add_terrain
from sysid.board import load_board
from sysid.errors import SysidError
from sysid.workspace import shipped_data

pytestmark = pytest.mark.train

BOARD = load_board(shipped_data() / "boards" / "pink.toml")


@pytest.fixture(scope="module")
def needs_g1():
    try:
        g1.g1_xml()
    except SysidError as error:
        pytest.skip(str(error))


def in_mujoco(model, data, steps):
    states = []
    for _ in range(steps):
        mujoco.mj_step(model, data)
        states.append(np.concatenate((data.qpos, data.qvel)))
    return np.array(states)


def in_warp(model, data, steps):
    mujoco_warp = pytest.importorskip("mujoco_warp")
    warp_model = mujoco_warp.put_model(model)
    warp_data = mujoco_warp.put_data(model, data, nworld=1, nconmax=64, njmax=256)
    states = []
    for _ in range(steps):
        mujoco_warp.step(warp_model, warp_data)
        states.append(np.concatenate((warp_data.qpos.numpy()[0], warp_data.qvel.numpy()[0])))
    return np.array(states)


@pytest.mark.slow
@pytest.mark.parametrize("name", [None, "coulomb", "dahl", "hysteresis", "stribeck", "viscoelastic"])
def test_a_deck_moves_alike_under_the_solver_of_training_and_of_rides(needs_g1, name):
    model = skate_spec(BOARD if name is None else with_effect(BOARD, name)).compile()
    data = mujoco.MjData(model)
    board, pelvis, tilt = (
        model.joint(joint).qposadr[0]
        for joint in ("board/board_free_joint", "robot/floating_base_joint", f"board/{TILT_JOINT}")
    )
    data.qpos[board : board + 3] = 0.0, 0.0, model.body("board/board").pos[2]
    data.qpos[pelvis : pelvis + 3] = -15.0, 0.0, 1.0  # out of the way
    data.qpos[tilt] = 0.1
    start = data.qpos.copy()
    ours = in_mujoco(model, data, 80)[:, tilt]
    mujoco.mj_resetData(model, data)
    data.qpos[:] = start
    model.opt.iterations, model.opt.ls_iterations = ITERATIONS, LINE_SEARCH_ITERATIONS
    theirs = in_warp(model, data, 80)[:, tilt]
    assert np.abs(ours).max() > 0.03
    assert np.sqrt(np.mean((ours - theirs) ** 2) / np.mean(ours**2)) < 1e-3


@pytest.mark.parametrize("coupling", ["equality", "direct"])
def test_the_scene_has_the_robot_the_board_and_23_controls(needs_g1, coupling):
    model = skate_spec(BOARD, SceneOptions(coupling=coupling)).compile()
    assert (model.nq, model.nv, model.nu) == (44, 42, 23)
    assert [model.actuator(i).name for i in range(23)] == [f"robot/{name}" for name in g1.JOINTS]
    assert model.opt.timestep == 0.005
    assert model.body("terrain").id > 0


def test_without_steering_the_trucks_stay_straight(needs_g1):
    model = skate_spec(BOARD, SceneOptions(steered=False)).compile()
    data = mujoco.MjData(model)
    tilt = model.joint(f"board/{TILT_JOINT}").qposadr[0]
    data.qpos[:] = standing_state(model)
    data.qpos[tilt] = 0.15
    for _ in range(20):
        mujoco.mj_step(model, data)
    assert abs(data.qpos[tilt]) > 0.01
    for name in TRUCK_JOINTS:
        assert abs(data.joint(f"board/{name}").qpos[0]) < 0.01


@pytest.mark.parametrize(
    ("kind", "lowest"),
    [("slopes", -3.0 * sum(math.tan(math.radians(a)) for a in SLOPES_DEG)), ("steps", -sum(STEPS))],
)
def test_the_ground_is_level_at_the_start_and_goes_down(kind, lowest):
    height = ground(kind)
    assert [height(x, 0.0) for x in (0.0, 3.0, 55.0)] == pytest.approx([0.0, 0.0, lowest], abs=1e-6)


def ground(kind):
    """Return the height of a terrain as a function of the place."""
    spec = mujoco.MjSpec()
    add_terrain(spec, kind)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geom = np.zeros(1, dtype=np.int32)
    return lambda x, y: round(5.0 - mujoco.mj_ray(model, data, [x, y, 5.0], [0, 0, -1], None, 1, -1, geom), 9)
