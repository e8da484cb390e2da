"""The curriculum that leads itself: its rule by hand, what hangs on it, and its way through a checkpoint."""

import math

import pytest
import training  # noqa: F401  skips without the training stack

from policy_runtime.learning.curriculum import (
    EASIER,
    HARDER,
    LONGEST,
    PATIENCE_ENDS,
    STRENGTH_ENDS,
    Level,
    step,
)

pytestmark = pytest.mark.train


def test_the_task_becomes_harder_with_few_ends_and_easier_with_many_within_bounds():
    assert step(8.0, 8.0) == 0
    assert 0 < step(4.0, 8.0) < HARDER == step(0.0, 8.0)
    assert -EASIER == step(80.0, 8.0) < step(10.0, 8.0) < 0


def test_patience_is_led_by_a_few_percent_and_strength_begins_where_it_ends():
    level = Level(patience=60.0)
    assert level.after(0.5, own=20).patience == pytest.approx(60 * math.exp(-0.03))
    assert level.after(60.0, own=20).patience == pytest.approx(60 * math.exp(0.01))
    assert Level(patience=20.1).after(0.1, own=20).patience == 20.0
    hard = Level(patience=20.0).after(1.0, own=20)
    assert (hard.patience, hard.strength) == (20.0, pytest.approx(0.03))
    assert hard.after(60.0, own=20).strength == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("ends", "weight"),
    [
        (math.inf, 0.005), (PATIENCE_ENDS, 0.005), (math.sqrt(PATIENCE_ENDS * STRENGTH_ENDS), math.sqrt(5e-6)),
        (STRENGTH_ENDS, 0.001), (0.0, 0.001),
    ],
)  # fmt: skip
def test_entropy_falls_with_the_ends(ends, weight):
    for patience in (20.0, 100.0):
        assert Level(patience=patience, ends=ends).entropy(0.005, 0.001) == pytest.approx(weight)


@pytest.fixture(scope="module")
def led(tmp_path_factory):
    """A run of two iterations of eight worlds, and what it is built of, once more, restored."""
    from pathlib import Path

    from policy_runtime.learning.run_folder import LearnOptions, RunConfig, RunFolder
    from policy_runtime.train import build, build_curriculum, join_processes, restore, train
    from sim.skate.options import SkateOptions
    from sysid.workspace import shipped_data

    folder = RunFolder(Path(tmp_path_factory.mktemp("led")) / "run")
    learn = LearnOptions(environments=8, steps=6, iterations=2, hidden=(32, 16))
    config = RunConfig(task=SkateOptions(boards=2), learn=learn)
    folder.begin(config, shipped_data() / "boards" / "pink.toml")
    train(folder, device="cpu")
    process = join_processes("cpu")
    env, learner = build(folder, config, process)
    _, level = restore(folder, config, env, learner, process)
    yield folder, env.unwrapped, learner, build_curriculum(config, env, learner, level), level
    env.close()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_level_is_in_curves_and_checkpoint(led):
    folder, env, _, curriculum, level = led
    rows = folder.read_curves()
    assert rows[0]["patience"] == LONGEST
    assert rows[0]["entropy_weight"] == 0.005
    expected = Level(patience=LONGEST)
    for row in rows:
        expected = expected.after(row["falls_per_minute"], own=20)
    assert level == expected
    curriculum.set(Level(patience=50.0, strength=0.2, ends=30.0))
    assert float(env.termination_manager.get_term_cfg("wrong_stance").params["patience"]) == 50.0
    assert env.event_manager.get_term_cfg("worlds").func.strength == 0.2


@pytest.mark.filterwarnings("ignore")
def test_a_critic_grows_without_changing_its_answers():
    import torch
    from rsl_rl.models import MLPModel

    from policy_runtime.learning.checkpoint import grow_critic

    def critic(size):
        seen = {"critic": torch.zeros(1, size)}
        return MLPModel(seen, {"critic": ["critic"]}, "critic", 1, hidden_dims=(8,), obs_normalization=True)

    torch.manual_seed(1)
    small, large = critic(5), critic(7)
    small.obs_normalizer._mean += 0.3
    kept = {"critic_state_dict": small.state_dict(), "optimizer_state_dict": {}}
    grow_critic(kept, 7)
    assert "optimizer_state_dict" not in kept
    large.load_state_dict(kept["critic_state_dict"])
    seen = torch.randn(4, 7)
    torch.testing.assert_close(large({"critic": seen}), small({"critic": seen[:, :5]}))
    grow_critic(kept, 7)
    large.load_state_dict(kept["critic_state_dict"])  # nothing more
