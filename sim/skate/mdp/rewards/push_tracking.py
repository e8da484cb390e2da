"""Pushing by tracking: the paper's baseline, which follows the reference clip nearest in speed."""

from collections.abc import Iterator
from typing import Any

from sim.skate.cycle.push_clips import PushReference
from sim.skate.mdp.rewards._base import Reward, Rewards, Task, kernel
from sim.skate.mdp.state import SkateState


def push_tracking(state: SkateState, reference: Any, tolerance: float = 0.022) -> Any:
    """The joints follow a reference clip: mean square deviation from `reference`, (n, 23), against `tolerance` [rad^2].

    The paper's baseline of pushing by tracking. The kernel is DeepMimic's (Peng et al. 2018), exp(-2 Σ Δq²), of
    23 joints. Half a push late earns 0.05 to 0.3, standing still in the push pose 0.1 to 0.35.
    """
    return kernel(((state.joint_position - reference) ** 2).mean(axis=-1), tolerance)


def _terms(task: Task) -> Iterator[Reward]:
    if task.options.pushing == "tracking":
        reference = PushReference(task.clips)

        def follow(state: SkateState) -> Any:
            return push_tracking(state, reference.joints(state.commanded_speed, state.time_in_push))

        # As much as the style reward can pay, so that the two ways of teaching compete evenly.
        yield Reward("push/tracking", follow, "push", 5.0)


REWARDS = Rewards(order=5, terms=_terms)
