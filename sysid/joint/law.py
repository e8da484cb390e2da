"""The tilt joint as a law of motion, in physical units and continuous time."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sysid.board import Board
from sysid.joint.structure import LINEAR, Structure, structure_of
from sysid.roll import Array


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
            inertia=board.inertia.value,
            stiffness=board.stiffness,
            damping=board.damping,
            rest_angle=board.rest_angle,
            effects=tuple(
                (part.name, tuple(q.value for q in part.parameters.values())) for part in board.effects
            ),
        )

    @classmethod
    def from_vector(cls, structure: Structure, vector: Array) -> Self:
        """Return the law with the parameters of a structure, shape (p,)."""
        return cls(
            **dict(zip(LINEAR, map(float, vector), strict=False)),
            effects=tuple(
                (part.name, tuple(float(v) for v in vector[where])) for part, where, _ in structure.layout()
            ),
        )

    @property
    def structure(self) -> Structure:
        """Which effects the law has."""
        return structure_of([name for name, _ in self.effects])

    @property
    def vector(self) -> Array:
        """The parameters as the structure orders them, shape (p,)."""
        values: Mapping[str, tuple[float, ...]] = dict(self.effects)
        own = (value for name in self.structure.effects for value in values[name])
        return np.array([self.inertia, self.stiffness, self.damping, self.rest_angle, *own])

    def with_effect(self, name: str, *values: float) -> Self:
        """Return the law with one effect more, or with other values of one that it has."""
        others = tuple(item for item in self.effects if item[0] != name)
        return replace(self, effects=(*others, (name, tuple(values))))

    @property
    def frequency(self) -> float:
        """Natural frequency of the linear part, gravity included [rad/s]."""
        moment = dict(self.effects).get("gravity", (0.0,))[0]
        return float(np.sqrt(max(abs(self.stiffness + moment), 1e-9) / self.inertia))
