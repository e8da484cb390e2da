# pyright: reportMissingImports=false, reportUntypedBaseClass=false, reportUnknownParameterType=false
"""The task's actions in mjlab: delayed joint targets, and parts of the board that MuJoCo has no element for.

The latter is an action of size zero. Before each simulation step it sets the trucks from the tilt, in the direct realisation of
the coupling, as `sim.board.scene.set_trucks` does in plain MuJoCo. It also looks up the rest of learned torques that tendons
and the damper's polynomial leave out (`sysid.effects.learned`), as `sim.board.learned.apply` does.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch
from mjlab.envs.mdp.actions import JointPositionAction, JointPositionActionCfg
from mjlab.managers.action_manager import ActionTerm, ActionTermCfg

from sim.board.learned import left_out
from sim.board.scene import TILT_JOINT, TRUCK_JOINTS
from sim.skate.mdp.worlds import worlds
from sysid.roll import Array

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv


@dataclass(kw_only=True)
class BoardTermCfg(ActionTermCfg):
    """Configuration of `BoardTerm`."""

    rake: float | None = None
    """λ of tan σ = tan λ sin roll [rad]; 0 holds the trucks straight, None leaves them to the scene's constraints."""
    dampers: Array | None = None
    """Polynomials of the rate that stand for learned torques, (m, torques, 3) [N*m and rad/s].

    Worlds have these boards in turn; None for the scene's own."""

    def build(self, env: "ManagerBasedRlEnv") -> "BoardTerm":
        """Return the term."""
        return BoardTerm(self, env)


class BoardTerm(ActionTerm):
    """Sets trucks, and torques from grids, straight between their points."""

    cfg: BoardTermCfg

    def __init__(self, cfg: BoardTermCfg, env: "ManagerBasedRlEnv") -> None:
        """Find the joints and put the grids on the device."""
        super().__init__(cfg, env)
        self._nothing = torch.zeros(self.num_envs, 0, device=self.device)
        joint = env.sim.mj_model.joint
        found = [] if cfg.rake is None else [joint(f"board/{name}") for name in (TILT_JOINT, *TRUCK_JOINTS)]
        self._q, self._v = [j.qposadr[0] for j in found], [j.dofadr[0] for j in found]
        self._left: list[tuple[int, int, torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]] = []
        board = torch.arange(self.num_envs, device=self.device)
        for index, (q, v, left) in enumerate(left_out(env.sim.mj_model)):
            damper = left.damper[None] if cfg.dampers is None else cfg.dampers[:, index]
            low, high, grid, damper = (
                torch.as_tensor(values, dtype=torch.float, device=self.device)
                for values in (left.low, left.high, left.torque, damper)
            )
            self._left.append((q, v, low, high, grid[None, None], damper[board % len(damper)]))

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

    def apply_actions(self) -> None:
        """Set trucks and torques of this step of the simulation."""
        data: Any = self._env.sim.data
        if self.cfg.rake is not None:
            roll, rate = data.qpos[:, self._q[0]], data.qvel[:, self._v[0]]
            slope = math.tan(self.cfg.rake)
            angle = torch.arctan(slope * torch.sin(roll))
            data.qpos[:, self._q[1:]] = angle[:, None]
            data.qvel[:, self._v[1:]] = (rate * slope * torch.cos(roll) * torch.cos(angle) ** 2)[:, None]
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


@dataclass(kw_only=True)
class DelayedJointPositionCfg(JointPositionActionCfg):
    """mjlab's joint targets, late by every world's own delay."""

    def build(self, env: "ManagerBasedRlEnv") -> "DelayedJointPosition":
        """Return the term."""
        return DelayedJointPosition(self, env)


class DelayedJointPosition(JointPositionAction):
    """The action manager keeps the last three answers; the worlds say which of them arrives when."""

    def process_actions(self, actions: torch.Tensor) -> None:
        """Take the policy's answer, and find what reaches the servos in each step of the simulation."""
        super().process_actions(actions)
        there, manager = worlds(self._env), self._env.action_manager
        last = torch.stack((manager.action, manager.prev_action, manager.prev_prev_action))
        self._targets = there.answers(last) * self._scale + self._offset
        self._substep = 0

    def apply_actions(self) -> None:
        """Set the targets of this step of the simulation."""
        self._entity.set_joint_position_target(self._targets[self._substep], joint_ids=self._target_ids)
        self._substep += 1
