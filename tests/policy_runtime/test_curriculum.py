"""The curriculum that leads itself: its rule by hand, what hangs on it, and its way through a checkpoint."""

import math

import pytest
import training  # noqa: F401  skips without the training stack

from policy_runtime.learning.curriculum import (
    EASIER,
    HARDER,
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
