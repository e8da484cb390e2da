# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""mjlab's events of the task: starts of episodes, boards, pushes (HUSKY, table of randomisation).

`sim.skate.task` draws centres of mass and the soles' friction, `sim.skate.world.posterior` the boards.
`sim.skate.mdp.worlds` draws all that the curriculum leads.
"""

from functools import partial
from typing import TYPE_CHECKING, Any

import torch
from mjlab.managers.event_manager import RecomputeLevel, requires_model_fields

from sim.board.scene import WHEELS
from sim.skate.arrays import constant
from sim.skate.cycle.start import STANDING_PLACE
from sim.skate.mdp.observations import skate_command
from sim.skate.options import SkateOptions
from sim.skate.robot import g1
from sim.skate.world.cycle import load_cycle
from sim.skate.world.posterior import FIELDS, BoardDraws, index_of
from sim.skate.world.scene import STANDING_PELVIS, deck_top, standing_height

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv


class Begin:
    """Puts robot and board into the first state of an episode and sets the cycle accordingly."""

    def __init__(self, cfg: Any, env: "ManagerBasedRlEnv") -> None:
        """Put the cycle of `options` (`SkateOptions`) on the device."""
        self._env = env
        self._options: SkateOptions = cfg.params["options"]
        place = partial(torch.tensor, dtype=torch.float, device=env.device)
        clock, pose = self._options.clock, g1.default_pose()
        self._below = place(self._options.start.chances(clock).cumsum())
        self._cycle = place(load_cycle(clock))
        self._cycle[:, 7:] += self._options.pose_offset
        height = standing_height(deck_top(env.sim.mj_model))
        self._standing = place([*STANDING_PELVIS, height, 1.0, 0.0, 0.0, 0.0, *pose])
        self._default, self._scale = place(pose), place(g1.servos().action_scale)

    def __call__(self, env: "ManagerBasedRlEnv", env_ids: torch.Tensor | None, **params: Any) -> None:
        """Let the episodes of some worlds begin, of all if None."""
        ids = slice(None) if env_ids is None else env_ids
        command, data = skate_command(env), env.sim.data
        kept = data.qpos, data.qvel, command.step, command.foot_place, command.first_action
        for values, drawn in zip(kept, self.draw(), strict=True):
            values[ids] = drawn[ids]

    def draw(self) -> tuple[torch.Tensor, ...]:
        """Draw a first state for every world; all of them, so that it is one CUDA graph whoever needs it.

        Returns:
            Positions (n, nq) and velocities (n, nv). Steps since the cycle began, (n,). Place of the right foot along the
            deck [m], (n,). The action that asks for the pose, (n, 23).
        """
        env, start = self._env, self._options.start
        command, n = skate_command(env), env.num_envs
        random = partial(torch.rand, device=env.device)
        step = torch.searchsorted(self._below, random(n), right=True).clamp(max=len(self._below) - 1)
        rolls = step > 0
        speed = torch.empty(n, device=env.device).uniform_(*start.speed) * rolls
        robot = torch.where(rolls[:, None], self._cycle[step], self._standing)
        robot[:, 2] += command.reading.axis_height * rolls
        robot[:, 1] += start.position_noise * (2 * random(n) - 1) * torch.where(rolls, 0.5, 1.0)
        place = torch.empty(n, device=env.device).uniform_(*self._options.foot_place)
        robot[:, 0] += place - torch.where(rolls, 0.0, STANDING_PLACE)
        limits = env.scene["robot"].data.joint_pos_limits
        joints = robot[:, 7:] + start.joint_noise * (2 * random(n, 23) - 1)
        robot[:, 7:] = joints.clamp(limits[..., 0], limits[..., 1])
        action = (robot[:, 7:] - self._default) / self._scale
        return *_whole(env, robot, speed), step, place, action


def _whole(
    env: "ManagerBasedRlEnv", robot: torch.Tensor, speed: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return positions and velocities of all joints, (n, nq) and (n, nv): everything rolls along x at `speed`."""
    model, reading = env.sim.mj_model, skate_command(env).reading
    qpos = constant(tuple(model.qpos0.tolist()), robot).repeat(len(robot), 1)
    qvel = torch.zeros(len(robot), model.nv, device=env.device)
    qpos[:, reading.robot.q : reading.robot.q + 7] = robot[:, :7]
    qpos[:, reading.joint_q] = robot[:, 7:]
    qvel[:, reading.robot.v] = speed
    qvel[:, reading.board.v] = speed
    for wheel in WHEELS:
        qvel[:, model.joint(f"board/{wheel}_wheel_joint").dofadr[0]] = speed / reading.wheel_radius
    return qpos, qvel


@requires_model_fields(*FIELDS, recompute=RecomputeLevel.set_const_0)
def draw_board(
    env: "ManagerBasedRlEnv", env_ids: torch.Tensor | None, draws: BoardDraws, coupled: bool
) -> None:
    """Give every world one of the boards drawn from the posterior, in turn.

    Args:
        coupled: Whether the deck steers by the equality constraints that boards are drawn with.
    """
    ids = torch.arange(env.num_envs, device=env.device) if env_ids is None else env_ids
    scene, model = env.sim.mj_model, env.sim.model
    which = ids.cpu().numpy() % len(draws.fields["jnt_stiffness"])
    for field, kind in FIELDS.items():
        names = draws.elements[kind]
        if not names or (kind == "equality" and not coupled):
            continue
        rows = torch.tensor([index_of(scene, kind, f"board/{name}") for name in names], device=env.device)
        values = torch.tensor(draws.fields[field][which], device=env.device, dtype=torch.float)
        getattr(model, field)[ids[:, None], rows] = values


def push(env: "ManagerBasedRlEnv", env_ids: torch.Tensor | None, speed: float) -> None:
    """Change the pelvis' horizontal velocity by up to ±`speed` [m/s] in each direction."""
    ids = torch.arange(env.num_envs, device=env.device) if env_ids is None else env_ids
    column = skate_command(env).reading.robot.v
    kick = speed * (2 * torch.rand(len(ids), 2, device=env.device) - 1)
    env.sim.data.qvel[ids, column : column + 2] += kick
