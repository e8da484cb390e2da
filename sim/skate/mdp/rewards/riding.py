"""In every phase: the board rolls on its wheels, the robot stands where it shall and moves no more than it must."""

from collections.abc import Iterator
from typing import Any

from sim.skate.arrays import namespace
from sim.skate.mdp.rewards._base import Reward, Rewards, Task, holds_pose, kernel, number
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


def joint_limits(state: SkateState) -> Any:
    """Sum of how far joints are beyond nine tenths of their range [rad]."""
    return state.joint_excess.sum(axis=-1)


def action_rate(state: SkateState) -> Any:
    """Squared first difference of the actions."""
    return ((state.action - state.action_1) ** 2).sum(axis=-1)


def action_smoothness(state: SkateState) -> Any:
    """Squared second difference of the actions."""
    return ((state.action - 2 * state.action_1 + state.action_2) ** 2).sum(axis=-1)


def squared(state: SkateState, of: str) -> Any:
    """Sum over the joints of the square of a quantity of the state, in its SI unit."""
    return (getattr(state, of) ** 2).sum(axis=-1)


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
    standing = {"pose": tuple(default_pose().tolist()), "tolerance": 0.1}
    yield Reward("always/stand", holds_pose, "still", 1.0, standing)
    yield Reward("always/alive", alive, "always", 1.0)
    yield Reward("always/joint_limits", joint_limits, "always", -30.0, beginner=-5.0)
    yield Reward("always/action_rate", action_rate, "always", -0.05)
    yield Reward("always/action_smoothness", action_smoothness, "always", -0.05)
    for of, cost in (("joint_velocity", 1e-3), ("joint_acceleration", 2.5e-7), ("joint_torque", 1e-6)):
        yield Reward(f"always/{of}", squared, "always", -cost, {"of": of})
    yield Reward("always/self_contact", self_contact, "always", -10.0)


REWARDS = Rewards(order=3, terms=_terms)
