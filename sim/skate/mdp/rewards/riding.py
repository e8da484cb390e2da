"""In every phase: the board rolls on its wheels, the robot stands where it shall and moves no more than it must."""

from collections.abc import Iterator
from typing import Any

from sim.skate.arrays import constant, namespace
from sim.skate.mdp.rewards._base import Reward, Rewards, Task, kernel, number
from sim.skate.mdp.rewards.pushing import board_velocity, speed_error
from sim.skate.mdp.state import SkateState
from sim.skate.robot.g1 import default_pose


def wheels_on_ground(state: SkateState) -> Any:
    """1 while all four wheels touch the ground."""
    return number(state.wheel_on_ground.all(axis=-1))


def foot_place(state: SkateState, tolerance: float = 0.03) -> Any:
    """The right foot stands where it stood at the start, along the deck; `tolerance` [m].

    It creeps a little each cycle, until the board tips over its nose.
    """
    return kernel(namespace(state.tilt).abs(state.foot_place_error), tolerance) * state.foot_on_deck[..., 1]


def level_deck(state: SkateState, tolerance: float = 0.05) -> Any:
    """The deck is level while there is nothing to steer; `tolerance` [rad]."""
    return kernel(namespace(state.tilt).abs(state.tilt), tolerance)


def standing_still(state: SkateState, pose: tuple[float, ...], tolerance: float = 0.1) -> Any:
    """The joints hold the standing pose: mean square deviation [rad^2]."""
    error = state.joint_position - constant(pose, state.joint_position)
    return kernel((error**2).mean(axis=-1), tolerance)


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
    return number(state.upright == state.upright)


def _terms(task: Task) -> Iterator[Reward]:
    yield Reward("coast/board_velocity", board_velocity, "not-push", 2.0)
    yield Reward("coast/speed_error", speed_error, "not-push", -6.0, beginner=0.0)
    yield Reward("always/wheels", wheels_on_ground, "always", 0.5)
    yield Reward("always/foot_place", foot_place, "always", 12.0)
    yield Reward("always/level_deck", level_deck, "not-steer", 3.0)
    yield Reward("always/stand", standing_still, "still", 1.0, {"pose": tuple(default_pose().tolist())})
    yield Reward("always/alive", alive, "always", 1.0)
    yield Reward("always/joint_limits", joint_limits, "always", -30.0, beginner=-5.0)
    yield Reward("always/action_rate", action_rate, "always", -0.05)
    yield Reward("always/action_smoothness", action_smoothness, "always", -0.05)
    yield Reward("always/joint_velocity", joint_velocity, "always", -1e-3)
    yield Reward("always/joint_acceleration", joint_acceleration, "always", -2.5e-7)
    yield Reward("always/joint_torque", joint_torque, "always", -1e-6)
    yield Reward("always/self_contact", self_contact, "always", -10.0)


REWARDS = Rewards(order=3, terms=_terms)
