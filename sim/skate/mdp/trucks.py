# pyright: reportMissingImports=false, reportUntypedBaseClass=false, reportUnknownParameterType=false
"""The direct realisation of the coupling in mjlab: truck angles set from the tilt in every simulation step."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import torch
from mjlab.managers.action_manager import ActionTermCfg

from sim.board.scene import TILT_JOINT, TRUCK_JOINTS
from sim.skate.mdp.step_term import StepTerm

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv


@dataclass(kw_only=True)
class TruckSetterCfg(ActionTermCfg):
    """Sets the trucks; it takes nothing from the policy."""

    rake: float
    """λ of tan σ = tan λ sin roll [rad]; 0 holds the trucks straight."""

    def build(self, env: "ManagerBasedRlEnv") -> "TruckSetter":
        """Return the term."""
        return TruckSetter(self, env)


class TruckSetter(StepTerm):
    """An action of size zero that is applied before every simulation step, as `sim.board.scene.set_trucks` is after."""

    cfg: TruckSetterCfg

    def __init__(self, cfg: TruckSetterCfg, env: "ManagerBasedRlEnv") -> None:
        """Find the joints."""
        super().__init__(cfg, env)
        model = env.sim.mj_model
        joint = model.joint(f"board/{TILT_JOINT}")
        trucks = [model.joint(f"board/{name}") for name in TRUCK_JOINTS]
        self._tilt = (joint.qposadr[0], joint.dofadr[0])
        self._trucks = ([t.qposadr[0] for t in trucks], [t.dofadr[0] for t in trucks])

    def apply_actions(self) -> None:
        """Set truck angles and their rates from the tilt's."""
        data: Any = self._env.sim.data
        roll, rate = data.qpos[:, self._tilt[0]], data.qvel[:, self._tilt[1]]
        slope = math.tan(self.cfg.rake)
        angle = torch.arctan(slope * torch.sin(roll))
        data.qpos[:, self._trucks[0]] = angle[:, None]
        data.qvel[:, self._trucks[1]] = (rate * slope * torch.cos(roll) * torch.cos(angle) ** 2)[:, None]
