# pyright: reportMissingImports=false, reportUntypedBaseClass=false, reportUnknownParameterType=false
"""Delay of the joint targets, as of a robot behind a network and a bus."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from mjlab.envs.mdp.actions import JointPositionAction, JointPositionActionCfg

from sim.skate.mdp.worlds import worlds

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv


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
