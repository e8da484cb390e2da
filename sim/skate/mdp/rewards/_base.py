"""A reward term: a function of the state, the phase of the cycle in which it counts, and its weight."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from sim.skate.arrays import constant, namespace
from sim.skate.options import SkateOptions
from sysid.roll import Array

Phase = Literal["push", "steer", "transition", "not-push", "not-steer", "moving", "still", "always"]
"""When a reward counts. 'not-steer' includes standing still."""


Clip = tuple[float, Array]
"""Mean speed of the pelvis in the plane [m/s], and joint angles [rad], shape (frames, 23), one frame a policy step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Inputs of weights and arguments."""

    options: SkateOptions
    """The variant of the task."""
    clips: Sequence[Clip] = ()
    """Clips that pushing by tracking follows."""


@dataclass(frozen=True, slots=True)
class Reward:
    """One term of the sum."""

    name: str
    """In curves and messages: phase/what."""
    value: Callable[..., Any]
    """Function of the state (`SkateState`) and `arguments`: the pay before weight and time step, shape (n,)."""
    when: Phase
    weight: float
    """Per second."""
    arguments: Mapping[str, Any] = field(default_factory=dict[str, Any])
    beginner: float | None = None
    """Weight for who does not ride yet, where that is another."""

    def weight_at(self, strength: float) -> float:
        """Return the weight where worlds differ by this share of their variation: its own from a quarter on."""
        first = self.weight if self.beginner is None else self.beginner
        return first + min(4 * strength, 1.0) * (self.weight - first)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rewards:
    """The terms of one file."""

    order: int
    """Files are summed from the lowest on: a sum of floats hangs on it to the last bit."""
    terms: Callable[[Task], Iterable[Reward]]
    """Those of a variant of the task."""


def kernel(error: Any, tolerance: float) -> Any:
    """Return exp(-error / tolerance)."""
    return namespace(error).exp(-error / tolerance)


def holds_pose(state: Any, pose: tuple[float, ...], tolerance: float) -> Any:
    """The joints hold a pose [rad], of 23: mean square deviation against `tolerance` [rad^2]."""
    return kernel(
        ((state.joint_position - constant(pose, state.joint_position)) ** 2).mean(axis=-1), tolerance
    )


def number(flag: Any) -> Any:
    """Return a condition as 0.0 or 1.0."""
    return flag * 1.0
