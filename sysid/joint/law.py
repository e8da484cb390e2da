"""The tilt joint as a law of motion, in physical units and continuous time."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from sysid.board import Board
from sysid.errors import HuskyError
from sysid.joint.equations import LINEAR, Structure, build_flow, steps_for, structure_of, unroll
from sysid.joint.hermite import hermite_matrix
from sysid.roll import Array

STEPS_PER_PERIOD = 120
"""RK4 steps in one natural period: the local error is then below 1e-8 of the amplitude."""


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
                (part.name, tuple(float(v) for v in vector[where])) for part, where, _ in structure.slots()
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


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A simulated release."""

    time: Array
    """Time since the release [s], shape (n,)."""
    roll: Array
    """What an angle sensor would read [rad], shape (n,)."""
    rate: Array
    """Its rate [rad/s], shape (n,)."""


def simulate(law: JointLaw, time: Array, angle: float, rate: float = 0.0, *, hold: float = 1e3) -> Trajectory:
    """Let go of the deck and watch it.

    Args:
        law: The joint.
        time: Times since the release at which to look [s], shape (n,), ascending, from 0 on.
        angle: Roll at release [rad].
        rate: Roll rate at release [rad/s].
        hold: For how long the deck was held there before [s]; only rubber that creeps remembers it.

    Raises:
        HuskyError: The motion grows without bound: the law has no stable rest there.
    """
    effects = dict(law.effects)
    if "discretisation" in effects:
        return _simulate_steps(law, time, angle, rate, effects["discretisation"][0])
    ratio = effects.get("clock", (1.0,))[0]
    flow = build_flow(law.structure, free_states=False, sensitivities=False)
    h = 2 * np.pi / law.frequency / STEPS_PER_PERIOD
    true_time = np.asarray(time, dtype=np.float64) / ratio
    steps = steps_for(float(true_time[-1]), h)
    vector = law.vector
    start = flow.begin(vector, [angle, rate], hold)
    seen = np.asarray(unroll(flow, steps)(start, np.append(vector, h)))
    if not np.all(np.isfinite(seen)):
        raise HuskyError(
            f"the simulated roll grows without bound from {np.degrees(angle):.3g} degrees: "
            "the law has no stable rest. Check the signs and sizes of its effects."
        )
    grid = seen.T.ravel()
    roll = hermite_matrix(true_time, h, steps) @ grid
    roll_rate = hermite_matrix(true_time, h, steps, slope=True) @ grid / ratio
    roll = roll + effects.get("sensor-bias", (0.0,))[0] + effects.get("sensor-drift", (0.0,))[0] * true_time
    return Trajectory(np.asarray(time), roll, roll_rate)


def _simulate_steps(law: JointLaw, time: Array, angle: float, rate: float, h: float) -> Trajectory:
    """Move as implicitfast does at step h: rate first, implicit in the damping, then roll with that rate."""
    import casadi

    from sysid.joint.equations import Mechanics

    ca: Any = casadi
    plain = replace(law, effects=tuple(item for item in law.effects if item[0] != "discretisation"))
    if plain.structure.turns or plain.structure.states:
        raise HuskyError(
            f"effect 'discretisation' together with {', '.join(plain.structure.effects)}: the plain step loop "
            "holds smooth laws without memory only. Simulate the MJCF instead (husky-sysid mjcf)."
        )
    vector = plain.vector
    y, step = ca.SX.sym("y", 2), ca.SX.sym("h")
    mechanics = Mechanics(plain.structure, ca.DM(vector))
    joint, deck = mechanics.torques(y)
    slope = -ca.jacobian(joint, y)[1]
    next_rate = y[1] + step * (joint + deck) / (mechanics.inertia + step * slope)
    move = ca.Function("move", [y, step], [ca.vertcat(y[0] + step * next_rate, next_rate)])
    count = int(float(time[-1]) / h) + 2
    path = np.column_stack([[angle, rate], np.asarray(move.mapaccum("moves", count)([angle, rate], h))])
    grid = h * np.arange(count + 1)
    return Trajectory(np.asarray(time), np.interp(time, grid, path[0]), np.interp(time, grid, path[1]))
