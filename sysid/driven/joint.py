"""The equation of a driven joint, and one integration step of it with exact sensitivities.

    (I + A) q̈ = τ(u, q, q̇) + b + load - d q̇ - k (q - q₀) + Σ effects - friction.

A step is RK4 with friction against its first rate. Input and load vary in a step in proportion to time. At a zero of the rate
the joint sticks or slides back within the step.
A gear with a spring or a gap makes rotor and joint two bodies. Their step is linearly implicit. Armature, damping and friction
are then the rotor's. A log of MuJoCo is moved by MuJoCo's own step instead.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np

from sysid.driven.log import InputKind
from sysid.effects import drives, effect
from sysid.effects._algebra import casadi_algebra
from sysid.effects._base import Actuation, DriveEffect, Effect, JointState, TorqueEffect
from sysid.errors import SysidError
from sysid.joint.equations import items_of, runge_kutta
from sysid.roll import Array

BASE = {
    "armature": "kg*m^2", "stiffness": "N*m/rad", "damping": "N*m*s/rad", "rest_angle": "rad", "bias": "N*m", "zero": "rad",
}  # fmt: skip
"""Parameters of every driven joint, and their units; `zero` is where the encoder reads the model's zero."""
VARYING = ("input", "by_delay", "inertia", "load", "slope", "at", "free", "damped")
"""Data that vary in a step: input, its derivative by the delay, and the rows of the model's load."""
GIVEN = ("h", "delay", *VARYING, *(f"{name} ramp" for name in VARYING))
"""Data of each step: its length, the delay of its input, then means and ramps of the varying ones."""


@dataclass(frozen=True, slots=True)
class Simulator:
    """How MuJoCo moves a joint of a model: its step, integrator and friction constraint."""

    step: float
    """[s]."""
    implicit: Literal["nothing", "joint", "actuator"]
    """Whose damping a step of Euler takes at its end; 'nothing' is RK4."""
    rate: float
    """Rate at which the friction constraint stops the joint [1/s]."""
    softness: float
    """Regularisation of the constraint over its inverse inertia [1]."""
    alone: float
    """Inertia of the joint at qpos0 with all others free, without its armature [kg*m^2]."""

    def steps(self, sampling: float) -> int:
        """Return its steps in a sampling interval [s]; 0 if they do not divide it."""
        ratio = sampling / self.step
        return round(ratio) if abs(ratio - round(ratio)) < 0.01 else 0


@dataclass(frozen=True, slots=True)
class Structure:
    """Which effects a driven joint has."""

    kind: InputKind
    effects: tuple[str, ...] = ()
    encoder: Literal["joint", "motor"] = "joint"
    """Which side of the gear the encoder measures and the servo feeds back."""
    simulator: Simulator | None = None
    """The simulator that made the log; None is nature."""

    @property
    def parts(self) -> tuple[Effect, ...]:
        """Its effects; the one that turns the input into a torque is always there."""
        return tuple(effect(name) for name in dict.fromkeys((self.source.name, *sorted(self.effects))))

    @property
    def parameters(self) -> dict[str, str]:
        """Names of all parameters in order, and their units."""
        own = {f"{part.name}.{p.name}": p.unit for part in self.parts for p in part.parameters}
        return {**BASE, **own}

    @property
    def source(self) -> DriveEffect:
        """The effect that turns the input into a torque."""
        return next(part for part in drives().values() if self.kind in part.sources)

    @property
    def gear(self) -> DriveEffect | None:
        """The effect that parts rotor and joint."""
        return next((p for p in self.parts if isinstance(p, DriveEffect) and p.transmit is not None), None)

    @property
    def delay(self) -> str:
        """Name of the parameter that is the delay of the input; '' if it is missing."""
        late = (f"{p.name}.{p.late}" for p in self.parts if isinstance(p, DriveEffect) and p.late)
        return next(late, "")

    @property
    def middle(self) -> bool:
        """Whether a step takes its load at its middle; MuJoCo's Euler takes it at its start."""
        return self.simulator is None or self.simulator.implicit == "nothing"

    @property
    def states(self) -> int:
        """Number of states: angle, rate, those of a rotor, those of effects."""
        return 2 + 2 * (self.gear is not None) + sum(len(part.states) for part in self.parts)

    def checked(self) -> "Structure":
        """Return it.

        Raises:
            SysidError: An effect acts on no driven joint, or two cannot be combined.
        """
        gears = [p.name for p in self.parts if isinstance(p, DriveEffect) and p.transmit is not None]
        for part in self.parts:
            fits = isinstance(part, DriveEffect) and (not part.sources or self.kind in part.sources)
            if not fits and not (
                isinstance(part, TorqueEffect) and part.role == "torque" and part.modifies is None
            ):
                raise SysidError(
                    f"effect '{part.name}' needs another input than a {self.kind}. Effects of an actuator: {', '.join(drives())}."
                )
            if clash := set(part.excludes) & {other.name for other in self.parts}:
                raise SysidError(
                    f"effect '{part.name}' cannot be combined with {', '.join(sorted(clash))}: leave one out."
                )
        if len(gears) > 1:
            raise SysidError(f"{' and '.join(gears)}: a joint has one gear. Leave one out.")
        return self


class Equations:
    """The equations of one structure for symbolic parameters, shape (p,)."""

    def __init__(self, structure: Structure, parameters: Any) -> None:
        """Split the parameters among the effects."""
        self.m, self.structure = casadi_algebra(), structure
        self.values = dict(
            zip(structure.parameters, items_of(parameters, slice(0, parameters.shape[0])), strict=True)
        )
        self.layout: list[tuple[Effect, dict[str, Any], slice]] = []
        at = 2 + 2 * (structure.gear is not None)
        for part in structure.parts:
            own = {p.name: self.values[f"{part.name}.{p.name}"] for p in part.parameters}
            self.layout.append((part, own, slice(at, at + len(part.states))))
            at += len(part.states)

    def motion(self, y: Any) -> JointState:
        """Return where the joint is in a state, shape (s,)."""
        tilt = y[0] - self.values["rest_angle"]
        return JointState(tilt, y[1], y[0], self.values["stiffness"])

    def actuated(self, y: Any, given: Mapping[str, Any]) -> Any:
        """Return the actuator's torque [N*m] in a state, shape (s,)."""
        motor = self.structure.encoder == "motor" and self.structure.gear is not None
        angle, rate = (y[2], y[3]) if motor else (y[0], y[1])
        late = given["input"]
        if self.structure.delay:
            late = late + given["by_delay"] * (self.values[self.structure.delay] - given["delay"])
        torque: Any = 0.0
        for part, own, _ in sorted(self.layout, key=lambda one: getattr(one[0], "stage", 0)):
            if isinstance(part, DriveEffect):
                torque = part.act(self.m, Actuation(late, torque, angle, rate), own)
        return torque

    def derivative(self, y: Any, given: Mapping[str, Any], friction: Any = 0.0) -> Any:
        """Return the state's derivative under a constant friction torque [N*m], shape (s,)."""
        import casadi

        motion, v = self.motion(y), self.values
        joint = (
            given["load"] + given["slope"] * (y[0] - v["zero"] - given["at"]) - v["stiffness"] * motion.tilt
        )
        for part, own, where in self.layout:
            if isinstance(part, TorqueEffect):
                joint = joint + part.torque(self.m, motion, own, items_of(y, where))
        motor = self.actuated(y, given) + v["bias"] - friction
        gear = self.structure.gear
        if gear is None:
            rates = [y[1], (motor + joint - v["damping"] * y[1]) / (given["inertia"] + v["armature"])]
        else:
            own = next(own for part, own, _ in self.layout if part is gear)
            assert gear.transmit is not None
            passed = gear.transmit(self.m, y[2] - y[0], y[3] - y[1], own)
            turning = (motor - v["damping"] * y[3] - passed) / v["armature"]
            rates = [y[1], (joint + passed) / given["inertia"], y[3], turning]
        for part, own, where in self.layout:
            states = items_of(y, where)
            rates += [s.rate(self.m, motion, states, own) if s.rate else 0.0 for s in part.states]
        return casadi.vertcat(*rates)

    def _implicit(self, y: Any, given: Mapping[str, Any], friction: Any, h: Any) -> Any:
        """Return the state after a linearly implicit midpoint step, which bears a stiff gear at any step; shape (s,)."""
        import casadi as ca

        rates = self.derivative(y, given, friction)
        slopes = ca.jacobian(rates, y)
        by_angle, by_rate = (
            ca.blockcat([[slopes[i, j] for j in at] for i in (1, 3)]) for at in ((0, 2), (1, 3))
        )
        v = ca.vertcat(y[1], y[3])
        matrix = ca.SX.eye(2) - h / 2 * by_rate - h * h / 4 * by_angle
        right = h * (ca.vertcat(rates[1], rates[3]) + h / 2 * by_angle @ v)
        inverse = ca.blockcat([[matrix[1, 1], -matrix[0, 1]], [-matrix[1, 0], matrix[0, 0]]])
        gained = inverse @ right / (matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0])
        q, turned = y[0] + h * (v[0] + gained[0] / 2), y[2] + h * (v[1] + gained[1] / 2)
        return ca.vertcat(q, v[0] + gained[0], turned, v[1] + gained[1], y[4:] + h * rates[4:])

    def _rubbed(self, rate: Any, slid: Any, friction: Any, rise: Any, h: Any) -> tuple[Any, Any, Any]:
        """Return whether the joint turns in a step, its rate after the step, and its way.

        The pull grows in proportion to time. Sliding ends where the rate passes through zero. Then the joint sticks, and slides
        as long as the pull exceeds the friction.

        Args:
            rate: At the start [rad/s].
            slid: At the end if the friction stayed as it was [rad/s].
            friction: Over the inertia [rad/s^2].
            rise: Of the pull over the step, over the inertia [rad/s^2].
            h: Step [s].
        """
        m = self.m
        turns, lost = rate * slid <= 0, m.where(m.abs(rate - slid) > 0, rate - slid, 1.0)
        share = rate / lost
        share = share - rise * h / 2 * share * (1 - share) / lost
        share = m.minimum(m.maximum(m.where(turns, share, 1.0), 0.0), 1.0)
        way = h * (share * rate - share**2 * (lost / 2 + rise * h * (1 / 4 - share / 6)))
        sign = m.where(rate > 0, 1.0, m.where(rate < 0, -1.0, 0.0))
        pull = (slid - rate) / h + sign * friction
        first, last, left = pull + rise * (share - 0.5), pull + rise / 2, h * (1 - share)

        def beyond(begin: Any, end: Any) -> Any:
            """Return the mean of the part of a line above zero."""
            low, high, spread = m.maximum(begin, 0.0), m.maximum(end, 0.0), end - begin
            part = (high**2 - low**2) / (2 * m.where(m.abs(spread) > 0, spread, 1.0))
            return m.where(low * high > 0, (low + high) / 2, part)

        back = beyond(first - friction, last - friction) - beyond(-first - friction, -last - friction)
        return turns, left * back, way + left**2 * back / 2

    def _level(self, y: Any, rate: Any) -> Any:
        """Return the dry friction at a state, shape (s,), and a rate of the side that rubs [N*m]."""
        level: Any = 0.0
        for part, own, _ in self.layout:
            if isinstance(part, TorqueEffect) and part.friction is not None:
                level = level + part.friction(self.m, self.motion(y).tilt, self.m.abs(rate), own)
        return level

    def _simulated(self, y: Any, given: Mapping[str, Any], simulator: Simulator) -> Any:
        """Return the state after a step of MuJoCo, shape (s,).

        Its friction constraint slows the joint at a rate of its own, by no more than the friction. So friction turns before
        the joint does, and a joint that sticks creeps (MuJoCo documentation, Computation: constraint model). The constraint
        acts on the acceleration before the damping that the step takes at its end: of this joint, and of the others.
        """
        import casadi

        h, armature = given["h"], self.values["armature"]
        inertia, free = given["inertia"] + armature, given["free"] + armature
        damped: Any = 0.0 if simulator.implicit == "nothing" else self.values["damping"]
        if simulator.implicit == "actuator":
            damped = damped - casadi.jacobian(self.actuated(y, given), y)[1]
        gives = (1 + h * damped / free) / (inertia + h * damped)
        soft = gives + simulator.softness / (simulator.alone + armature)

        def rates(stage: Any, now: Mapping[str, Any]) -> Any:
            level = self._level(stage, stage[1])
            pull = inertia * self.derivative(stage, now)[1]
            stops = (gives * pull - h * given["damped"] / free + simulator.rate * stage[1]) / soft
            friction = self.m.maximum(-level, self.m.minimum(level, stops))
            return self.derivative(stage, now, friction)

        if simulator.implicit == "nothing":
            return self._along(y, given, rates)
        slopes = rates(y, given)
        rate = y[1] + h * slopes[1] / (1 + h * damped / inertia)
        return casadi.vertcat(y[0] + h * rate, rate, y[2:] + h * slopes[2:])

    def _along(self, y: Any, given: Mapping[str, Any], rates: Callable[[Any, Mapping[str, Any]], Any]) -> Any:
        """Return the state after a step of RK4 along what varies in it, shape (s,)."""
        import casadi

        def timed(stage: Any) -> Any:
            return casadi.vertcat(rates(stage[:-1], _within(given, stage[-1])), 1 / given["h"])

        return runge_kutta(timed, casadi.vertcat(y, -0.5), given["h"])[:-1]

    def step(self, y: Any, given: Mapping[str, Any]) -> Any:
        """Return the state one step later, shape (s,), in SI."""
        import casadi

        if self.structure.simulator is not None:
            return self._simulated(y, given, self.structure.simulator)
        h, m, at = given["h"], self.m, 2 if self.structure.gear is not None else 0
        level = self._level(y, y[at + 1])
        sign = m.where(y[at + 1] > 0, 1.0, m.where(y[at + 1] < 0, -1.0, 0.0))
        if at:
            slid = self._implicit(y, given, sign * level, h)
        else:
            slid = self._along(y, given, lambda stage, now: self.derivative(stage, now, sign * level))
        items = items_of(slid, slice(0, slid.shape[0]))
        moved = slid[0] - y[0]
        for part, own, where in self.layout:
            for index, state in zip(range(where.start, where.stop), part.states, strict=True):
                if state.return_map is not None:
                    items[index] = state.return_map(m, items[index], moved, own)
        if any(isinstance(part, TorqueEffect) and part.friction is not None for part, _, _ in self.layout):
            friction = level / (self.values["armature"] + (0.0 if at else given["inertia"]))
            ends = ((1.0, slid), (-1.0, y))
            rise = 0.0 if at else sum(s * self.derivative(x, _within(given, s / 2))[1] for s, x in ends)
            turns, end, way = self._rubbed(y[at + 1], slid[at + 1], friction, rise, h)
            items[at + 1] = m.where(turns, end, slid[at + 1])
            items[at] = m.where(turns, y[at] + way, slid[at])
        return casadi.vertcat(*items)


def _within(given: Mapping[str, Any], share: Any) -> dict[str, Any]:
    """Return the data of a step at a time after its middle, as a share of the step."""
    return {**given, **{name: given[name] + share * given[f"{name} ramp"] for name in VARYING}}


@cache
def stepper(structure: Structure, free: tuple[str, ...]) -> Any:
    """Return the CasADi function (state and sensitivities, parameters and data) → the same one step later.

    Sensitivities are by the free parameters, then by the state at the start; kept for the life of the process.
    """
    import casadi as ca

    n, p = structure.states, len(structure.parameters)
    y, parameters, given = ca.SX.sym("y", n), ca.SX.sym("p", p), ca.SX.sym("w", len(GIVEN))
    known: dict[str, Any] = dict(zip(GIVEN, items_of(given, slice(0, len(GIVEN))), strict=True))
    after = Equations(structure, parameters).step(y, known)
    names = list(structure.parameters)
    carried = ca.SX.sym("s", n, len(free) + n if free else 0)
    columns = carried
    if free:
        slopes = ca.jacobian(after, ca.vertcat(y, *(parameters[names.index(name)] for name in free)))
        columns = slopes[:, :n] @ carried + ca.horzcat(slopes[:, n:], ca.SX(n, n))
    given_all, whole = ca.vertcat(parameters, given), ca.vertcat(y, ca.vec(carried))
    return ca.Function(
        "step", [whole, given_all], [ca.vertcat(after, ca.vec(ca.densify(columns)))], {"cse": True}
    )


@cache
def path_of(structure: Structure, free: tuple[str, ...], steps: int) -> Any:
    """Return the function of so many steps in a row."""
    return stepper(structure, free).mapaccum(steps)


def simulate(structure: Structure, free: tuple[str, ...], start: Array, vector: Array, given: Array) -> Array:
    """Return states and sensitivities from the start on, shape (steps + 1, s, 1 + columns), in SI.

    Args:
        start: State, shape (s,).
        vector: Parameters in the structure's order and units, shape (p,).
        given: Rows of `GIVEN` in their units, shape (18, steps).
    """
    n, columns = structure.states, len(free) + structure.states if free else 0
    begin = np.concatenate([start, np.eye(n, columns, len(free)).T.ravel() if free else []])
    inputs = np.vstack([np.repeat(vector[:, None], given.shape[1], axis=1), given])
    path = path_of(structure, free, given.shape[1])(begin, inputs).full()
    return np.hstack([begin[:, None], path]).T.reshape(-1, 1 + columns, n).transpose(0, 2, 1)


def states_after(structure: Structure, begin: Array, vector: Array, given: Array, steps: int) -> Array:
    """Return the states so many steps after each of several states, shape (s, n), in SI.

    Args:
        begin: States, shape (s, n).
        vector: As above.
        given: Rows of `GIVEN` in their units, shape (18, n steps).
    """
    inputs = np.vstack([np.repeat(vector[:, None], given.shape[1], axis=1), given])
    return path_of(structure, (), steps).map(begin.shape[1])(begin, inputs).full()[:, steps - 1 :: steps]
