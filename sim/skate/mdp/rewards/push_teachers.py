"""Pushing as the paper's baselines teach it: by tracking the reference clip nearest in speed, or by a gait clock."""

from collections.abc import Iterator
from typing import Any

from sim.skate.cycle.push_clips import PushReference
from sim.skate.mdp.rewards._base import Reward, Rewards, Task, kernel, number
from sim.skate.mdp.state import SkateState


def push_tracking(state: SkateState, reference: Any, tolerance: float = 0.022) -> Any:
    """The joints follow a reference clip: mean square deviation from `reference`, (n, 23), against `tolerance` [rad^2].

    The kernel is DeepMimic's (Peng et al. 2018), exp(-2 Σ Δq²), of 23 joints. Half a push late earns 0.05 to 0.3,
    standing still in the push pose 0.1 to 0.35.
    """
    return kernel(((state.joint_position - reference) ** 2).mean(axis=-1), tolerance)


def gait_clock(state: SkateState, period: float = 0.9, stance: float = 0.35) -> Any:
    """The pushing foot is on the ground in the first share `stance` of each period [s], and off it in the rest."""
    wanted = state.time_in_push % period < stance * period
    return number(wanted == state.foot_on_ground[..., 0])


def _terms(task: Task) -> Iterator[Reward]:
    if task.options.pushing == "gait":
        yield Reward("push/gait_clock", gait_clock, "push", 3.0)
    if task.options.pushing == "tracking":
        reference = PushReference(task.clips)

        def follow(state: SkateState) -> Any:
            return push_tracking(state, reference.joints(state.commanded_speed, state.time_in_push))

        # As much as the paper's style reward can pay, so that the two ways of teaching compete evenly.
        yield Reward("push/tracking", follow, "push", 5.0)


REWARDS = Rewards(order=4, terms=_terms)
