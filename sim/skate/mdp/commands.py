# pyright: reportMissingImports=false, reportUntypedBaseClass=false, reportUnknownParameterType=false
"""mjlab's command term of the task: speed and turn, and the position in the cycle."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
import torch
from mjlab.managers.command_manager import CommandTerm, CommandTermCfg

from sim.skate import rotation
from sim.skate.arrays import wrap_angle
from sim.skate.cycle.clock import CONTROL_PERIOD, STILL_SPEED
from sim.skate.cycle.tilt_guidance import TiltGuidance
from sim.skate.cycle.transitions import KEY_BODIES, TransitionPath
from sim.skate.mdp.actor_observation import still_to_turn
from sim.skate.mdp.reading import Reading
from sim.skate.mdp.worlds import worlds
from sim.skate.options import SkateOptions
from sim.skate.robot.g1 import g1_spec
from sysid.roll import Array

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv

SLOW_SPEED = 0.4
"""Largest command of a slow ride [m/s]."""
STRIDE = 0.9
"""Time over which the speed of pushing is averaged [s]: a stride of the reference clips (0.82 to 0.96 s)."""


@dataclass(kw_only=True)
class SkateCommandCfg(CommandTermCfg):
    """Commands, and the shape of the cycle."""

    options: SkateOptions
    """The variant of the task: ranges of speed and turn, shares told to stand or to go slowly, the path of transitions."""
    guidance: TiltGuidance
    ends: tuple[Array, Array]
    """Key bodies in the board frame where dismounting and where mounting ends: positions [m] (2, 14, 3), quaternions (2, 14, 4)."""
    resampling_time_range: tuple[float, float] = (1e9, 1e9)
    """mjlab draws once an episode. This term changes the speed at random times, and the turn where steering begins."""

    def build(self, env: "ManagerBasedRlEnv") -> "SkateCommand":
        """Return the term."""
        return SkateCommand(self, env)


class SkateCommand(CommandTerm):
    """Speed, relative heading, step in the cycle, and the path of the key bodies in transitions."""

    cfg: SkateCommandCfg

    def __init__(self, cfg: SkateCommandCfg, env: "ManagerBasedRlEnv") -> None:
        """Allocate everything for all environments."""
        super().__init__(cfg, env)
        n, device = self.num_envs, self.device
        self.reading = Reading(env)
        self._options = cfg.options
        self.clock = cfg.options.clock
        self._path = TransitionPath(order=cfg.options.bezier_order)
        self.step = torch.zeros(n, dtype=torch.long, device=device)
        """Steps since the cycle began, (n,)."""
        self.target_heading = torch.zeros(n, device=device)
        self._command = torch.zeros(n, 2, device=device)
        self._yaw_then = torch.zeros(n, device=device)
        """Yaw of the pelvis when the turn was told [rad], (n,)."""
        self._told = torch.zeros(n, dtype=torch.long, device=device)
        """Step at which the turn was told, (n,)."""
        self.foot_place = torch.zeros(n, device=device)
        """Wanted place of the right foot along the deck, from the front marker [m]: set by the reset, (n,)."""
        self._end_positions, self._end_quaternions = (
            torch.tensor(values, dtype=torch.float, device=device) for values in cfg.ends
        )
        # The right foot is not lifted: it carries the robot through both transitions.
        self._lifted = torch.ones(self._end_positions.shape[1], device=device)
        self._lifted[KEY_BODIES.index("right_ankle_roll_link")] = 0.0
        self._start_positions = self._end_positions[0].repeat(n, 1, 1)
        self._start_quaternions = self._end_quaternions[0].repeat(n, 1, 1)
        self.key_positions = self._start_positions.clone()
        """Wanted positions of the key bodies in the board frame [m], (n, 14, 3)."""
        self.key_quaternions = self._start_quaternions.clone()
        self.key_bodies = (self._start_positions.clone(), self._start_quaternions.clone())
        """Key bodies in the board frame: positions [m] (n, 14, 3), orientations (n, 14, 4)."""
        self.fraction = torch.zeros(n, device=device)
        """Way gone within the present transition, (n,); 0 or 1 outside one."""
        self.air_time = torch.zeros(n, device=device)
        """Time since the left foot last touched the ground [s], 0 while it does, (n,)."""
        self.ground_time = torch.zeros(n, device=device)
        """Time since the left foot came down [s], 0 while it is in the air, (n,)."""
        self.mean_speed = torch.zeros(n, device=device)
        """Speed of the board [m/s], averaged over a stride while pushing, (n,)."""
        self._sole_speed = torch.zeros(n, device=device)
        """Speed of the left sole over the ground in the last step [m/s], (n,)."""
        self._foot_range = torch.zeros(2, n, device=device)
        """Least and greatest place of the left sole along the board since it last came down [m]."""
        self.first_action = torch.zeros(n, 23, device=device)
        """The action before an episode's first: set by the reset, (n, 23)."""

    @property
    def command(self) -> torch.Tensor:
        """Commanded speed [m/s] and relative heading [rad], (n, 2)."""
        return self._command

    def seen(self) -> torch.Tensor:
        """Return the command as the actor observes it, (n, 2)."""
        if not self._options.turn_feedback:
            return self._command
        turn = still_to_turn(self._command[:, 1], self.headings()[1], self._yaw_then)
        return torch.stack((self._command[:, 0], turn), dim=-1)

    @property
    def still(self) -> torch.Tensor:
        """Whether the cycle waits because the robot is told to stand, bool (n,)."""
        return self.clock.waiting(self.step, self._stands())

    def _stands(self) -> torch.Tensor:
        return self._command[:, 0] < STILL_SPEED

    @property
    def phases(self) -> tuple[torch.Tensor, ...]:
        """Whether the cycle is in pushing, mounting, steering, dismounting, waiting or not, bool (n,) each."""
        clock, step = self.clock, self.step
        return clock.pushing(step), clock.mounting(step), clock.steering(step), clock.dismounting(step)

    @property
    def pushing(self) -> torch.Tensor:
        """Whether the robot shall push, bool (n,)."""
        return self.clock.pushing(self.step) & ~self.still

    @property
    def transition(self) -> torch.Tensor:
        """Whether the robot mounts or dismounts, bool (n,)."""
        return self.clock.mounting(self.step) | self.clock.dismounting(self.step)

    def headings(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the headings of board and robot [rad], (n,) each."""
        return rotation.yaw(self.reading.board.quaternion()), rotation.yaw(self.reading.robot.quaternion())

    def board_velocity(self) -> torch.Tensor:
        """Return the velocity of the board in its own frame [m/s], (n, 3)."""
        return rotation.rotate_back(self.reading.board.quaternion(), self.reading.board.velocity())

    def heading_reference(self, ahead: "torch.Tensor | float" = 0.0) -> torch.Tensor:
        """Return the heading on the way to the target, `ahead` [s] of this moment [rad], (n,)."""
        since = (self.step - self._told) * CONTROL_PERIOD + ahead
        still = 1 - (since / self.cfg.guidance.spread).clamp(max=1.0)
        return wrap_angle(self.target_heading - still * self._command[:, 1])

    def tilt_reference(self) -> torch.Tensor:
        """Return the tilt γ_ref that the guidance asks for [rad], (n,)."""
        guidance = self.cfg.guidance
        time = guidance.time(self.clock.steering_time_left(self.step))
        forward = self.board_velocity()[:, 0]
        return guidance.reference(self.headings()[0], self.heading_reference(time), forward, time)

    def reset(self, env_ids: torch.Tensor | slice | None) -> dict[str, float]:
        """Draw new commands, and make the first action continue the pose that the reset chose."""
        extras = super().reset(env_ids)
        self.air_time[env_ids] = 0.0
        self.ground_time[env_ids] = 0.0
        self._sole_speed[env_ids] = 0.0
        self.mean_speed[env_ids] = self.reading.board.velocity()[env_ids, 0]  # all begin along x
        # Who begins within a transition comes from the pose before it.
        pose = self.clock.dismounting(self.step).long()[env_ids]
        self._start_positions[env_ids] = self._end_positions[pose]
        self._start_positions[env_ids, :, 0] += self.foot_place[env_ids, None]
        self._start_quaternions[env_ids] = self._end_quaternions[pose]
        actions = self._env.action_manager
        for past in (actions.action, actions.prev_action, actions.prev_prev_action):
            past[env_ids] = self.first_action[env_ids]
        return extras

    def _resample_command(self, env_ids: torch.Tensor) -> None:
        drawn = self.draw()
        for kept, new in zip((self._command, self.target_heading, self._yaw_then), drawn, strict=True):
            kept[env_ids] = new[env_ids]
        self._told[env_ids] = self.step[env_ids]

    def draw(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Draw a command for every world as it stands now: command (n, 2), target heading and yaw [rad], (n,) each.

        For all of them, so that it is one CUDA graph whoever needs it.
        """
        speed, turn = self._speeds(), self._turns(torch.empty(self.num_envs, device=self.device))
        # A turn is told where steering begins; until then the course is straight on, and nothing is left of the turn before.
        turn = torch.where(self.clock.steering(self.step), turn, 0.0)
        board, robot = self.headings()
        return torch.stack((speed, turn), dim=-1), wrap_angle(board + turn), robot

    def _speeds(self) -> torch.Tensor:
        """Draw a commanded speed for every world [m/s], (n,): any, slow, or standing still."""
        options = self._options
        speed = torch.empty(self.num_envs, device=self.device).uniform_(*options.speed)
        chance, share = torch.rand(2, self.num_envs, device=self.device)
        # Standing worlds seldom fall and outlive the others. A beginner would do little else.
        led = (4 * worlds(self._env).strength).clamp(max=1.0)
        speed = torch.where(chance > 1 - led * options.slow, SLOW_SPEED * share, speed)
        return torch.where(chance < led * options.standing, STILL_SPEED * share, speed)

    def _turns(self, angles: torch.Tensor) -> torch.Tensor:
        """Draw turns to either side [rad] in place."""
        return angles.uniform_(-self._options.turn, self._options.turn)

    def compute(self, dt: float | torch.Tensor, env_ids: torch.Tensor | None = None) -> None:
        """Go on by a step. Everything that lasts is written in place, here and below, for CUDA graphs."""
        self._update_command(env_ids)

    def _update_command(self, env_ids: torch.Tensor | None) -> None:
        for kept, now in zip(self.key_bodies, self.reading.key_bodies_on_board(), strict=True):
            kept.copy_(now)
        if env_ids is None:
            begun = self._env.episode_length_buf > 0
            advances = begun & ~self.clock.waiting(self.step, self._stands())
            _put(self.step, begun, self.clock.after(self.step, self._stands()))
            changes = torch.rand(self.num_envs, device=self.device) < CONTROL_PERIOD / self._options.change
            _put(self._command[:, 0], changes & begun, self._speeds())
            self._enter_phases(advances)
        self._update_path()

    def count_strides(
        self, left_on_ground: torch.Tensor, place: torch.Tensor, speed: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Take a step with or without the left foot on the ground into account.

        Args:
            left_on_ground: Whether it is, bool (n,).
            place: Of the left foot along the board [m], (n,).
            speed: Of the left sole over the ground [m/s], (n,).

        Returns:
            Whether the foot has just come down, bool (n,). Its travel along the board since the last touchdown [m], (n,).
            Its speed over the ground one step earlier [m/s], (n,).
        """
        comes_down = left_on_ground & (self.air_time > 0)
        self.air_time.copy_(torch.where(left_on_ground, 0.0, self.air_time + CONTROL_PERIOD))
        self.ground_time.copy_(torch.where(left_on_ground, self.ground_time + CONTROL_PERIOD, 0.0))
        low, high = self._foot_range
        travel = high - low
        begins = comes_down | ~self.pushing | (self._env.episode_length_buf <= 1)
        low.copy_(torch.where(begins, place, torch.minimum(low, place)))
        high.copy_(torch.where(begins, place, torch.maximum(high, place)))
        before = self._sole_speed.clone()
        self._sole_speed.copy_(torch.nan_to_num(speed))
        return comes_down, travel, before

    def speed_error(self) -> torch.Tensor:
        """Return `mean_speed` less the commanded speed [m/s], (n,)."""
        return self.mean_speed - self._command[:, 0]

    def holds_speed(self) -> torch.Tensor:
        """Return how well `mean_speed` is the commanded one, from 0 to 1, (n,)."""
        return (-(self.speed_error() ** 2) / self._options.speed_tolerance).exp()

    def average_speed(self) -> torch.Tensor:
        """Take a step into account and return `mean_speed`: a push speeds the board up, and it slows down until the next."""
        speed = self.board_velocity()[:, 0]
        mean = self.mean_speed + CONTROL_PERIOD / STRIDE * (speed - self.mean_speed)
        begins = ~self.pushing | (self._env.episode_length_buf <= 1)
        # A world that has broken down begins anew; until then its speed is not a number.
        return self.mean_speed.copy_(torch.nan_to_num(torch.where(begins, speed, mean)))

    def _enter_phases(self, advances: torch.Tensor) -> None:
        clock, step = self.clock, self.step % self.clock.period
        leaves = advances & ((step == clock.push) | (step == clock.period - clock.dismount))
        positions, quaternions = self.key_bodies
        _put(self._start_positions, leaves[:, None, None], positions)
        _put(self._start_quaternions, leaves[:, None, None], quaternions)
        begins = advances & clock.begins_steering(step)
        turn = self._turns(torch.empty(self.num_envs, device=self.device))
        board, robot = self.headings()
        target = wrap_angle(board + turn)
        _put(self._command[:, 1], begins, turn)
        _put(self.target_heading, begins, target)
        _put(self._yaw_then, begins, robot)
        _put(self._told, begins, self.step)

    def _update_path(self) -> None:
        fraction = self.fraction.copy_(self.clock.transition_fraction(self.step))
        mounting = self.phases[1][:, None, None]
        ends = torch.where(mounting, self._end_positions[1], self._end_positions[0])
        turned = torch.where(mounting, self._end_quaternions[1], self._end_quaternions[0])
        path = self._path
        ends = torch.cat((ends[..., :1] + self.foot_place[:, None, None], ends[..., 1:]), dim=-1)
        self.key_positions.copy_(path.positions(self._start_positions, ends, fraction, self._lifted))
        self.key_quaternions.copy_(path.orientations(self._start_quaternions, turned, fraction))

    def _update_metrics(self) -> None:
        pass


def _put(kept: torch.Tensor, where: torch.Tensor, new: torch.Tensor) -> None:
    """Write new values in place where they are wanted."""
    kept.copy_(torch.where(where, new, kept))


def key_bodies_at(configurations: Sequence[Array]) -> tuple[Array, Array]:
    """Return the key bodies, positions [m] (n, 14, 3) and quaternions (n, 14, 4), of robot configurations, (30,) each."""
    model = g1_spec(visuals=False).compile()
    data = mujoco.MjData(model)
    bodies = [model.body(name).id for name in KEY_BODIES]
    positions, quaternions = [], []
    for qpos in configurations:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        positions.append(data.xpos[bodies].copy())
        quaternions.append(data.xquat[bodies].copy())
    return np.array(positions), np.array(quaternions)
