"""Pushing as the paper's baselines teach it: by tracking the reference clip nearest in speed, or by a gait clock."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from sim.skate.arrays import constant, namespace
from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.mdp.rewards._base import Clip, Reward, Rewards, Task, kernel, number
from sim.skate.mdp.state import SkateState


class PushReference:
    """All clips as one array, of the kind, precision and device of the first speeds that it is asked for.

    Each clip begins with the left foot's touchdown, where dismounting ends, and repeats without a seam.
    """

    def __init__(self, clips: Sequence[Clip]) -> None:
        """Take the clips over.

        Raises:
            ValueError: There is no clip.
        """
        if not clips:
            raise ValueError("pushing by tracking needs at least one reference clip")
        speeds, joints = zip(*clips, strict=True)
        lengths = np.array([len(one) for one in joints])
        self._arrays = np.array(speeds), lengths, np.cumsum(lengths) - lengths, np.concatenate(joints)
        self._placed: list[Any] | None = None

    def joints(self, speed: Any, time: Any) -> Any:
        """Return the joint angles of the clip whose speed is nearest [rad], shape (n, 23).

        Args:
            speed: Commanded speeds [m/s], shape (n,).
            time: Times since the pushing phase began [s], shape (n,).
        """
        xp = namespace(speed)
        if self._placed is None:
            self._placed = [constant(array, speed) for array in self._arrays]
        speeds, lengths, first, joints = self._placed
        which = xp.abs(speed[:, None] - speeds).argmin(axis=-1)
        frame = xp.round(time / CONTROL_PERIOD) % lengths[which]
        index = first[which] + frame  # whole numbers below 2^24: exact in single precision
        return joints[index.astype(int) if xp is np else index.long()]


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
