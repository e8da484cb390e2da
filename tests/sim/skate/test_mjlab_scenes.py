"""Variants of the task inside the training's own simulator, each with a look at its physics."""

import math

import mujoco
import numpy as np
import pytest
import training
from riding import pink

from sim.board.scene import TILT_JOINT, TRUCK_JOINTS, WHEELS
from sim.skate.world.scene import SceneOptions, skate_spec
from sim.skate.world.terrain import SLOPES_DEG, STEPS

pytestmark = [
    pytest.mark.train,
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore"),
]  # the stack's own warnings


def task(**options):
    """Two worlds of a variant of the task that begin at rest, in mjlab's own environment."""
    from mjlab.envs import ManagerBasedRlEnv

    from sim.skate.cycle.start import AT_REST, STANDING_PLACE

    still = {
        "start": AT_REST,
        "foot_place": (STANDING_PLACE,) * 2,
        "pushes": 0.0,
        "noise": False,
        "strength": 0.0,
    }
    alike = {"boards": 0, "speed": (0.5, 0.5), "standing": 0.0, "slow": 0.0}
    return training.worlds(2, kind=ManagerBasedRlEnv, seed=0, **still, **alike, **options)


def set_rolling(model, qpos, qvel, *, x, height, pitch, speed):
    """Put the board at a place of the lane, rolling along it; the robot goes far behind."""
    board, base = model.joint("board/board_free_joint"), model.joint("robot/floating_base_joint")
    q, v = board.qposadr[0], board.dofadr[0]
    axle = model.body("board/board").pos[2]
    qpos[q : q + 3] = x + math.sin(pitch) * axle, 0.0, height + math.cos(pitch) * axle
    qpos[q + 3 : q + 7] = math.cos(pitch / 2), 0.0, math.sin(pitch / 2), 0.0
    qpos[base.qposadr[0] : base.qposadr[0] + 3] = -15.0, 0.0, 1.0
    for name in (TILT_JOINT, *TRUCK_JOINTS):
        qpos[model.joint(f"board/{name}").qposadr[0]] = 0.0
    qvel[:] = 0.0
    qvel[v : v + 3] = speed * math.cos(pitch), 0.0, -speed * math.sin(pitch)
    radius = model.geom(f"board/{WHEELS[0]}_wheel_collision").size[0]
    for wheel in WHEELS:
        qvel[model.joint(f"board/{wheel}_wheel_joint").dofadr[0]] = speed / radius


def roll_in_both(env, options, steps, **where):
    """Roll the board in the environment's simulator and in plain MuJoCo; return model and both ends of it.

    Each end is (qpos, qvel, highest speed), of the first world.
    """
    import torch

    model = env.sim.mj_model
    qpos, qvel = model.qpos0.copy(), np.zeros(model.nv)
    set_rolling(model, qpos, qvel, **where)
    data = env.sim.data
    data.qpos[:] = torch.as_tensor(qpos, dtype=torch.float32)
    data.qvel[:] = torch.as_tensor(qvel, dtype=torch.float32)
    data.qacc_warmstart[:] = 0.0
    for _ in range(steps):
        env.sim.step()
    theirs = data.qpos[0].numpy().copy(), data.qvel[0].numpy().copy()
    plain = skate_spec(pink(), options).compile()
    state = mujoco.MjData(plain)
    set_rolling(plain, state.qpos, state.qvel, **where)
    mujoco.mj_step(plain, state, steps)
    return model, theirs, (state.qpos.copy(), state.qvel.copy())


def wheel_centres(model, qpos):
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    return np.array([data.body(f"board/{wheel}_wheel").xpos for wheel in WHEELS])


def test_set_trucks_gait_clock_and_slopes():
    """One environment for three variants, because building one takes long."""

    with task(coupling="direct", terrain="slopes", pushing="gait") as env:
        import torch

        from sim.skate.mdp.measuring import measure

        model, data = env.sim.mj_model, env.sim.data
        tilt = model.joint(f"board/{TILT_JOINT}").qposadr[0]
        trucks = [model.joint(f"board/{name}").qposadr[0] for name in TRUCK_JOINTS]
        clock = list(env.reward_manager.active_terms).index("push/gait_clock")
        slope = math.tan(pink().geometry["rake"].value)
        for _ in range(25):  # the robot sinks onto the right side of the deck and tilts it
            env.step(torch.zeros(2, 23))
            state = measure(env)
            wanted = state.time_in_push % 0.9 < 0.35 * 0.9
            paid = env.reward_manager._step_reward[:, clock]
            assert torch.equal(paid, 3.0 * (wanted == state.foot_on_ground[:, 0]))
        assert not bool(wanted.any())  # both halves of the clock have been seen
        assert bool(state.foot_on_ground[:, 0].all())
        roll = data.qpos[0, tilt].item()
        assert abs(roll) > 0.02
        for truck in trucks:  # set one simulation step ago
            assert data.qpos[0, truck].item() == pytest.approx(math.atan(slope * math.sin(roll)), rel=0.01)

        angle, x, time = math.radians(SLOPES_DEG[0]), 7.0, 0.4
        _, theirs, ours = roll_in_both(
            env, SceneOptions(coupling="direct", terrain="slopes"), round(time / 0.005),
            x=x, height=-(x - 6.0) * math.tan(angle), pitch=angle, speed=1.0,
        )  # fmt: skip
    v = model.joint("board/board_free_joint").dofadr[0]
    speeds = [float(np.linalg.norm(end[1][v : v + 3])) for end in (theirs, ours)]
    assert speeds[0] == pytest.approx(speeds[1], rel=0.01)
    # Gravity down the slope less what rolling costs: faster, but not faster than a frictionless slide.
    assert 1.0 + 0.6 * 9.81 * math.sin(angle) * time < speeds[0] < 1.0 + 9.81 * math.sin(angle) * time
    wheels = wheel_centres(model, theirs[0])
    off = (wheels[:, 2] + (wheels[:, 0] - 6.0) * math.tan(angle)) * math.cos(angle)  # over the slope
    assert off == pytest.approx(model.geom("board/front_left_wheel_collision").size[0], abs=1e-3)


def test_ledges_are_rolled_down():
    with task(terrain="steps") as env:
        model, theirs, ours = roll_in_both(
            env, SceneOptions(terrain="steps"), 160, x=4.5, height=0.0, pitch=0.0, speed=1.5
        )
    radius = model.geom("board/front_left_wheel_collision").size[0]
    v = model.joint("board/board_free_joint").dofadr[0]
    for qpos, qvel in (theirs, ours):
        wheels = wheel_centres(model, qpos)
        assert np.all(wheels[:, 0] > 5.05)  # over the edge
        assert wheels[:, 2] == pytest.approx(radius - STEPS[0], abs=1e-3)  # down, and not sunk in
        assert 1.0 < qvel[v] < 1.6
    assert theirs[1][v] == pytest.approx(ours[1][v], rel=0.03)
