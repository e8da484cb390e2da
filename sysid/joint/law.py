"""The tilt joint as a law of motion, in physical units and continuous time."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sysid.board import Board
from sysid.effects import effect
from sysid.effects._base import LinearJoint, SensorEffect, TorqueEffect
from sysid.joint.structure import LINEAR, Structure, structure_of
from sysid.roll import Array
from sysid.text import linear_law


@dataclass(frozen=True, slots=True, kw_only=True)
class JointLaw:
    """I φ̈ = -k x - d v + Σ τ, with x = φ - rest angle and v its rate."""

    inertia: float
    """Roll inertia I [kg*m^2]."""
    stiffness: float
    """Linear stiffness k [N*m/rad]."""
    damping: float
    """Linear damping d [N*m*s/rad]."""
    rest_angle: float = 0.0
    """Roll at rest [rad]."""
    effects: tuple[tuple[str, tuple[float, ...]], ...] = ()
    """Name and parameters of each effect, in the catalogue's order of parameters."""

    @classmethod
    def from_board(cls, board: Board) -> Self:
        """Return the law that a board record holds."""
        return cls(
            inertia=board.inertia.value, stiffness=board.stiffness, damping=board.damping,
            rest_angle=board.rest_angle,
            effects=tuple((e.name, tuple(q.value for q in e.parameters.values())) for e in board.effects),
        )  # fmt: skip

    @classmethod
    def from_vector(cls, structure: Structure, vector: Array) -> Self:
        """Return the law with the parameters of a structure, shape (p,), in the units of `vector`."""
        effects = ((part.name, tuple(map(float, vector[where]))) for part, where, _ in structure.layout())
        return cls(**dict(zip(LINEAR, map(float, vector), strict=False)), effects=tuple(effects))

    @property
    def structure(self) -> Structure:
        """Which effects the law has."""
        return structure_of([name for name, _ in self.effects])

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters by the structure's names."""
        return dict(zip(self.structure.parameters, map(float, self.vector), strict=True))

    @property
    def vector(self) -> Array:
        """The parameters as the structure orders them, shape (p,): I, k, d, rest angle and the effects', each in its SI unit."""
        values: Mapping[str, tuple[float, ...]] = dict(self.effects)
        own = (value for name in self.structure.effects for value in values[name])
        return np.array([self.inertia, self.stiffness, self.damping, self.rest_angle, *own])

    def with_effect(self, name: str, *values: float) -> Self:
        """Return the law with one effect more, or with other values of one that it has."""
        others = tuple(item for item in self.effects if item[0] != name)
        return replace(self, effects=(*others, (name, tuple(values))))

    def posed(self, known: Mapping[str, float]) -> Self:
        """Return the law in another pose or with another load.

        Args:
            known: Parameters that differ there, by the structure's names.
        """
        values = [known.get(name, value) for name, value in self.parameters.items()]
        return type(self).from_vector(self.structure, np.array(values)) if known else self

    @property
    def frequency(self) -> float:
        """Natural frequency at small tilts, with the stiffness of effects [rad/s]."""
        stiffness = self.stiffness + self.stiffness_of_effects
        return float(np.sqrt(max(abs(stiffness), 1e-9) / (self.inertia * self.inertia_ratio)))

    @property
    def stiffness_of_effects(self) -> float:
        """Stiffness that effects add at small tilts [N*m/rad]."""
        return sum(part.stiffness_at(self.rest_angle, values) for part, values in self._torques())

    @property
    def inertia_ratio(self) -> float:
        """Factor by which effects multiply the roll inertia [1]."""
        joint = LinearJoint(self.inertia, self.stiffness, self.damping, self.rest_angle)
        for part, values in self._torques():
            joint = joint if part.modifies is None else part.modifies(joint, values)
        return joint.inertia / self.inertia

    @property
    def inertia_gain(self) -> float:
        """Factor by which effects multiply inertia that is added to the roll inertia [1]."""
        return 2 * replace(self, inertia=2 * self.inertia).inertia_ratio - self.inertia_ratio

    @property
    def timestep(self) -> float:
        """Time step of the law's simulator [s]; 0 for a continuous law."""
        return sum(values.get(part.timestep, 0.0) for part, values in self._torques())

    def of_joint(self) -> Self:
        """Return the law without effects of the sensor or of a simulator."""
        outside = {part.name for part, _ in self._torques() if part.timestep}
        outside |= {part.name for part in self.structure.parts if isinstance(part, SensorEffect)}
        return replace(self, effects=tuple(item for item in self.effects if item[0] not in outside))

    def _torques(self) -> list[tuple[TorqueEffect, dict[str, float]]]:
        parts = ((effect(name), values) for name, values in self.effects)
        return [(part, part.named(values)) for part, values in parts if isinstance(part, TorqueEffect)]

    def __str__(self) -> str:
        """The law as it would be written on a board, e.g. '8.70e-3 φ̈ + 0.402 φ̇ + 14.68 φ + 0.15 sgn φ̇ = 0'."""
        terms = [linear_law(self.inertia, self.damping, self.stiffness, self.rest_angle)]
        terms += [term for name, values in self.effects if (term := effect(name).term(values))]
        others = [name for name, _ in self.effects if not effect(name).formula]
        return f"{' '.join(terms)} = {' + '.join(f'τ({name})' for name in others) or '0'}"
