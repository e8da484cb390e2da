# pyright: reportMissingImports=false, reportUnknownParameterType=false, reportAttributeAccessIssue=false
"""Brings reward and termination functions into mjlab: the state is read once a step, for all of them."""

from typing import TYPE_CHECKING, Any

import torch

from sim.skate import rotation
from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.mdp import terminations
from sim.skate.mdp.observations import skate_command
from sim.skate.mdp.reading import ZONE
from sim.skate.mdp.rewards._base import Phase, Reward
from sim.skate.mdp.state import SkateState
from sim.skate.world import contacts

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv

_SETTLING_STEPS = 5
"""Steps after a reset in which unloaded feet are no failure: the robot has only just been set down."""


def measure(env: "ManagerBasedRlEnv") -> SkateState:
    """Return the state of this control step; computed at the first call of the step and kept for the others."""
    return _measured(env)[0]


Measured = tuple[SkateState, "dict[Phase, torch.Tensor]"]
"""The state and the phases that it lies in."""


def _measured(env: "ManagerBasedRlEnv") -> Measured:
    step, measured = getattr(env, "_skate_state", (None, None))
    if measured is None or step != env.common_step_counter:
        state = _read(env)
        measured = state, _phases(state)
        keep(env, measured)
    return measured


def keep(env: "ManagerBasedRlEnv", measured: Measured | None) -> None:
    """Take this as the state of this control step; None measures anew when it is next asked for."""
    env._skate_state = (env.common_step_counter, measured)


def kept(env: "ManagerBasedRlEnv") -> Measured:
    """Return what `keep` takes: the state of this control step."""
    return _measured(env)


def _phases(state: SkateState) -> dict[Phase, torch.Tensor]:
    return {
        "push": state.pushing,
        "steer": state.steering,
        "transition": state.transition,
        "not-push": state.steering | state.transition,
        "not-steer": ~state.steering,
        "moving": ~state.still,
        "still": state.still,
    }


def pay(env: "ManagerBasedRlEnv", reward: Reward) -> torch.Tensor:
    """Return a reward's values in the phase in which it counts, zero elsewhere, (n,)."""
    state, active = _measured(env)
    value = reward.value(state, **reward.arguments)
    return value if reward.when == "always" else value * active[reward.when]


def fallen(env: "ManagerBasedRlEnv", **arguments: float) -> torch.Tensor:
    """Return `terminations.fallen`, (n,)."""
    return terminations.fallen(measure(env), **arguments)


def body_contact(env: "ManagerBasedRlEnv") -> torch.Tensor:
    """Return `terminations.body_contact`, (n,)."""
    return terminations.body_contact(measure(env))


def not_finite(env: "ManagerBasedRlEnv") -> torch.Tensor:
    """Return where the simulation has broken down, (n,)."""
    data = env.sim.data
    return ~(torch.isfinite(data.qpos).all(dim=-1) & torch.isfinite(data.qvel).all(dim=-1))


def idle_foot(env: "ManagerBasedRlEnv", patience: "float | torch.Tensor") -> torch.Tensor:
    """Return `terminations.idle_foot`, (n,)."""
    return terminations.idle_foot(measure(env), patience)


def runaway(env: "ManagerBasedRlEnv", speed: float) -> torch.Tensor:
    """Return where the board rolls faster than `speed` [m/s], as down a long slope, (n,)."""
    return measure(env).board_velocity[:, 0].abs() > speed


class OffBoard:
    """`terminations.off_board` with its memory of one step."""

    def __init__(self, cfg: Any, env: "ManagerBasedRlEnv") -> None:
        """Start with loaded feet."""
        self._unloaded = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)

    def __call__(self, env: "ManagerBasedRlEnv") -> torch.Tensor:
        """Return who has left the board, (n,)."""
        state = measure(env)
        off = terminations.off_board(state, self._unloaded)
        self._unloaded.copy_(~state.foot_on_deck.any(dim=-1))
        return off & (env.episode_length_buf > _SETTLING_STEPS)

    def reset(self, env_ids: Any = None) -> None:
        """Forget the step before."""
        self._unloaded[slice(None) if env_ids is None else env_ids] = False


class WrongStance:
    """Ends episodes whose left foot has been in the wrong place for too long; see `terminations`."""

    def __init__(self, cfg: Any, env: "ManagerBasedRlEnv") -> None:
        """Start counting at nothing."""
        self._steps = torch.zeros(env.num_envs, dtype=torch.long, device=env.device)

    def __call__(self, env: "ManagerBasedRlEnv", patience: "float | torch.Tensor") -> torch.Tensor:
        """Return where it has been more than `patience` steps, (n,)."""
        return self._steps.copy_(terminations.wrong_stance(measure(env), self._steps)) > patience

    def reset(self, env_ids: Any = None) -> None:
        """Forget the steps before."""
        self._steps[slice(None) if env_ids is None else env_ids] = 0


def _read(env: "ManagerBasedRlEnv") -> SkateState:
    command = skate_command(env)
    command.refresh()
    reading = command.reading
    pelvis = reading.robot_quaternion()
    board_heading, robot_heading = command.headings()
    joints = reading.joint_position()
    limits = env.scene["robot"].data.soft_joint_pos_limits
    offset = command.marker_offset()
    positions, quaternions = reading.key_bodies_on_board()
    on_deck = reading.marker_offset()
    on_ground = reading.loaded(contacts.FEET_GROUND)
    actions = env.action_manager
    sole_velocity = reading.left_sole_velocity()
    touchdown, travel, landing_speed = command.count_strides(
        on_ground[:, 0], on_deck[:, 0, 0], sole_velocity.norm(dim=-1)
    )
    return SkateState(
        pushing=command.pushing,
        transition=command.transition,
        steering=command.steering,
        still=command.still,
        time_in_push=(command.step % command.clock.period) * CONTROL_PERIOD,
        commanded_speed=command.command[:, 0],
        target_heading=command.target_heading,
        heading_reference=command.heading_reference(),
        tilt_reference=command.tilt_reference(),
        board_velocity=command.board_velocity(),
        mean_speed=command.average_speed(),
        board_heading=board_heading,
        robot_heading=robot_heading,
        tilt=reading.tilt(),
        tilt_rate=reading.tilt_rate(),
        upright=1 - 2 * (pelvis[:, 1] ** 2 + pelvis[:, 2] ** 2),
        foot_on_ground=on_ground,
        foot_on_deck=reading.loaded(contacts.FEET_DECK),
        ground_load=reading.load(contacts.FEET_GROUND),
        deck_load=reading.load(contacts.FEET_DECK),
        foot_in_zone=(on_deck[..., 0].abs() < ZONE[0]) & (on_deck[..., 1].abs() < ZONE[1]),
        foot_marker_distance=offset.norm(dim=-1),
        foot_place_error=reading.foot_place() - command.foot_place,
        left_air_time=command.air_time,
        left_ground_time=command.ground_time,
        left_touchdown=touchdown,
        left_landing_speed=landing_speed,
        left_travel=travel,
        left_place=on_deck[:, 0, 0],
        left_slip=sole_velocity[:, :2].norm(dim=-1),
        left_sole_heights=reading.left_sole_heights(),
        wheel_on_ground=reading.wheels_loaded(),
        other_contacts=reading.other_contacts(),
        self_contacts=reading.self_contacts(),
        joint_position=joints,
        joint_velocity=reading.joint_velocity(),
        joint_acceleration=reading.joint_acceleration(),
        joint_torque=reading.joint_torque(),
        joint_excess=(joints - limits[..., 1]).clamp(min=0) + (limits[..., 0] - joints).clamp(min=0),
        action=actions.action,
        action_1=actions.prev_action,
        action_2=actions.prev_prev_action,
        key_position_error=(command.key_positions - positions).norm(dim=-1),
        key_orientation_error=rotation.angle_between(quaternions, command.key_quaternions),
    )
