# pyright: reportMissingImports=false, reportUntypedBaseClass=false, reportUnknownParameterType=false
"""A hook before every simulation step: an mjlab action of size zero."""

from typing import TYPE_CHECKING

import torch
from mjlab.managers.action_manager import ActionTerm, ActionTermCfg

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv


class StepTerm(ActionTerm):
    """Subclasses write into the simulation in `apply_actions`."""

    def __init__(self, cfg: ActionTermCfg, env: "ManagerBasedRlEnv") -> None:
        """Take nothing."""
        super().__init__(cfg, env)
        self._nothing = torch.zeros(self.num_envs, 0, device=self.device)

    @property
    def action_dim(self) -> int:
        """Nothing is taken from the policy."""
        return 0

    @property
    def raw_action(self) -> torch.Tensor:
        """Nothing, (n, 0)."""
        return self._nothing

    def process_actions(self, actions: torch.Tensor) -> None:
        """Take nothing."""
