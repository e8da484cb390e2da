"""Laws outside the catalogue, to compare with those in it."""

from collections.abc import Callable, Sequence

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import (
    JointState,
    MujocoSupport,
    Parameter,
    Scales,
    State,
    TorqueEffect,
    belongs_to_log,
)

Torque = Callable[[Algebra, JointState, Values, Sequence[Value]], Value]


def unlisted(
    name: str, torque: Torque, parameters: Sequence[Parameter], states: Sequence[State] = ()
) -> TorqueEffect:
    """Return an effect with a torque and without texts."""
    return TorqueEffect(
        name=name, title="a law outside the catalogue", family="learned", parameters=tuple(parameters), law="", source="",
        does="", look_alikes=(), experiment="", mujoco=MujocoSupport(means="", since=""), to_mjcf=belongs_to_log,
        example=(), torque=torque, states=tuple(states),
    )  # fmt: skip


def from_zero(name: str, size: Callable[[Scales], float], rate: float) -> State:
    """Return a state that starts at zero, or free if states are free, and grows at a constant rate."""
    return State(
        name=name, size=size, start=lambda m, tilt, hold, stiffness, parameters: 0.0 * tilt,
        rate=lambda m, motion, states, parameters: rate,
    )  # fmt: skip


CLOCK = from_zero("time", lambda s: s.duration, 1.0)
