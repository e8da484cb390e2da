"""Every variant of the task, in worlds on the processor: what its option changes is there, and only then."""

import math
from dataclasses import replace

import numpy as np
import pytest
import training
from riding import pink

from sim.skate.cycle.start import AT_REST
from sim.skate.options import SkateOptions

pytestmark = [
    pytest.mark.train,
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore"),
]  # the stack's own warnings

WORLDS = 8
PUSHING = replace(AT_REST, pushing=1.0)


def worlds(**options):
    """Eight worlds of a variant of the task that do not differ, after their first reset."""
    return training.worlds(WORLDS, **({**training.ALIKE, "strength": 0.0} | options))


def step(env):
    import torch

    return env.step(torch.zeros(WORLDS, 23))


def paid(env, term):
    """Return what a reward term gave for the last step, weight included, before the step's time, (n,)."""
    return env.reward_manager._step_reward[:, env.reward_manager.active_terms.index(term)].numpy()


def test_pushing_by_tracking_follows_the_clip_nearest_in_speed():
    from policy_runtime.train import push_clips
    from sim.skate.mdp.measuring import measure
    from sim.skate.mdp.observations import skate_command

    clips = push_clips()
    with worlds(clips=clips, pushing="tracking", start=PUSHING, speed=(0.3, 1.5)) as env:
        command = skate_command(env)
        for _ in range(3):
            began = command.step.numpy().copy()
            step(env)
            state, reward = measure(env), paid(env, "push/tracking")
            for world in range(WORLDS):
                speed = float(state.commanded_speed[world])
                _, clip = min(clips, key=lambda one: abs(one[0] - speed))
                wanted = clip[began[world] % len(clip)]
                error = float(((state.joint_position[world].numpy() - wanted) ** 2).mean())
                # Episodes that begin in the push pose are on their way to the clip, whatever it is.
                assert reward[world] == pytest.approx(5.0 * math.exp(-error / 0.022), rel=1e-3)
        assert reward.max() > 0.1
    with pytest.raises(ValueError, match="at least one reference clip"), worlds(pushing="tracking"):
        pass


def write_yaw(env, world, yaw):
    """Turn the robot of a world about the vertical to a heading [rad]."""
    import torch

    from sim.skate.mdp.observations import skate_command

    column = skate_command(env).reading.robot.q + 3
    quaternion = torch.tensor([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    env.sim.data.qpos[world, column : column + 4] = quaternion


def test_the_default_variant():
    """What the actor sees, who ends, which boards are drawn: one environment, because building one takes long."""
    import torch

    from sim.skate.mdp import randomisation
    from sim.skate.mdp.measuring import measure
    from sim.skate.mdp.observations import skate_command
    from sim.skate.world.posterior import Spread, board_draws, draw_boards
    from sim.skate.world.scene import SceneOptions, as_written

    options = SkateOptions(boards=6, start=PUSHING, speed=(0.5, 1.5))
    with worlds(boards=6, start=PUSHING, speed=(0.5, 1.5)) as env:
        command, reading = skate_command(env), skate_command(env).reading
        assert {"steer/tilt_guide", "transition/positions", "transition/orientations"} <= set(
            env.reward_manager.active_terms
        )

        # Boards of the posterior, in turn.
        rng = np.random.default_rng(3)
        boards = draw_boards(as_written(pink(), SceneOptions()), 6, Spread(), rng)
        draws = board_draws(boards, SceneOptions().timestep)
        joint = env.sim.mj_model.joint("board/board_tilt_joint")
        stiffness = env.sim.model.jnt_stiffness[:, joint.id].numpy()
        drawn = draws.fields["jnt_stiffness"][:, draws.elements["joint"].index("board_tilt_joint")]
        np.testing.assert_allclose(stiffness, drawn[np.arange(WORLDS) % 6], rtol=1e-6)
        assert np.ptp(stiffness) > 0.5

        # How far it still has to turn, by the yaw of the pelvis since it was told.
        turns = command.command[:, 1].clone()
        torch.testing.assert_close(command.seen()[:, 1], turns, atol=1e-6, rtol=0)
        began = command._yaw_then[:2].clone()
        write_yaw(env, 0, float(began[0]) + 0.5)
        write_yaw(env, 1, float(began[1]) - 3.0)
        seen = command.seen()
        assert seen[0, 1] == pytest.approx(float(turns[0]) - 0.5, abs=1e-5)
        assert seen[1, 1] == pytest.approx(math.remainder(float(turns[1]) + 3.0, 2 * math.pi), abs=1e-5)
        torch.testing.assert_close(seen[2:, 1], turns[2:], atol=1e-6, rtol=0)
        torch.testing.assert_close(seen[:, 0], command.command[:, 0])
        env.reset()
        command.step[2] = command.clock.push + command.clock.mount - 1
        told = command.command[2, 1].item()
        write_yaw(env, 2, 0.3)
        frame = step(env)[0]["actor"].reshape(WORLDS, 5, 78)[:, -1]
        assert command.command[2, 1].item() != told  # steering begins: a new turn, of which nothing is done
        assert frame[2, 1].item() == pytest.approx(command.command[2, 1].item(), abs=1e-5)

        # Noise within its bounds, which no two worlds share.
        clean = reading.imu("ang_vel") * 0.25
        off = (frame[:, 2:5] - clean).abs()
        assert 0 < off.max() <= 0.2 * 0.25 + 1e-6

        # Pushes of the pelvis, to both sides and no more than told.
        assert "push" in env.event_manager.active_terms["interval"]
        columns = slice(reading.robot.v, reading.robot.v + 2)
        before = env.sim.data.qvel[:, columns].clone()
        randomisation.push(env, None, options.pushes)
        kick = (env.sim.data.qvel[:, columns] - before).numpy()
        assert -0.5 <= kick.min() < 0 < kick.max() <= 0.5

        # A pushing foot that stays in the air ends the episode, and only while pushing.
        env.reset()
        command.step[:3] = torch.tensor([90, 90, 200])
        command.air_time[:] = torch.tensor([1.3, 0.2, 1.3] + [0.2] * 5)
        step(env)
        idle = env.termination_manager.get_term("idle_foot")
        assert not bool(measure(env).foot_on_ground[0, 0])
        assert idle.tolist() == [True] + [False] * 7


@pytest.mark.parametrize(("phase", "before"), [("mounting", 0), ("dismounting", 1)])
def test_who_begins_in_a_transition_is_where_the_clip_is(phase, before):
    import torch

    from sim.skate.mdp.measuring import measure
    from sim.skate.mdp.observations import skate_command
    from sim.skate.world.cycle import load_cycle

    start = replace(AT_REST, **{phase: 1.0}, speed=(1.0, 1.0), position_noise=0.0, joint_noise=0.0)
    with worlds(start=start, speed=(0.5, 1.5), pushes=0.0) as env:
        command, reading = skate_command(env), skate_command(env).reading
        index = ("pushing", "mounting", "steering", "dismounting").index(phase)
        assert command.phases[index].all()
        robot = env.sim.data.qpos[:, reading.robot.q : reading.robot.q + 30].clone()
        robot[:, 2] -= reading.axis_height
        clip = torch.tensor(load_cycle(command.clock), dtype=torch.float)[command.step]
        torch.testing.assert_close(robot, clip, atol=1e-4, rtol=0)
        assert (reading.board.velocity()[:, 0] == 1.0).all()
        assert not reading.tilt().any()
        # Nothing is left of the last turn, and the task's path, which lifts them more, begins in the pose before.
        assert not command.seen()[:, 1].any()
        ends = command._end_positions[before].expand(WORLDS, -1, -1)
        torch.testing.assert_close(command._start_positions, ends)
        apart = (command.key_positions - command.key_bodies[0])[..., :2].norm(dim=-1)
        assert apart[:, 0].max() < 0.08
        for _ in range(5):
            env.step(command.first_action)
        assert (env.episode_length_buf == 5).all()
        assert measure(env).foot_on_deck[:, 1].all()


def test_a_world_that_breaks_down_is_ended_and_not_counted():
    import torch

    from policy_runtime.learning.progress import Progress
    from sim.skate.mdp.observations import skate_command

    with worlds(start=PUSHING, speed=(0.5, 1.5)) as env:
        progress = Progress(env)
        env.sim.data.qvel[3, skate_command(env).reading.board.v] = math.nan
        observations = step(env)[0]
        progress.add(torch.zeros(()))
        assert env.termination_manager.get_term("not_finite").tolist() == [world == 3 for world in range(8)]
        for values in observations.values():
            assert torch.isfinite(values).all()
        numbers = progress.read()
        assert all(math.isfinite(value) for value in numbers.values())
        assert numbers["end/not_finite"] == pytest.approx(1 / (WORLDS * 0.02 / 60))
