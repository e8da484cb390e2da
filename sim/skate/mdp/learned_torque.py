# pyright: reportMissingImports=false, reportUntypedBaseClass=false, reportUnknownParameterType=false
"""The part of learned torques that MuJoCo has no element for, in all worlds at once.

Tendons and the damper's polynomial carry what they can (`sysid.effects.learned`); the rest is looked up before
each simulation step, as by `sim.board.learned.apply` in plain MuJoCo.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch
from mjlab.managers.action_manager import ActionTermCfg

from sim.board.learned import left_out
from sim.skate.mdp.step_term import StepTerm
from sysid.roll import Array

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv


@dataclass(kw_only=True)
class LearnedTorqueCfg(ActionTermCfg):
    """Adds what the board's scene leaves out; it takes nothing from the policy."""

    dampers: Array | None = None
    """Polynomials that stand for it in each of the boards that worlds have in turn, (m, torques, 3); the scene's own if None."""

    def build(self, env: "ManagerBasedRlEnv") -> "LearnedTorque":
        """Return the term."""
        return LearnedTorque(self, env)


class LearnedTorque(StepTerm):
    """An action of size zero that sets applied torques from grids, straight between their points."""

    def __init__(self, cfg: LearnedTorqueCfg, env: "ManagerBasedRlEnv") -> None:
        """Put the grids on the device."""
        super().__init__(cfg, env)
        self._left: list[tuple[int, int, torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]] = []
        board = torch.arange(self.num_envs, device=self.device)
        for index, (q, v, left) in enumerate(left_out(env.sim.mj_model)):
            damper = left.damper[None] if cfg.dampers is None else cfg.dampers[:, index]
            low, high, grid, damper = (
                torch.as_tensor(values, dtype=torch.float, device=self.device)
                for values in (left.low, left.high, left.torque, damper)
            )
            self._left.append((q, v, low, high, grid[None, None], damper[board % len(damper)]))

    def apply_actions(self) -> None:
        """Set the torques of this step of the simulation."""
        data: Any = self._env.sim.data
        for _, v, *_ in self._left:
            data.qfrc_applied[:, v] = 0.0
        for q, v, low, high, grid, damper in self._left:
            rate = data.qvel[:, v]
            at = 2 * (torch.stack((data.qpos[:, q], rate), dim=-1) - low) / (high - low) - 1
            torque = torch.nn.functional.grid_sample(
                grid, at.flip(-1)[None, :, None], padding_mode="border", align_corners=True
            )[0, 0, :, 0]
            speed = rate.abs()
            polynomial = torch.stack((rate, rate * speed, rate * speed * speed), dim=-1)
            data.qfrc_applied[:, v] += torque + (damper * polynomial).sum(-1)
