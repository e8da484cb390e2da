# pyright: reportMissingImports=false, reportUnknownParameterType=false, reportAttributeAccessIssue=false
"""Brings reward and termination functions into mjlab: the state is read once a step, for all of them."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import torch

from sim.skate import rotation
from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.mdp.observations import skate_command
from sim.skate.mdp.reading import ZONE
from sim.skate.mdp.rewards._base import Phase, Reward
from sim.skate.mdp.state import SkateState
from sim.skate.mdp.terminations import SETTLING_STEPS
from sim.skate.world import contacts

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv

Measured = tuple[SkateState, "dict[Phase, torch.Tensor]"]
"""The state and the phases that it lies in."""


def measured(env: "ManagerBasedRlEnv") -> Measured:
    """Return state and phases of this control step; computed at the first call of the step and kept for the others."""
    step, found = getattr(env, "_skate_state", (None, None))
    if found is None or step != env.common_step_counter:
        state = _read(env)
        found = state, _phases(state)
        keep(env, found)
    return found


def keep(env: "ManagerBasedRlEnv", found: Measured | None) -> None:
    """Take this as `measured`; None measures anew when it is next asked for."""
    env._skate_state = (env.common_step_counter, found)


def measure(env: "ManagerBasedRlEnv") -> SkateState:
    """Return the state of this control step."""
    return measured(env)[0]


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
    state, active = measured(env)
    value = reward.value(state, **reward.arguments)
    return value if reward.when == "always" else value * active[reward.when]


def not_finite(env: "ManagerBasedRlEnv") -> torch.Tensor:
    """Return where the simulation has broken down, (n,)."""
    data = env.sim.data
    return ~(torch.isfinite(data.qpos).all(dim=-1) & torch.isfinite(data.qvel).all(dim=-1))


def ends(env: "ManagerBasedRlEnv", rule: Callable[..., torch.Tensor], **arguments: Any) -> torch.Tensor:
    """Return where a rule of `terminations` ends the episode, (n,)."""
    return rule(measure(env), **arguments)


class EndsAfter:
    """Ends episodes for which the count of a rule of `terminations` exceeds a patience."""

    def __init__(self, cfg: Any, env: "ManagerBasedRlEnv") -> None:
        """Start counting at nothing."""
        self._steps = torch.zeros(env.num_envs, dtype=torch.long, device=env.device)

    def __call__(
        self, env: "ManagerBasedRlEnv", rule: Callable[..., torch.Tensor], patience: "float | torch.Tensor"
    ) -> torch.Tensor:
        """Return where it has counted more than `patience` steps, (n,)."""
        counted = self._steps.copy_(rule(measure(env), self._steps))
        return (counted > patience) & (env.episode_length_buf > SETTLING_STEPS)

    def reset(self, env_ids: Any = None) -> None:
        """Forget the steps before."""
        self._steps[slice(None) if env_ids is None else env_ids] = 0


def _read(env: "ManagerBasedRlEnv") -> SkateState:
    command, data, actions = skate_command(env), env.sim.data, env.action_manager
    reading = command.reading
    pelvis, joints = reading.robot.quaternion(), reading.joint_position()
    board_heading, robot_heading = command.headings()
    limits = env.scene["robot"].data.soft_joint_pos_limits
    positions, quaternions = reading.key_bodies_on_board()
    on_deck, on_ground = reading.marker_offset(), reading.loaded(contacts.FEET_GROUND)
    offset = on_deck.clone()
    offset[..., 0] -= command.foot_place[:, None]
    sole_velocity = reading.left_sole_velocity()
    touchdown, travel, landing_speed = command.count_strides(
        on_ground[:, 0], on_deck[:, 0, 0], sole_velocity.norm(dim=-1)
    )
    return SkateState(
        pushing=command.pushing,
        transition=command.transition,
        steering=command.phases[2],
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
        self_contacts=reading.count(contacts.SELF),
        joint_position=joints,
        joint_velocity=reading.joint_velocity(),
        joint_acceleration=data.qacc[:, reading.joint_v],
        joint_torque=data.qfrc_actuator[:, reading.joint_v],
        joint_excess=(joints - limits[..., 1]).clamp(min=0) + (limits[..., 0] - joints).clamp(min=0),
        action=actions.action,
        action_1=actions.prev_action,
        action_2=actions.prev_prev_action,
        key_position_error=(command.key_positions - positions).norm(dim=-1),
        key_orientation_error=rotation.angle_between(quaternions, command.key_quaternions),
    )
