"""Every variant of the task, in worlds on the processor: what its option changes is there, and only then."""

import contextlib
import math
import sys

import pytest
from riding import pink

from sim.skate.options import SkateOptions
from sim.skate.start import Start

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # warnings are the training stack's own

WORLDS = 8
STANDING = Start(standing=1.0, pushing=0.0, steering=0.0)
PUSHING = Start(standing=0.0, pushing=1.0, steering=0.0)


@contextlib.contextmanager
def worlds(board=None, *, clips=(), **options):
    """Eight worlds of a variant of the task after their first reset."""
    for module in ("torch", "mjlab", "warp"):
        pytest.importorskip(module, reason="needs the training stack")
    from mjlab.envs import ManagerBasedRlEnv

    from sim.skate.task import skate_env_cfg

    settings = SkateOptions(**({"boards": 0} | options))
    cfg = skate_env_cfg(board or pink(), settings, environments=WORLDS, seed=3, clips=clips)
    with contextlib.redirect_stdout(sys.stderr):
        env = ManagerBasedRlEnv(cfg, device="cpu")
    try:
        env.reset()
        yield env
    finally:
        env.close()


def step(env):
    import torch

    return env.step(torch.zeros(WORLDS, 23))


def paid(env, term):
    """Return what a reward term gave for the last step, weight included, before the step's time, (n,)."""
    return env.reward_manager._step_reward[:, env.reward_manager.active_terms.index(term)].numpy()


def test_pushing_by_tracking_follows_the_clip_nearest_in_speed():
    from policy_runtime.motions import load_motions
    from policy_runtime.train import push_clips
    from sim.skate.measuring import measure
    from sim.skate.observations import skate_command

    motions = load_motions()
    with worlds(clips=push_clips(), pushing="tracking", start=PUSHING, speed=(0.3, 1.5)) as env:
        command = skate_command(env)
        for _ in range(3):
            began = command.step.numpy().copy()
            step(env)
            state, reward = measure(env), paid(env, "push/tracking")
            for world in range(WORLDS):
                speed = float(state.commanded_speed[world])
                clip = min(motions, key=lambda motion: abs(motion.speed - speed))
                wanted = clip.joints[began[world] % len(clip.joints)]
                error = float(((state.joint_position[world].numpy() - wanted) ** 2).mean())
                # Episodes that begin in the push pose are on their way to the clip, whatever it is.
                assert reward[world] == pytest.approx(5.0 * math.exp(-error / 0.022), rel=1e-3)
        assert reward.max() > 0.1
    with pytest.raises(ValueError, match="at least one reference clip"), worlds(pushing="tracking"):
        pass


def test_transitions_by_style_have_windows_of_every_stretch_and_no_path():
    import torch

    from policy_runtime.style_reference import style_reference
    from sim.skate.observations import skate_command

    with worlds(transition="style", start=PUSHING, speed=(1.0, 1.0)) as env:
        terms = env.reward_manager.active_terms
        assert not {"transition/positions", "transition/orientations"} & set(terms)
        command, clock = skate_command(env), skate_command(env).clock
        frames = []
        # Worlds 0 to 3: about to mount, mounting, dismounting, steering; told to stand in world 4.
        command.step[:5] = torch.tensor([clock.push - 3, clock.push + 8, clock.period - 8, 200, 125])
        command._command[4, 0] = 0.0
        for _ in range(6):
            obs = step(env)[0]
            frames.append(command.reading.joint_position().clone())
            phase = command.step % clock.period
            window, mask = obs["style"], obs["style_mask"][:, 0]
        assert window.shape == (WORLDS, style_reference(SkateOptions(transition="style")).shape[1])
        alive = env.episode_length_buf >= 6
        assert alive[:5].all()
        for world in range(5):
            torch.testing.assert_close(
                window[world, :115], torch.cat([frame[world] for frame in frames[-5:]])
            )
        kinds = torch.stack((clock.pushing(phase), clock.mounting(phase), clock.dismounting(phase)), dim=1)
        torch.testing.assert_close(window[:, 115:], kinds.float())
        assert mask[:5].tolist() == [0, 1, 1, 0, 0]  # the first has been mounting for fewer than five frames
