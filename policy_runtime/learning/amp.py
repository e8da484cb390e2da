# pyright: reportMissingImports=false, reportUntypedBaseClass=false, reportUnknownParameterType=false
"""Adversarial motion priors (AMP) as an extension of rsl_rl's unchanged PPO.

A discriminator separates windows of five joint frames of the reference motions from the policy's. Windows that
it takes for reference are rewarded (Peng et al. 2021, "AMP"; least-squares loss, gradient penalty). Only
windows that lie within one episode and within a phase taught by style (`style_mask`) are shown to it and
rewarded. If style teaches more than pushing, the last numbers of a window name its phase. The reference windows
of a batch then have the same phases as the policy's: the frequency of a phase must not separate them.

Several processes average the gradients and statistics of the discriminator. They also average the observation
normalisers, which rsl_rl 5.4 leaves different.
"""

from dataclasses import dataclass
from typing import Any

import torch
import torch.distributed
from rsl_rl.algorithms import PPO
from rsl_rl.modules.distribution import GaussianDistribution
from torch import nn
from torch.optim.swa_utils import AveragedModel

from sim.skate.cycle.clock import CONTROL_PERIOD

ETA = 16
"""Iteration t weighs about t^η in the mean of the actor's weights: the last eighteenth of a run, in the mean."""
LEAST_RATE = 1e-5
"""Least learning rate of rsl_rl's adaptive schedule [1]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AmpOptions:
    """Numbers of the style reward and its discriminator."""

    weight: float = 5.0
    """Weight of the style reward per second; 0 leaves the discriminator out."""
    jitter: float = 0.015
    """Noise added to joint angles of both kinds of windows while the discriminator learns [rad]. Without it the
    trembling of exploration alone tells them apart, and no stride earns any style."""
    hidden: tuple[int, ...] = (256, 256)
    learning_rate: float = 1e-4
    gradient_penalty: float = 5.0
    """Weight of the mean squared gradient norm at the reference windows."""
    updates: int = 8
    """Discriminator steps an iteration."""
    batch: int = 8192
    """Windows of each kind a step and process."""
    weight_decay: float = 1e-3
    phases: int = 0
    """Last numbers of a window that say one-hot which phase it is of; 0 where all are of one."""


class RunningNormaliser(nn.Module):
    """Mean and variance of everything seen, the same in every process."""

    def __init__(self, size: int) -> None:
        """Start at mean 0 and variance 1 with no weight."""
        super().__init__()
        self.mean: torch.Tensor
        self.variance: torch.Tensor
        self.count: torch.Tensor
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("variance", torch.ones(size))
        self.register_buffer("count", torch.zeros(()))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return normalised windows within ±10."""
        return ((x - self.mean) / (self.variance.sqrt() + 1e-2)).clamp(-10, 10)

    @torch.no_grad()
    def update(self, x: torch.Tensor) -> None:
        """Take a batch into account, shape (batch, size)."""
        moments = torch.stack((x.mean(0), (x**2).mean(0)))
        average_over_processes(moments)
        mean, variance = moments[0], moments[1] - moments[0] ** 2
        count = self.count + len(x)
        rate = len(x) / count
        delta = mean - self.mean
        self.variance += rate * (variance - self.variance + delta**2 * (1 - rate))
        self.mean += rate * delta
        self.count.copy_(count)


class Discriminator(nn.Module):
    """Scores windows: about 1 for reference motion, about -1 for anything else."""

    def __init__(self, size: int, hidden: tuple[int, ...]) -> None:
        """Build the network for windows of `size` numbers."""
        super().__init__()
        self.normaliser = RunningNormaliser(size)
        layers: list[nn.Module] = []
        for width_in, width_out in zip((size, *hidden[:-1]), hidden, strict=True):
            layers += [nn.Linear(width_in, width_out), nn.ReLU()]
        self.network = nn.Sequential(*layers, nn.Linear(hidden[-1], 1))

    def forward(self, windows: torch.Tensor) -> torch.Tensor:
        """Return scores, (batch,), of raw windows, (batch, size)."""
        return self.network(self.normaliser(windows)).squeeze(-1)

    def loss(self, reference: torch.Tensor, policy: torch.Tensor, penalty: float) -> torch.Tensor:
        """Return the least-squares loss with gradient penalty of one batch of each kind."""
        real = self.normaliser(reference).requires_grad_()
        real_score = self.network(real)
        fake_score = self.network(self.normaliser(policy))
        fit = 0.5 * (((real_score - 1) ** 2).mean() + ((fake_score + 1) ** 2).mean())
        (gradient,) = torch.autograd.grad(real_score.sum(), real, create_graph=True)
        return fit + penalty * (gradient**2).sum(dim=-1).mean()


def style_value(score: torch.Tensor) -> torch.Tensor:
    """Return the style reward in [0, 1] of discriminator scores: max(0, 1 - (d - 1)² / 4)."""
    return (1 - 0.25 * (score - 1) ** 2).clamp(min=0)


class AmpPPO(PPO):
    """PPO with a style reward; observations carry the groups `style` (windows) and `style_mask`."""

    def __init__(self, *args: Any, reference: torch.Tensor, amp: AmpOptions, **kwargs: Any) -> None:
        """Build PPO and the discriminator.

        Args:
            reference: Windows of the reference motions, (m, 5 · 23 + phases) [rad], oldest frame first,
                grouped by phase.
        """
        super().__init__(*args, **kwargs)
        self.amp = amp
        self.reference = reference.to(self.device)
        self.discriminator = Discriminator(reference.shape[1], amp.hidden).to(self.device)
        self.amp_optimiser = torch.optim.AdamW(
            self.discriminator.parameters(), lr=amp.learning_rate, weight_decay=amp.weight_decay
        )
        self.style_reward = torch.zeros((), device=self.device)
        """Mean style reward of the last step, of those that pushed, for logs."""
        self.mean_actor = mean_actor(self._raw_actor)

    def process_env_step(self, obs: Any, rewards: torch.Tensor, dones: torch.Tensor, extras: Any) -> None:
        """Add the style reward and record the step."""
        if self.amp.weight > 0:
            mask = obs["style_mask"].squeeze(-1)
            with torch.no_grad():
                style = style_value(self.discriminator(obs["style"])) * mask
            self.style_reward = style.sum() / mask.sum().clamp(min=1)
            rewards = rewards + self.amp.weight * CONTROL_PERIOD * style
        super().process_env_step(obs, rewards, dones, extras)

    def update(self) -> dict[str, float]:
        """Update the discriminator from the rollout, then PPO."""
        losses = self._update_discriminator() if self.amp.weight > 0 else {}
        losses |= super().update()
        if self.is_multi_gpu:
            for model in (self._raw_actor, self._raw_critic):
                average_normaliser(model.obs_normalizer)
        with torch.inference_mode():  # in which rsl_rl updates the normalisers
            self.mean_actor.update_parameters(self._raw_actor)
        return losses

    def _update_discriminator(self) -> dict[str, float]:
        pushing = self.storage.observations["style_mask"].flatten().nonzero().squeeze(-1)
        # Every process must take part in every averaging, so an empty one learns from any window.
        if len(pushing) == 0:
            pushing = torch.zeros(1, dtype=torch.long, device=self.device)
        windows = self.storage.observations["style"].flatten(0, 1)
        scores = torch.zeros(3, device=self.device)
        for _ in range(self.amp.updates):
            chosen = pushing[torch.randint(len(pushing), (self.amp.batch,), device=self.device)]
            scores += self._teach(windows[chosen])
        names = ("discriminator", "policy_score", "reference_score")
        return dict(zip(names, (scores / self.amp.updates).tolist(), strict=True))

    def _teach(self, policy: torch.Tensor) -> torch.Tensor:
        """Take one step from windows of the policy; return the loss and the mean scores of policy and reference, (3,)."""
        real = self._like(policy)
        policy, real = self._shaken(policy), self._shaken(real)
        self.discriminator.normaliser.update(torch.cat((policy, real)))
        loss = self.discriminator.loss(real, policy, self.amp.gradient_penalty)
        self.amp_optimiser.zero_grad()
        loss.backward()
        average_gradients(self.discriminator)
        self.amp_optimiser.step()
        with torch.no_grad():
            return torch.stack((loss, self.discriminator(policy).mean(), self.discriminator(real).mean()))

    def _shaken(self, windows: torch.Tensor) -> torch.Tensor:
        """Return windows with noise on their joint angles; the phase's numbers stay."""
        joints = windows.shape[1] - self.amp.phases
        return windows + self.amp.jitter * torch.randn_like(windows) * (
            torch.arange(windows.shape[1], device=windows.device) < joints
        )

    def _like(self, policy: torch.Tensor) -> torch.Tensor:
        """Return as many reference windows as those of the policy, of the same phases."""
        kinds = self.amp.phases
        if kinds == 0:
            return self.reference[torch.randint(len(self.reference), (len(policy),), device=self.device)]
        count = self.reference[:, -kinds:].sum(dim=0)  # the reference is grouped by phase
        first = count.cumsum(0) - count
        which = policy[:, -kinds:].argmax(dim=-1)
        chosen = first[which] + torch.floor(count[which] * torch.rand(len(policy), device=self.device))
        return self.reference[chosen.long().clamp(max=len(self.reference) - 1)]

    def save(self) -> dict[str, Any]:
        """Return everything that a resumed run needs."""
        return super().save() | {
            "discriminator": self.discriminator.state_dict(),
            "amp_optimiser": self.amp_optimiser.state_dict(),
            "mean_actor": self.mean_actor.state_dict(),
        }

    def judges_alike(self, loaded_dict: dict[str, Any]) -> bool:
        """Return whether a saved discriminator takes windows of the same size."""
        name = "normaliser.mean"
        return loaded_dict["discriminator"][name].shape == self.discriminator.state_dict()[name].shape

    def load(self, loaded_dict: dict[str, Any], load_cfg: dict[str, Any] | None, strict: bool) -> bool:
        """Restore the content of `save`; missing parts start afresh.

        A fresh optimiser of PPO starts at the least rate: the first steps of Adam are as long as the rate, on
        every weight. At 1e-3 one iteration left `black` with 42 falls a minute instead of 1.
        """
        if "discriminator" in loaded_dict:
            self.discriminator.load_state_dict(loaded_dict["discriminator"], strict=strict)
        if "amp_optimiser" in loaded_dict:
            self.amp_optimiser.load_state_dict(loaded_dict["amp_optimiser"])
        if "optimizer_state_dict" not in loaded_dict:
            load_cfg = {"actor": True, "critic": True, "iteration": True}
            self.learning_rate = LEAST_RATE
            for group in self.optimizer.param_groups:
                group["lr"] = LEAST_RATE
        loaded = super().load(loaded_dict, load_cfg, strict)
        if "mean_actor" in loaded_dict:
            self.mean_actor.load_state_dict(loaded_dict["mean_actor"], strict=strict)
        return loaded

    def begin_anew(self, std: float) -> None:
        """Let the mean of the actor forget an earlier run; let actions deviate by `std` unless it is 0."""
        distribution = self._raw_actor.distribution
        if std > 0 and isinstance(distribution, GaussianDistribution):
            with torch.no_grad():
                distribution.std_param.fill_(std)
        self.mean_actor.module.load_state_dict(self._raw_actor.state_dict())
        self.mean_actor.n_averaged.zero_()

    def broadcast_parameters(self) -> None:
        """Give all processes the weights of the first."""
        super().broadcast_parameters()
        for tensor in self.discriminator.state_dict().values():
            torch.distributed.broadcast(tensor, src=0)


def average_over_processes(tensor: torch.Tensor) -> None:
    """Replace a tensor by its mean over all processes; unchanged with one process."""
    if torch.distributed.is_initialized():
        torch.distributed.all_reduce(tensor)
        tensor /= torch.distributed.get_world_size()


def average_gradients(module: nn.Module) -> None:
    """Average the gradients of a module over all processes, in one message."""
    if not torch.distributed.is_initialized():
        return
    gradients = [p.grad for p in module.parameters() if p.grad is not None]
    flat = torch.cat([gradient.flatten() for gradient in gradients])
    average_over_processes(flat)
    for gradient, part in zip(gradients, flat.split([g.numel() for g in gradients]), strict=True):
        gradient.copy_(part.view_as(gradient))


@torch.inference_mode()  # rsl_rl updates them in inference mode
def average_normaliser(normaliser: Any) -> None:
    """Give rsl_rl's observation normaliser the statistics of all processes pooled.

    All processes have seen equally many samples since they last agreed, so pooled moments are means.
    """
    if not torch.distributed.is_initialized() or not hasattr(normaliser, "_mean"):
        return
    moments = torch.stack((normaliser._mean, normaliser._var + normaliser._mean**2))
    average_over_processes(moments)
    normaliser._mean.copy_(moments[0])
    normaliser._var.copy_(moments[1] - moments[0] ** 2)
    normaliser._std.copy_(normaliser._var.sqrt())


def mean_actor(actor: nn.Module) -> AveragedModel:
    """Return the moving mean of an actor, normalisers too, which `update_parameters` takes a further iteration into.

    Rare situations, such as a command to stand, go well after one update and badly after the next. The mean over updates is
    steadier. It covers the same share of every run (Shamir and Zhang 2013, polynomial-decay averaging).
    """
    return AveragedModel(actor, avg_fn=_mean, use_buffers=True)


def _mean(mean: torch.Tensor, now: torch.Tensor, done: torch.Tensor | int) -> torch.Tensor:
    if not now.is_floating_point():
        return now  # a count
    return torch.lerp(mean, now, torch.as_tensor((ETA + 1) / (done + ETA + 1), dtype=now.dtype))
