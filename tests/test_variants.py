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
