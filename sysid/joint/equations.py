"""How the tilt joint moves: one integration step of its law with exact sensitivities, in CasADi.

A step is RK4. Dry friction and sliders change their branch where the rate passes through zero, so a
step in which that happens is cut there: friction holds its sign up to the turning point, decides
between sticking and going back, and the rest of the step follows. Friction therefore sticks exactly
and dissipates exactly, and the sensitivities run through the cut.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from sysid.effects import effect
from sysid.effects._base import Effect, Motion, State, Value

LINEAR = ("inertia", "stiffness", "damping", "rest_angle")
"""The parameters that every joint has, first in every parameter vector."""
_STILL = 1e-9
"""Rate below which the joint counts as standing [rad/s]."""


class CasadiAlgebra:
    """Torque laws on CasADi expressions."""

    def __init__(self) -> None:
        """Import CasADi only when a law is built."""
        import casadi

        self._casadi: Any = casadi

    def sin(self, x: Value) -> Value:
        """Sine."""
        return self._casadi.sin(x)

    def exp(self, x: Value) -> Value:
        """Exponential."""
        return self._casadi.exp(x)

    def abs(self, x: Value) -> Value:
        """Absolute value."""
        return self._casadi.fabs(x)

    def minimum(self, a: Value, b: Value) -> Value:
        """The smaller."""
        return self._casadi.fmin(a, b)

    def maximum(self, a: Value, b: Value) -> Value:
        """The larger."""
        return self._casadi.fmax(a, b)

    def where(self, condition: Value, yes: Value, no: Value) -> Value:
        """`yes` where the condition holds, else `no`."""
        return self._casadi.if_else(condition, yes, no)


@dataclass(frozen=True, slots=True)
class Structure:
    """Which effects a joint has: all that the shape of its equations depends on."""

    effects: tuple[str, ...] = ()
    extra: tuple[Effect, ...] = ()
    """Effects that are in no catalogue, such as the probes of a test."""

    @property
    def parts(self) -> tuple[Effect, ...]:
        """The effects themselves."""
        return (*(effect(name) for name in self.effects), *self.extra)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameter vector: the linear joint's, then 'effect.parameter'."""
        own = (f"{part.name}.{parameter.name}" for part in self.parts for parameter in part.parameters)
        return (*LINEAR, *own)

    @property
    def states(self) -> tuple[State, ...]:
        """Internal states of all effects, in order; they follow roll and rate in the state vector."""
        return tuple(state for part in self.parts for state in part.states)

    @property
    def turns(self) -> bool:
        """Whether something changes its branch when the rate passes through zero."""
        slides = any(part.friction is not None for part in self.parts)
        return slides or any(state.slip is not None for state in self.states)

    @property
    def kinked(self) -> bool:
        """Whether a torque bends where no turning point is."""
        return any(part.kinked for part in self.parts)

    @property
    def sharpness(self) -> float:
        """How many times the integration steps of a smooth joint it needs."""
        return max((part.sharpness for part in self.parts), default=1.0)

    @property
    def memories(self) -> tuple[State, ...]:
        """Internal states of the joint itself, which may be unknown at release; a filter starts settled."""
        return tuple(state for part in self.parts if part.role != "measurement" for state in part.states)

    def slots(self) -> list[tuple[Effect, slice, slice]]:
        """Return each effect with its slices of the parameter vector and of the state vector."""
        slots: list[tuple[Effect, slice, slice]] = []
        at_parameter, at_state = len(LINEAR), 2
        for part in self.parts:
            parameters = slice(at_parameter, at_parameter + len(part.parameters))
            states = slice(at_state, at_state + len(part.states))
            slots.append((part, parameters, states))
            at_parameter, at_state = parameters.stop, states.stop
        return slots


class Mechanics:
    """The equations of one structure for given symbolic parameters."""

    def __init__(self, structure: Structure, parameters: Any) -> None:
        """Split the parameter vector, shape (p,), among the effects."""
        import casadi

        self._ca: Any = casadi
        self.m = CasadiAlgebra()
        self.inertia, self.stiffness, self.damping, self.rest = (parameters[i] for i in range(len(LINEAR)))
        self.slots = [
            (part, dict(zip(part.parameter_names, _items(parameters, where), strict=True)), states)
            for part, where, states in structure.slots()
        ]
        for part, values, _ in self.slots:
            if part.name == "inertia":
                self.inertia = self.inertia * values["ratio"]
            if part.name == "offset":
                self.rest = self.rest + values["angle"]
        self.support = next(((v, s) for part, v, s in self.slots if part.role == "support"), None)

    def motion(self, y: Any) -> Motion:
        """Return where the joint is in state y."""
        roll, rate = y[0], y[1]
        tilt = roll - self.rest
        if self.support is not None:
            where = self.support[1].start
            tilt, rate = tilt - y[where], rate - y[where + 1]
        return Motion(tilt, rate, roll, self.stiffness)

    def torques(self, y: Any) -> tuple[Any, Any]:
        """Return (torque of the joint, torque on the deck alone) without dry friction [N*m]."""
        motion = self.motion(y)
        joint = -self.stiffness * motion.tilt - self.damping * motion.rate
        deck: Any = 0.0
        for part, values, states in self.slots:
            if part.role == "support":
                continue
            torque = part.torque(self.m, motion, values, _items(y, states))
            if part.name == "gravity":
                deck = deck + torque
            else:
                joint = joint + torque
        return joint, deck

    def friction(self, speed: Any) -> Any:
        """Return the dry friction of all effects at that speed [N*m]."""
        levels = [
            part.friction(self.m, speed, values)
            for part, values, _ in self.slots
            if part.friction is not None
        ]
        return sum(levels[1:], levels[0]) if levels else 0.0

    def derivative(self, y: Any, slide: Any) -> Any:
        """Return ẏ with dry friction against the sliding direction `slide`; 0 sticks, None is smooth."""
        motion = self.motion(y)
        joint, deck = self.torques(y)
        if slide is not None:
            joint = joint - slide * self.friction(self.m.abs(motion.rate))
        moving: Any = 1.0 if slide is None else slide * slide
        rates = [y[1] * moving, (joint + deck) / self.inertia * moving]
        for part, values, states in self.slots:
            if part.role == "support":
                s, w = _items(y, states)
                push = -values["stiffness"] * s - values["damping"] * w - joint
                rates += [w, push / values["inertia"]]
                continue
            for state, z in zip(part.states, _items(y, states), strict=True):
                rates.append(0.0 if state.rate is None else state.rate(self.m, motion, z, values))
        return self._ca.vertcat(*rates)

    def slipped(self, y: Any, tilt_before: Any) -> Any:
        """Return y with its sliders carried along from `tilt_before` to the tilt of y."""
        moved = self.motion(y).tilt - tilt_before
        items = _items(y, slice(0, y.shape[0]))
        for part, values, states in self.slots:
            for index, state in zip(range(states.start, states.stop), part.states, strict=True):
                if state.slip is not None:
                    items[index] = state.slip(self.m, items[index] + moved, values)
        return self._ca.vertcat(*items)

    def rk4(self, y: Any, h: Any, slide: Any) -> tuple[Any, Any]:
        """Return the state after one RK4 step and the derivative at its start."""
        before = self.motion(y).tilt

        def rate(stage: Any) -> Any:
            return self.derivative(self.slipped(stage, before), slide)

        k1 = rate(y)
        k2 = rate(y + h / 2 * k1)
        k3 = rate(y + h / 2 * k2)
        k4 = rate(y + h * k3)
        return self.slipped(y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), before), k1

    def direction(self, y: Any) -> Any:
        """Return where a joint that stands starts to slide: -1, +1, or 0 if friction holds it."""
        joint, deck = self.torques(y)
        torque = joint + deck
        return self._ca.if_else(self._ca.fabs(torque) > self.friction(0.0), self._ca.sign(torque), 0.0)

    def sliding_step(self, y: Any, h: Any) -> tuple[Any, Any, Any]:
        """Return (state after a step without a turn, slope of the rate at its start, whether it turned)."""
        ca = self._ca
        rate = self.motion(y).rate
        slide = ca.if_else(ca.fabs(rate) > _STILL, ca.sign(rate), self.direction(y))
        whole, start = self.rk4(y, h, slide)
        turns = ca.logic_and(slide * self.motion(whole).rate < 0, ca.fabs(rate) > _STILL)
        return whole, start[1] if self.support is None else start[1] - start[self.support[1].start + 1], turns

    def cut_step(self, y: Any, h: Any) -> Any:
        """Return the state after a step that is cut where the rate passes through zero."""
        ca = self._ca
        whole, slope, _ = self.sliding_step(y, h)
        rate, after = self.motion(y).rate, self.motion(whole).rate
        slide = ca.sign(rate)
        # Root of the parabola through the rates at both ends with the starting acceleration, as a share of h.
        slope = h * slope
        bend = after - rate - slope
        root = ca.sqrt(ca.fmax(slope**2 - 4 * bend * rate, 1e-300))
        below = -slope * slide + root
        share = ca.fmin(ca.fmax(2 * rate * slide / ca.if_else(below > 1e-30, below, 1.0), 0.0), 1.0)
        top, _ = self.rk4(y, share * h, slide)
        stopped = top[1] - self.motion(top).rate
        top = ca.vertcat(top[0], stopped, *_items(top, slice(2, top.shape[0])))
        rest, _ = self.rk4(top, (1 - share) * h, self.direction(top))
        return rest


def _items(vector: Any, where: slice) -> list[Any]:
    return [vector[index] for index in range(where.start, where.stop)]


@dataclass(frozen=True, slots=True)
class Flow:
    """CasADi functions of one structure."""

    structure: Structure
    free_states: bool
    sensitivities: bool
    begin: Any
    """(parameters, unknowns, hold) → state and sensitivities at release."""
    step: Any
    """(state and sensitivities, parameters and step) → the same one step later; output at its start."""

    @property
    def unknowns(self) -> int:
        """How many numbers each release has of its own: roll, rate and free internal states."""
        return 2 + (len(self.structure.memories) if self.free_states else 0)

    @property
    def columns(self) -> int:
        """Columns of the sensitivities: all parameters but the inertia, then the unknowns."""
        return len(self.structure.parameters) - 1 + self.unknowns if self.sensitivities else 0


@cache
def build_flow(structure: Structure, *, free_states: bool, sensitivities: bool) -> Flow:
    """Build the functions of one structure; kept for the life of the process.

    Args:
        structure: The effects.
        free_states: Internal states at release are unknowns; else they follow from the hold before it.
        sensitivities: Carry derivatives with respect to parameters and unknowns along.
    """
    import casadi

    ca: Any = casadi
    count, states = len(structure.parameters), len(structure.states)
    parameters = ca.SX.sym("parameters", count)
    unknowns = ca.SX.sym("unknowns", 2 + (len(structure.memories) if free_states else 0))
    hold, h = ca.SX.sym("hold"), ca.SX.sym("h")
    mechanics = Mechanics(structure, parameters)

    first = _first_state(mechanics, unknowns, hold, free_states=free_states)
    wanted = ca.vertcat(parameters[1:], unknowns)
    seed = ca.jacobian(first, wanted) if sensitivities else ca.SX(2 + states, 0)
    begin = ca.Function("begin", [parameters, unknowns, hold], [ca.vertcat(first, ca.vec(ca.densify(seed)))])

    y = ca.SX.sym("y", 2 + states)
    columns = wanted.shape[0] if sensitivities else 0
    carried = ca.SX.sym("carried", 2 + states, columns)
    accumulated, given = ca.vertcat(y, ca.vec(carried)), ca.vertcat(parameters, h)
    own = ca.SX(2, unknowns.shape[0])

    def with_sensitivities(following: Any) -> Any:
        if not sensitivities:
            return ca.vertcat(following, ca.vec(carried))
        by_parameter = ca.horzcat(ca.jacobian(following, parameters[1:]), ca.SX(2 + states, own.shape[1]))
        return ca.vertcat(following, ca.vec(ca.jacobian(following, y) @ carried + by_parameter))

    out = _output(structure, mechanics, y)
    seen = ca.SX(2, 0)
    if sensitivities:
        seen = ca.jacobian(out, y) @ carried + ca.horzcat(ca.jacobian(out, parameters[1:]), own)
    output = ca.densify(ca.vec(ca.horzcat(out, seen).T))
    if not structure.turns:
        following = with_sensitivities(mechanics.rk4(y, h, None)[0])
        step = ca.Function("step", [accumulated, given], ca.cse([following, output]))
        return Flow(structure, free_states, sensitivities, begin, step)

    # A cut costs three steps and is rare, so it is computed only where the joint does turn.
    whole, _, turns = mechanics.sliding_step(y, h)
    slid = ca.SX.sym("slid", accumulated.shape[0])
    slide = ca.Function("slide", [accumulated, given], ca.cse([with_sensitivities(whole), output, turns]))
    cut = with_sensitivities(mechanics.cut_step(y, h))
    turn = ca.Function.if_else(
        "turn",
        ca.Function("cut", [accumulated, given, slid], ca.cse([cut])),
        ca.Function("keep", [accumulated, given, slid], [slid]),
    )
    state, numbers = ca.MX.sym("state", accumulated.shape[0]), ca.MX.sym("numbers", given.shape[0])
    moved, read, turned = slide(state, numbers)
    step = ca.Function("step", [state, numbers], [turn(turned, state, numbers, moved), read])
    return Flow(structure, free_states, sensitivities, begin, step)


def _first_state(mechanics: Mechanics, unknowns: Any, hold: Any, *, free_states: bool) -> Any:
    """Return the state at release: what is unknown as it is, the rest as the hold left it."""
    import casadi

    ca: Any = casadi
    tilt = unknowns[0] - mechanics.rest
    internal: list[Any] = []
    free = iter(_items(unknowns, slice(2, unknowns.shape[0])))
    for part, values, _ in mechanics.slots:
        for state in part.states:
            if part.role == "measurement":
                pull = -mechanics.stiffness * tilt / mechanics.inertia
                internal.append(
                    unknowns[0] if state.late is None
                    else state.late(mechanics.m, unknowns[0], unknowns[1], pull, values)
                )  # fmt: skip
            elif free_states:
                internal.append(next(free))
            else:
                internal.append(state.start(mechanics.m, tilt, hold, mechanics.stiffness, values))
    return ca.vertcat(unknowns[:2], *internal)


def _output(structure: Structure, mechanics: Mechanics, y: Any) -> Any:
    """Return what the sensor sees and its rate, shape (2,)."""
    import casadi

    ca: Any = casadi
    for part, values, states in mechanics.slots:
        if part.name == "lowpass":
            state = part.states[0]
            assert state.rate is not None
            return ca.vertcat(
                y[states.start], state.rate(mechanics.m, mechanics.motion(y), y[states.start], values)
            )
    return ca.vertcat(y[0], y[1])


@cache
def unroll(flow: Flow, steps: int) -> Any:
    """Return (start, parameters and step) → outputs at the start of each of `steps` steps, shape (·, steps).

    An output is what the sensor sees and its derivatives, then its rate and the same.
    """
    import casadi

    ca: Any = casadi
    start, given = ca.MX.sym("start", flow.step.size1_in(0)), ca.MX.sym("given", flow.step.size1_in(1))
    _, seen = flow.step.mapaccum("path", steps)(start, ca.repmat(given, 1, steps))
    return ca.Function("path", [start, given], [seen])


def steps_for(duration: float, h: float) -> int:
    """Return how many grid points cover a duration [s] at step h, rounded up so that functions are shared."""
    wanted = int(duration / h) + 2
    return max(64, 32 * -(-wanted // 32)) if wanted > 64 else 64


def structure_of(effects: Sequence[str]) -> Structure:
    """Return the structure with those effects, in catalogue order, so that equal sets are one structure."""
    return Structure(tuple(sorted(effects)))
