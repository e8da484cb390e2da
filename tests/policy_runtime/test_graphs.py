"""What CUDA graphs need, shown on the processor: memory that stays, nothing asked of the host, mjlab's numbers."""

import pytest
from training import worlds

pytestmark = [
    pytest.mark.train,
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore"),
]  # the stack's own warnings

WORLDS = 8
WAITS = ("_local_scalar_dense", "nonzero", "lift_fresh", "masked_select", "is_nonzero", "equal.default")
"""Operations that wait for the device, or that copy from the host."""


def environment(kind=None):
    import torch

    torch.manual_seed(4)
    return worlds(WORLDS, kind=kind, seed=4, boards=2, episode=0.3)


@pytest.fixture(scope="module")
def env():
    with environment() as env:
        yield env


def test_a_step_is_mjlabs_step():
    import torch
    from mjlab.envs import ManagerBasedRlEnv

    actions = 0.3 * torch.randn(25, WORLDS, 23, generator=torch.Generator().manual_seed(1))
    kept = []
    for kind in (None, ManagerBasedRlEnv):
        rows = []
        with environment(kind) as env:
            rewards = env.reward_manager
            if kind is None:
                rewards.set_weight("always/alive", 3.0)
            rewards.get_term_cfg("always/alive").weight = 3.0
            torch.manual_seed(5)
            for action in actions:
                seen, earned, ended, late, _ = env.step(action)
                # Contact forces in the critic's vector may be of the instant before in mjlab's own step.
                ends = (earned[:, None], ended[:, None], late[:, None])
                rows.append(torch.cat((seen["actor"], seen["style"], *ends), 1))
        kept.append(torch.stack(rows))
    assert kept[0][..., -2:].any()  # episodes have ended on the way
    assert torch.equal(*kept)


def asked_of_the_host(function, least=50):
    """Return which operations of a function wait for the device or copy to it; it launches `least` or more."""
    from torch.utils._python_dispatch import TorchDispatchMode

    asked, launched = [], []

    class Watch(TorchDispatchMode):
        def __torch_dispatch__(self, func, types, args=(), kwargs=None):
            launched.append(func)
            if any(word in str(func) for word in WAITS):
                asked.append(str(func))
            return func(*args, **(kwargs or {}))

    with Watch():
        function()
    assert len(launched) >= least
    return asked


@pytest.mark.parametrize("part", ["_judge_state", "_see_state"])
def test_a_graph_of_the_worlds_asks_nothing_of_the_host(env, part):
    import torch

    for _ in range(3):
        env.step(torch.zeros(WORLDS, 23))
    assert asked_of_the_host(getattr(env, part)) == []


def test_drawing_how_episodes_begin_asks_nothing_of_the_host(env):
    begin, command = env.event_manager.get_term_cfg("begin").func, env.command_manager.get_term("skate")
    assert asked_of_the_host(begin.draw) == []
    assert asked_of_the_host(command.draw, 25) == []


@pytest.fixture
def rollout(env):
    """Return how to make a learner with a rollout of six steps."""
    import torch
    from mjlab.rl import RslRlVecEnvWrapper

    from policy_runtime.learning.progress import Progress
    from policy_runtime.learning.run_folder import LearnOptions, RunConfig
    from policy_runtime.train import build_learner, collect, join_processes

    learn = LearnOptions(environments=WORLDS, steps=6, hidden=(32, 16), mini_batches=4, desired_kl=0.01)
    wrapped, process = RslRlVecEnvWrapper(env), join_processes("cpu")

    def learner():
        torch.manual_seed(6)
        env.seed(6)
        wrapped.reset()
        built = build_learner(wrapped, RunConfig(learn=learn), process)
        collect(wrapped, built, wrapped.get_observations(), learn.steps, Progress(env))
        return built

    return learner


def test_learned_weights_without_their_optimiser_are_not_thrown_about(rollout):
    """Adam's first steps are as long as the rate on every weight, whatever the gradient."""
    import torch

    def moved(kept):
        learner = rollout()
        learned = {name: value for name, value in learner.save().items() if kept or "optimi" not in name}
        with torch.inference_mode():  # in which the normalisers were updated
            learner.load({**learned, "iteration": 1}, None, strict=True)
        before = [p.detach().clone() for p in learner.actor.parameters()]
        learner.num_learning_epochs = learner.num_mini_batches = 1
        learner.update()
        return max(
            (p - q).abs().max().item() for p, q in zip(learner.actor.parameters(), before, strict=True)
        )

    assert moved(kept=False) < 2e-5
    assert moved(kept=True) > 5e-4  # at the rate that the optimiser had
