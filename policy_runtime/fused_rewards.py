# pyright: reportMissingImports=false, reportUntypedBaseClass=false, reportUnknownParameterType=false
"""mjlab's reward manager with all terms in one array: the same numbers in a third of the tensor operations.

mjlab weighs, cleans, sums and logs each term for itself, which at 28 terms is 196 launches on the GPU in every
step, and 84 more in every step in which an episode ends. Names, weights and what is kept for logs stay as
they are; terms are added in mjlab's order, so that even the last bit is the same.
"""

from typing import Any

import torch
from mjlab.envs import ManagerBasedRlEnv
from mjlab.managers.reward_manager import RewardManager


class FusedRewards(RewardManager):
    """All terms at once."""

    def __init__(self, cfg: Any, env: ManagerBasedRlEnv, *, scale_by_dt: bool = True) -> None:
        """Put the weights on the device; change them by `set_weight`."""
        super().__init__(cfg, env, scale_by_dt=scale_by_dt)
        weights = [term.weight for term in self._term_cfgs]
        self._weights = torch.tensor(weights, device=self.device)[:, None]
        self._sums = torch.zeros(len(weights), self.num_envs, device=self.device)
        """Sums over the episode, (terms, n)."""
        self._episode_sums = dict(zip(self._term_names, self._sums, strict=True))

    def set_weight(self, name: str, weight: float) -> None:
        """Change the weight of a term."""
        place = self._term_names.index(name)
        self._term_cfgs[place].weight = weight
        self._weights[place] = weight

    def compute(self, dt: float) -> torch.Tensor:
        """Return the sum of all weighted terms of this step, (n,)."""
        scale = dt if self._scale_by_dt else 1.0
        raw = torch.stack([term.func(self._env, **term.params) for term in self._term_cfgs])
        # What is not finite counts nothing, as in mjlab.
        values = torch.nan_to_num(raw * self._weights * scale, nan=0.0, posinf=0.0, neginf=0.0)
        self._reward_buf.zero_()
        for value in values:
            self._reward_buf += value
        self._sums += values
        self._step_reward.copy_((values / scale).T)
        return self._reward_buf

    def reset(self, env_ids: torch.Tensor | slice | None = None) -> dict[str, torch.Tensor]:
        """Return the means of the episodes that end, per second, and start their sums anew."""
        ids = slice(None) if env_ids is None else env_ids
        means = self._sums[:, ids].mean(dim=1) / self._env.max_episode_length_s
        self._sums[:, ids] = 0.0
        for term in self._class_term_cfgs:
            term.func.reset(env_ids=ids)
        return {f"Episode_Reward/{name}": mean for name, mean in zip(self._term_names, means, strict=True)}


class SkateEnv(ManagerBasedRlEnv):
    """mjlab's environment with fused rewards."""

    def load_managers(self) -> None:
        """Load all managers and exchange one."""
        super().load_managers()
        self.reward_manager = FusedRewards(self.cfg.rewards, self, scale_by_dt=self.cfg.scale_rewards_by_dt)
