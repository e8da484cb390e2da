# pyright: reportMissingImports=false, reportUnknownParameterType=false, reportPrivateUsage=false
"""PPO's update with every mini-batch as one CUDA graph: rsl_rl's numbers without waiting for Python.

rsl_rl reads four values from the device in each mini-batch (three losses and the divergence), and launches some 400
operations. Here the learning rate follows the divergence on the device, and the host reads values only at the end.
"""

from typing import Any

import torch
from torch import nn

from policy_runtime.learning.graphs import Graphed

LEAST_RATE, LARGEST_RATE, RATE_STEP = 1e-5, 1e-2, 1.5
"""Bounds of rsl_rl's adaptive learning rate, and its factor."""


class FusedUpdate:
    """The update of an algorithm of rsl_rl's kind, in one process, without recurrence, RND and symmetry."""

    def __init__(self, algorithm: Any, *, graphs: bool = True) -> None:
        """Take over an algorithm's update.

        Args:
            algorithm: rsl_rl's PPO, or a subclass.
            graphs: Whether to record.
        """
        self._algorithm, device, storage = algorithm, algorithm.device, algorithm.storage
        samples = storage.num_envs * storage.num_transitions_per_env
        self._size = samples // algorithm.num_mini_batches
        self._index = torch.zeros(self._size, dtype=torch.long, device=device)
        self._advantages = torch.zeros(samples, device=device)
        self._rate = torch.tensor(float(algorithm.learning_rate), device=device)
        self._entropy = torch.zeros((), device=device)
        self._totals = torch.zeros(3, device=device)
        self._deviations = [model.obs_normalizer._std.clone() for model in self._models]
        self._learn = Graphed(self._learn_batch, device, enabled=graphs, side_stream=True)

    @property
    def _models(self) -> tuple[Any, Any]:
        return self._algorithm.actor, self._algorithm.critic

    def __call__(self) -> dict[str, float]:
        """Learn from the storage, clear it, and return the mean losses."""
        algorithm = self._algorithm
        storage = algorithm.storage
        use_rate(algorithm.optimizer, self._rate.fill_(algorithm.learning_rate))
        self._entropy.fill_(algorithm.entropy_coef)
        self._advantages.copy_(storage.advantages.flatten())
        for model, kept in zip(self._models, self._deviations, strict=True):
            # rsl_rl makes a new tensor at every step of the rollout; a graph reads the recorded one.
            model.obs_normalizer._std = kept.copy_(model.obs_normalizer._std)
        self._totals.zero_()
        batches, epochs = algorithm.num_mini_batches, algorithm.num_learning_epochs
        order = torch.randperm(batches * self._size, device=algorithm.device)
        for _ in range(epochs):
            for chosen in order.split(self._size):
                self._index.copy_(chosen)
                self._learn()
        storage.clear()
        algorithm.learning_rate = float(self._rate)
        means = (self._totals / (batches * epochs)).tolist()
        return dict(zip(("value", "surrogate", "entropy"), means, strict=True))

    def _learn_batch(self) -> None:
        algorithm, chosen = self._algorithm, self._index
        storage, actor = algorithm.storage, algorithm.actor
        take = lambda values: values.flatten(0, 1)[chosen]  # noqa: E731
        seen = {
            name: take(storage.observations[name])
            for name in {*actor.obs_groups, *algorithm.critic.obs_groups}
        }
        actor.distribution.update(actor.mlp(actor.get_latent(seen)))
        log_prob = actor.get_output_log_prob(take(storage.actions))
        values, old_values, returns = algorithm.critic(seen), take(storage.values), take(storage.returns)
        entropy = actor.output_entropy.mean()
        if algorithm.desired_kl is not None and algorithm.schedule == "adaptive":
            self._follow_divergence(tuple(take(p) for p in storage.distribution_params))

        advantage = self._advantages[chosen]
        ratio = torch.exp(log_prob - take(storage.actions_log_prob).squeeze(-1))
        clip = algorithm.clip_param
        surrogate = torch.max(-advantage * ratio, -advantage * ratio.clamp(1 - clip, 1 + clip)).mean()
        near = old_values + (values - old_values).clamp(-clip, clip)
        value = torch.max((values - returns) ** 2, (near - returns) ** 2).mean()
        loss = surrogate + algorithm.value_loss_coef * value - self._entropy * entropy

        algorithm.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        for model in self._models:
            nn.utils.clip_grad_norm_(model.parameters(), algorithm.max_grad_norm)
        algorithm.optimizer.step()
        self._totals += torch.stack((value.detach(), surrogate.detach(), entropy.detach()))

    @torch.no_grad()
    def _follow_divergence(self, old: tuple[torch.Tensor, ...]) -> None:
        """Lower the rate where the policy has moved twice as far as wanted, raise it where less than half."""
        actor, wanted = self._algorithm.actor, self._algorithm.desired_kl
        moved = actor.get_kl_divergence(old, actor.output_distribution_params).mean()
        lower = (self._rate / RATE_STEP).clamp(min=LEAST_RATE)
        higher = (self._rate * RATE_STEP).clamp(max=LARGEST_RATE)
        little = (moved < wanted / 2) & (moved > 0)
        rate = torch.where(moved > 2 * wanted, lower, torch.where(little, higher, self._rate))
        self._rate.copy_(rate)


def use_rate(optimiser: torch.optim.Optimizer, rate: torch.Tensor | None) -> None:
    """Let an optimiser run in graphs, with its learning rate on the device or unchanged."""
    for group in optimiser.param_groups:
        group["capturable"] = next(iter(group["params"])).is_cuda
        if rate is not None:
            group["lr"] = rate
    for state in optimiser.state.values():
        if state["step"].device != state["exp_avg"].device:  # as a checkpoint without graphs has it
            state["step"] = state["step"].to(state["exp_avg"].device)


def plain_state(optimiser: torch.optim.Optimizer) -> dict[str, Any]:
    """Return an optimiser's state as any run can load it."""
    content = optimiser.state_dict()
    for group in content["param_groups"]:
        group["lr"], group["capturable"] = float(group["lr"]), False
    return content
