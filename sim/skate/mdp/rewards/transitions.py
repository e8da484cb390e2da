"""Mounting and dismounting: the key bodies are where the path has them."""

from collections.abc import Iterator
from typing import Any

from sim.skate.mdp.rewards._base import Reward, Rewards, Task, kernel, number
from sim.skate.mdp.state import SkateState


def key_positions(state: SkateState, tolerance: float = 0.05) -> Any:
    """The key bodies are where the transition's path has them: mean square distance [m^2]."""
    return kernel((state.key_position_error**2).mean(axis=-1), tolerance)


def key_orientations(state: SkateState, tolerance: float = 0.10) -> Any:
    """The key bodies are turned as the transition's path has them: mean square angle [rad^2]."""
    return kernel((state.key_orientation_error**2).mean(axis=-1), tolerance)


def left_foot_on_ground(state: SkateState) -> Any:
    """1 while the pushing foot is on the ground (to be punished: a transition is no time to push)."""
    return number(state.foot_on_ground[..., 0])


def _terms(task: Task) -> Iterator[Reward]:
    guidance = task.options.transition
    if guidance in ("path", "translation"):
        yield Reward("transition/positions", key_positions, "transition", 10.0)
    if guidance != "none":
        yield Reward("transition/left_foot_down", left_foot_on_ground, "transition", -0.5)
    if guidance == "path":
        yield Reward("transition/orientations", key_orientations, "transition", 10.0)


REWARDS = Rewards(order=7, terms=_terms)
