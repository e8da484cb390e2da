"""Pushing by a clock: the paper's variant without style."""

from collections.abc import Iterator
from typing import Any

from sim.skate.mdp.rewards._base import Reward, Rewards, Task, number
from sim.skate.mdp.state import SkateState


def gait_clock(state: SkateState, period: float = 0.9, stance: float = 0.35) -> Any:
    """The pushing foot is on the ground in the first part of each period [s] and off it in the rest.

    The paper's variant of pushing by a gait clock instead of by style; `stance` is the share on the ground.
    """
    wanted = state.time_in_push % period < stance * period
    return number(wanted == state.foot_on_ground[..., 0])


def _terms(task: Task) -> Iterator[Reward]:
    if task.options.pushing == "gait":
        yield Reward("push/gait_clock", gait_clock, "push", 3.0)


REWARDS = Rewards(order=4, terms=_terms)
