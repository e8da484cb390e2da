"""Which effects a joint has, and how its parameters and states are ordered."""

from collections.abc import Sequence
from dataclasses import dataclass

from sysid.effects import effect
from sysid.effects._base import Effect, SensorEffect, State, SupportEffect, TorqueEffect

LINEAR = ("inertia", "stiffness", "damping", "rest_angle")
"""The parameters that every joint has, first in every parameter vector."""


@dataclass(frozen=True, slots=True)
class Structure:
    """Which effects a joint has: all that the shape of its equations depends on."""

    effects: tuple[str, ...] = ()

    @property
    def parts(self) -> tuple[Effect, ...]:
        """The effects themselves."""
        return tuple(effect(name) for name in self.effects)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameter vector: the linear joint's, then 'effect.parameter'."""
        own = (f"{part.name}.{parameter.name}" for part in self.parts for parameter in part.parameters)
        return (*LINEAR, *own)

    @property
    def fitted(self) -> tuple[str, ...]:
        """Those that a fit may free: not the inertia, nor where a table ends."""
        ends = {f"{part.name}.{name}" for part in self.torques for name in part.support}
        return tuple(name for name in self.parameters[1:] if name not in ends)

    @property
    def states(self) -> tuple[State, ...]:
        """Internal states of all effects, in order; they follow roll and rate in the state vector."""
        return tuple(state for part in self.parts for state in part.states)

    @property
    def has_dry_friction(self) -> bool:
        """Whether something changes its branch when the rate passes through zero."""
        friction = any(part.friction is not None for part in self.torques)
        return friction or any(state.return_map is not None for state in self.states)

    @property
    def nonsmooth(self) -> bool:
        """Whether a torque has kinks besides turning points."""
        return any(part.nonsmooth for part in self.parts)

    @property
    def internal_states(self) -> tuple[State, ...]:
        """Internal states of the joint itself, which may be unknown at release; a filter starts settled."""
        return tuple(
            state for part in self.parts if not isinstance(part, SensorEffect) for state in part.states
        )

    @property
    def rough(self) -> tuple[str, ...]:
        """Parameters along which the cost is rough."""
        return tuple(f"{part.name}.{p.name}" for part in self.parts for p in part.parameters if p.rough)

    @property
    def acts_during_hold(self) -> bool:
        """Whether a hand can hold the board against more than its spring."""
        return any(isinstance(part, TorqueEffect) and part.acts_during_hold for part in self.parts)

    @property
    def torques(self) -> tuple[TorqueEffect, ...]:
        """Its effects that are torques of the joint."""
        return tuple(part for part in self.parts if isinstance(part, TorqueEffect))

    @property
    def supports(self) -> tuple[SupportEffect, ...]:
        """Compliant supports: one at most."""
        return tuple(part for part in self.parts if isinstance(part, SupportEffect))

    def layout(self) -> list[tuple[Effect, slice, slice]]:
        """Return each effect with its slices of the parameter vector and of the state vector."""
        slots: list[tuple[Effect, slice, slice]] = []
        at_parameter, at_state = len(LINEAR), 2
        for part in self.parts:
            parameters = slice(at_parameter, at_parameter + len(part.parameters))
            states = slice(at_state, at_state + len(part.states))
            slots.append((part, parameters, states))
            at_parameter, at_state = parameters.stop, states.stop
        return slots


def structure_of(effects: Sequence[str]) -> Structure:
    """Return the structure with those effects, in catalogue order, so that equal sets are one structure."""
    return Structure(tuple(sorted(effects)))
