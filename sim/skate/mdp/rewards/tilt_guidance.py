"""Tilt guidance: the deck leans as the turn asks."""

from collections.abc import Iterator
from typing import Any

from sim.skate.arrays import namespace
from sim.skate.mdp.rewards._base import Reward, Rewards, Task, kernel
from sim.skate.mdp.state import SkateState


def wrong_tilt(state: SkateState, dead_zone: float = 0.03) -> Any:
    """How far the deck is tilted the wrong way [rad], where more than `dead_zone` [rad] of tilt is asked for."""
    xp = namespace(state.tilt)
    asked = xp.sign(state.tilt_reference) * (xp.abs(state.tilt_reference) > dead_zone)
    return xp.clip(-state.tilt * asked, 0.0, None)


def tilt_guide(state: SkateState, tolerance: float = 0.05) -> Any:
    """The deck is tilted as the guidance asks; `tolerance` [rad].

    The release's 0.02 pays nothing to a learner whose deck still swings by 0.1.
    """
    return kernel(namespace(state.tilt).abs(state.tilt - state.tilt_reference), tolerance)


def _terms(task: Task) -> Iterator[Reward]:
    if task.options.tilt_guidance:
        yield Reward("steer/wrong_tilt", wrong_tilt, "steer", -40.0)
        yield Reward("steer/tilt_guide", tilt_guide, "steer", 4.0)


REWARDS = Rewards(order=6, terms=_terms)
