"""The reward, one function a term (HUSKY, table of rewards).

Each takes the state and returns its value before weight and time step, shape (n,). Tolerances are those
of the published release where the paper names none. The kernels of headings, tilt and distance decay
with the error itself, as the release computes them, not with its square, as the paper prints them: far
from the goal a Gaussian is flat and tells the learner nothing.
"""

from typing import Any

from sim.skate.arrays import constant, namespace, wrap_angle
from sim.skate.mdp.state import SkateState


def _kernel(error: Any, tolerance: float) -> Any:
    """Return exp(-error / tolerance)."""
    return namespace(error).exp(-error / tolerance)


def _number(flag: Any) -> Any:
    """Return a condition as 0.0 or 1.0."""
    return flag * 1.0


# Pushing


def board_velocity(state: SkateState, tolerance: float = 0.25) -> Any:
    """The board moves forward as fast as told, neither sideways nor up; `tolerance` [m^2/s^2]."""
    velocity = state.board_velocity
    forward = state.commanded_speed - velocity[..., 0]
    return _kernel(forward**2 + velocity[..., 1] ** 2 + velocity[..., 2] ** 2, tolerance)


def facing_forward(state: SkateState, tolerance: float = 0.5) -> Any:
    """The robot faces where the board points; `tolerance` [rad]."""
    return _kernel(
        namespace(state.tilt).abs(wrap_angle(state.robot_heading - state.board_heading)), tolerance
    )


def air_time(state: SkateState, shortest: float = 0.1, longest: float = 0.5) -> Any:
    """The pushing foot swings, neither tapping nor resting: its time in the air is in between [s]."""
    return _number((state.left_air_time > shortest) & (state.left_air_time < longest))


def flat_push(state: SkateState, tolerance: float = 5e-4) -> Any:
    """The pushing foot meets the ground with its whole sole: variance of four heights below `tolerance` [m^2]."""
    heights = state.left_sole_heights
    mean = heights.mean(axis=-1)[..., None]
    variance = ((heights - mean) ** 2).sum(axis=-1) / (heights.shape[-1] - 1)
    return _number((variance < tolerance) & state.foot_on_ground[..., 0])


def gait_clock(state: SkateState, period: float = 0.9, stance: float = 0.35) -> Any:
    """The pushing foot is on the ground in the first part of each period [s] and off it in the rest.

    The paper's variant of pushing by a gait clock instead of by style; `stance` is the share on the ground.
    """
    wanted = state.time_in_push % period < stance * period
    return _number(wanted == state.foot_on_ground[..., 0])


def push_tracking(state: SkateState, reference: Any, tolerance: float = 0.022) -> Any:
    """The joints follow a reference clip: mean square deviation from `reference`, (n, 23), against `tolerance` [rad^2].

    The paper's baseline of pushing by tracking. The kernel is that of DeepMimic (Peng et al. 2018),
    exp(-2 Σ Δq²), of 23 joints: half a push late earns 0.05 to 0.3, standing still in the push pose 0.1 to 0.35.
    """
    return _kernel(((state.joint_position - reference) ** 2).mean(axis=-1), tolerance)


# Steering


def feet_on_board(state: SkateState) -> Any:
    """2 for both feet on the board in their zones, -1 for the pushing foot on the ground."""
    both = state.foot_on_deck[..., 0] & state.foot_on_deck[..., 1] & state.foot_in_zone[..., 0]
    return 2 * _number(both) - _number(state.foot_on_ground[..., 0])


def left_foot_on_deck(state: SkateState) -> Any:
    """1 while the left foot stands on the deck: right while steering, wrong while pushing."""
    return _number(state.foot_on_deck[..., 0])


def steering_pose(state: SkateState, pose: tuple[float, ...], tolerance: float = 0.2) -> Any:
    """The joints hold the steering pose: mean square deviation against `tolerance` [rad^2]."""
    error = state.joint_position - constant(pose, state.joint_position)
    return _kernel((error**2).mean(axis=-1), tolerance)


def feet_on_markers(state: SkateState, tolerance: float = 0.2) -> Any:
    """The left foot stands on the rear marker, the right one on the front marker; `tolerance` [m]."""
    return _kernel(state.foot_marker_distance.mean(axis=-1), tolerance)


def board_heading(state: SkateState, tolerance: float = 0.2) -> Any:
    """The board points where it shall by now; `tolerance` [rad]."""
    return _kernel(
        namespace(state.tilt).abs(wrap_angle(state.board_heading - state.heading_reference)), tolerance
    )


def tilt_guide(state: SkateState, tolerance: float = 0.02) -> Any:
    """The deck is tilted as the guidance asks; `tolerance` [rad]."""
    return _kernel(namespace(state.tilt).abs(state.tilt - state.tilt_reference), tolerance)


def wrong_tilt(state: SkateState, dead_zone: float = 0.03) -> Any:
    """How far the deck is tilted the wrong way [rad], where more than `dead_zone` [rad] of tilt is asked for."""
    xp = namespace(state.tilt)
    asked = xp.sign(state.tilt_reference) * (xp.abs(state.tilt_reference) > dead_zone)
    return xp.clip(-state.tilt * asked, 0.0, None)


def tilt_rate(state: SkateState) -> Any:
    """Squared rate of the tilt [rad^2/s^2]."""
    return state.tilt_rate**2


# Mounting and dismounting


def key_positions(state: SkateState, tolerance: float = 0.05) -> Any:
    """The key bodies are where the transition's path has them: mean square distance [m^2]."""
    return _kernel((state.key_position_error**2).mean(axis=-1), tolerance)


def key_orientations(state: SkateState, tolerance: float = 0.10) -> Any:
    """The key bodies are turned as the transition's path has them: mean square angle [rad^2]."""
    return _kernel((state.key_orientation_error**2).mean(axis=-1), tolerance)


def left_foot_on_ground(state: SkateState) -> Any:
    """1 while the pushing foot is on the ground (to be punished: a transition is no time to push)."""
    return _number(state.foot_on_ground[..., 0])


# Always


def wheels_on_ground(state: SkateState) -> Any:
    """1 while all four wheels touch the ground."""
    return _number(state.wheel_on_ground.all(axis=-1))


def foot_place(state: SkateState, tolerance: float = 0.05) -> Any:
    """The right foot stands where it stood at the start, along the deck; `tolerance` [m].

    What it creeps in a cycle is little, and adds up until the board tips over its nose.
    """
    return _kernel(namespace(state.tilt).abs(state.foot_place_error), tolerance) * state.foot_on_deck[..., 1]


def level_deck(state: SkateState, tolerance: float = 0.05) -> Any:
    """The deck is level while there is nothing to steer; `tolerance` [rad]."""
    return _kernel(namespace(state.tilt).abs(state.tilt), tolerance)


def standing_still(state: SkateState, pose: tuple[float, ...], tolerance: float = 0.1) -> Any:
    """The joints hold the standing pose: mean square deviation [rad^2]."""
    error = state.joint_position - constant(pose, state.joint_position)
    return _kernel((error**2).mean(axis=-1), tolerance)


def joint_limits(state: SkateState) -> Any:
    """Sum of how far joints are beyond nine tenths of their range [rad]."""
    return state.joint_excess.sum(axis=-1)


def action_rate(state: SkateState) -> Any:
    """Squared first difference of the actions."""
    return ((state.action - state.action_1) ** 2).sum(axis=-1)


def action_smoothness(state: SkateState) -> Any:
    """Squared second difference of the actions."""
    return ((state.action - 2 * state.action_1 + state.action_2) ** 2).sum(axis=-1)


def joint_velocity(state: SkateState) -> Any:
    """Squared joint velocities [rad^2/s^2]."""
    return (state.joint_velocity**2).sum(axis=-1)


def joint_acceleration(state: SkateState) -> Any:
    """Squared joint accelerations [rad^2/s^4]."""
    return (state.joint_acceleration**2).sum(axis=-1)


def joint_torque(state: SkateState) -> Any:
    """Squared joint torques [N^2*m^2]."""
    return (state.joint_torque**2).sum(axis=-1)


def self_contact(state: SkateState) -> Any:
    """Number of contacts of the robot with itself, counted up to three."""
    return namespace(state.self_contacts).clip(state.self_contacts, None, 3.0)


def alive(state: SkateState) -> Any:
    """1 in every step."""
    return _number(state.upright == state.upright)
