"""Steering: both feet on their markers, in the pose, and where the board shall point."""

from collections.abc import Iterator
from typing import Any

from sim.skate.arrays import namespace, wrap_angle
from sim.skate.mdp.rewards._base import Reward, Rewards, Task, holds_pose, kernel, number
from sim.skate.mdp.state import SkateState
from sim.skate.robot.poses import load_poses


def feet_on_board(state: SkateState) -> Any:
    """2 for both feet on the board in their zones, -1 for the pushing foot on the ground."""
    both = state.foot_on_deck[..., 0] & state.foot_on_deck[..., 1] & state.foot_in_zone[..., 0]
    return 2 * number(both) - number(state.foot_on_ground[..., 0])


def left_foot_loaded(state: SkateState, share: float = 0.25) -> Any:
    """The left foot carries its part: load on the deck over `share` of the robot's weight, up to 1."""
    load = state.deck_load[..., 0]
    return namespace(load).clip(load / share, None, 1.0)


def feet_on_markers(state: SkateState, tolerance: float = 0.2) -> Any:
    """The left foot stands on the rear marker, the right one on the front marker; `tolerance` [m]."""
    return kernel(state.foot_marker_distance.mean(axis=-1), tolerance)


def board_heading(state: SkateState, tolerance: float = 0.2) -> Any:
    """The board points where it shall by now; `tolerance` [rad]."""
    return kernel(
        namespace(state.tilt).abs(wrap_angle(state.board_heading - state.heading_reference)), tolerance
    )


def tilt_rate(state: SkateState) -> Any:
    """Squared rate of the tilt [rad^2/s^2]."""
    return state.tilt_rate**2


def _terms(task: Task) -> Iterator[Reward]:
    pose = tuple((load_poses()["steer"][7:] + task.options.pose_offset).tolist())
    yield Reward("steer/feet_on_board", feet_on_board, "steer", 3.0)
    yield Reward("steer/pose", holds_pose, "steer", 1.5, {"pose": pose, "tolerance": 0.2})
    yield Reward("steer/left_foot", left_foot_loaded, "steer", 8.0)
    yield Reward("steer/feet_on_markers", feet_on_markers, "steer", 2.0)
    yield Reward("steer/heading", board_heading, "steer", 5.0)
    yield Reward("steer/exact_heading", board_heading, "steer", 4.0, {"tolerance": 0.05})
    yield Reward("steer/tilt_rate", tilt_rate, "steer", -0.1)
    # The actor knows the course by its yaw since the last command. Without this term each cycle turned the board to the left
    # by 0.24 to 0.5 rad. With a weight of 5 and a tolerance of 0.1 rad it was half to three quarters of that.
    yield Reward("always/course", board_heading, "not-steer", 10.0, {"tolerance": 0.3}, beginner=0.0)


REWARDS = Rewards(order=2, terms=_terms)
