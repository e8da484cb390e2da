# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""Observations of actor, critic and discriminator in mjlab.

The actor's frame comes late and with the sensors' bias where worlds differ. The critic's is true; `CriticVector` has its order.
"""

from typing import TYPE_CHECKING, Any, cast

import torch

from sim.skate import rotation
from sim.skate.arrays import wrap_angle
from sim.skate.mdp.actor_observation import FRAME_SIZE, raw_frame, scale_frame
from sim.skate.mdp.commands import SkateCommand
from sim.skate.mdp.worlds import MEMORY, worlds
from sim.skate.options import STYLE_FRAMES
from sim.skate.robot.g1 import default_pose
from sim.skate.world import contacts

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv


def skate_command(env: "ManagerBasedRlEnv") -> SkateCommand:
    """Return the task's command term."""
    return cast("SkateCommand", env.command_manager.get_term("skate"))


class ActorFrame:
    """One raw frame of the actor, (n, 78); mjlab adds noise, scale and history."""

    def __init__(self, cfg: Any, env: "ManagerBasedRlEnv") -> None:
        """Keep the default pose on the device."""
        self._worlds = worlds(env)
        self._default = torch.tensor(default_pose(), device=env.device, dtype=torch.float)

    def __call__(self, env: "ManagerBasedRlEnv") -> torch.Tensor:
        """Return the frame."""
        command = skate_command(env)
        reading = command.reading
        down = -rotation.rotate_back(reading.robot.quaternion(), self._worlds.up())
        return raw_frame(
            command.seen(),
            reading.imu("ang_vel"),
            down,
            reading.joint_position() - self._default,
            reading.joint_velocity(),
            env.action_manager.action,
            command.clock.cycle_phase(command.step)[:, None],
        )

    def reset(self, env_ids: Any = None) -> None:
        """Do nothing: there is no memory here."""


class SensedFrame(ActorFrame):
    """The frame as the sensors tell it, late and biased; called once a step."""

    def __init__(self, cfg: Any, env: "ManagerBasedRlEnv") -> None:
        """Start without a memory."""
        super().__init__(cfg, env)
        self._last = torch.zeros(MEMORY, env.num_envs, FRAME_SIZE, device=env.device)
        self._new = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)

    def __call__(self, env: "ManagerBasedRlEnv") -> torch.Tensor:
        """Return the frame."""
        frame = super().__call__(env)
        last = torch.cat((frame[None], self._last[:-1]))
        self._last.copy_(torch.where(self._new[:, None], frame, last))
        self._new.zero_()
        return self._worlds.sensed(self._last)

    def reset(self, env_ids: Any = None) -> None:
        """Fill the memory with the next frame."""
        self._new[slice(None) if env_ids is None else env_ids] = True


class CriticVector(ActorFrame):
    """The privileged vector of one step, true and without noise. New numbers go to its end: older critics lack those only."""

    def __call__(self, env: "ManagerBasedRlEnv") -> torch.Tensor:
        """Return the vector, (n, 199)."""
        command = skate_command(env)
        one = (
            command.fraction * command.transition,  # way gone
            5 * command.foot_place,  # where the right foot shall stay
            wrap_angle(command.heading_reference() - command.headings()[0]),  # still to turn by now
        )
        parts = (
            scale_frame(super().__call__(env)),
            *_guidance(command),
            *_board(command),
            *_path(command),
            *_contacts(command),
            torch.stack(command.phases, dim=-1).float(),
            torch.stack(one, dim=-1),
            self._worlds.known(),
            torch.stack((command.ground_time.clamp(max=1.0), command.speed_error()), dim=-1),
            command.still[:, None].float(),
        )
        return torch.cat(parts, dim=-1)


def joint_angles(env: "ManagerBasedRlEnv") -> torch.Tensor:
    """Return one step's input of the style discriminator: joint positions [rad], (n, 23)."""
    return skate_command(env).reading.joint_position()


def phase_one_hot(env: "ManagerBasedRlEnv") -> torch.Tensor:
    """Return one-hot whether the cycle is in pushing, mounting or dismounting, (n, 3)."""
    pushing, mounting, _, dismounting = skate_command(env).phases
    return torch.stack((pushing, mounting, dismounting), dim=-1).float()


def style_mask(env: "ManagerBasedRlEnv", pushing: bool = True, transitions: bool = False) -> torch.Tensor:
    """Return how much the style of the last five joint frames counts, (n, 1).

    It is 0 unless they are of one episode and of one phase taught by style. In pushing it falls with the error of the
    speed, else marching on the spot earns it.
    """
    command = skate_command(env)
    clock, step, before = command.clock, command.step, STYLE_FRAMES - 1
    within = (clock.pushing(step - before) & command.pushing & pushing) * command.holds_speed()
    if transitions:
        _, mounting, _, dismounting = command.phases
        mounts = clock.mounting(step - before) & mounting
        dismounts = clock.dismounting(step - before) & dismounting
        within = within + (mounts | dismounts)
    return (within * (env.episode_length_buf >= before))[:, None]


def _guidance(command: SkateCommand) -> tuple[torch.Tensor, ...]:
    reading = command.reading
    turn = command.target_heading - command.headings()[0]
    return (
        reading.imu("lin_vel"),
        torch.stack((torch.sin(turn), torch.cos(turn)), dim=-1),  # of the heading still to turn
        10 * command.tilt_reference()[:, None],
        torch.stack((10 * reading.tilt(), reading.tilt_rate()), dim=-1),
        10 * reading.trucks(),
    )


def _board(command: SkateCommand) -> tuple[torch.Tensor, ...]:
    reading = command.reading
    pelvis, board = reading.robot.quaternion(), reading.board.quaternion()
    relative = rotation.multiply(rotation.conjugate(pelvis), board)
    axes = torch.eye(3, device=board.device)
    return (
        # Place and axes in the pelvis frame, velocities in the board's.
        rotation.rotate_back(pelvis, reading.board.position() - reading.robot.position()),
        rotation.rotate(relative, axes[0]),
        rotation.rotate(relative, axes[2]),
        command.board_velocity(),
        reading.board.angular_velocity(),
        5 * reading.marker_offset().flatten(1),
    )


def _path(command: SkateCommand) -> tuple[torch.Tensor, ...]:
    positions, quaternions = command.key_bodies
    there = command.transition[:, None].float()
    angles = rotation.angle_between(quaternions, command.key_quaternions)
    return (there * (command.key_positions - positions).flatten(1), there * angles)


def _contacts(command: SkateCommand) -> tuple[torch.Tensor, ...]:
    reading = command.reading
    forces = torch.cat(
        [reading.forces(name).flatten(1) for name in (contacts.FEET_GROUND, contacts.FEET_DECK)], dim=-1
    )
    return (
        torch.sign(forces) * torch.log1p(forces.abs()),  # ground and deck on left and right foot, world frame
        reading.wheels_loaded().float(),
        command.air_time[:, None].clamp(max=1.0),
    )
