"""Integration of a joint with exact sensitivities: CasADi functions of one step, and of many."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from sysid.effects._base import SensorEffect
from sysid.joint.equations import EquationsOfMotion, items_of
from sysid.joint.sensor import filtered
from sysid.joint.structure import Structure
from sysid.roll import Array

BLOCK = 8
"""Integration steps in one call: the call costs less than one step, and at most seven steps are computed in vain."""


@dataclass(frozen=True, slots=True)
class Stepper:
    """CasADi functions of one structure."""

    initial: Any
    """(parameters, unknowns, hold) → state and sensitivities at release."""
    step: Any
    """(state and sensitivities, parameters and step) → the same one step later; output at its start."""


@cache
def build_initial(structure: Structure, *, free_states: bool, sensitivities: bool) -> Any:
    """Build (parameters, unknowns, hold) → state and sensitivities at release; kept for the life of the process.

    Args:
        free_states: Internal states at release are unknowns; else they follow from the hold before it.
        sensitivities: Of the state to fitted parameters and unknowns.
    """
    import casadi

    ca: Any = casadi
    parameters, unknowns, fitted = _symbols(structure, free_states=free_states)
    hold = ca.SX.sym("hold")
    first = _first_state(EquationsOfMotion(structure, parameters), unknowns, hold, free_states=free_states)
    slopes = [ca.vec(ca.densify(ca.jacobian(first, ca.vertcat(fitted, unknowns))))] if sensitivities else []
    return ca.Function("initial", [parameters, unknowns, hold], [ca.vertcat(first, *slopes)])


def _symbols(structure: Structure, *, free_states: bool) -> tuple[Any, Any, Any]:
    """Return parameters, unknowns of a release, and the parameters that a fit may free."""
    import casadi

    ca: Any = casadi
    parameters = ca.SX.sym("parameters", len(structure.parameters))
    unknowns = ca.SX.sym("unknowns", 2 + (len(structure.internal_states) if free_states else 0))
    free = frozenset(structure.fitted)
    fitted = parameters[[place for place, name in enumerate(structure.parameters) if name in free]]
    return parameters, unknowns, fitted


@cache
def build_stepper(structure: Structure, *, free_states: bool, sensitivities: bool) -> Stepper:
    """Build the functions of one structure; kept for the life of the process.

    Args:
        free_states: Internal states at release are unknowns; else they follow from the hold before it.
        sensitivities: Carry derivatives with respect to parameters and unknowns along.
    """
    import casadi

    ca: Any = casadi
    parameters, unknowns, fitted = _symbols(structure, free_states=free_states)
    own = unknowns.shape[0] if sensitivities else 0
    fitted = fitted if sensitivities else fitted[:0]
    h, states = ca.SX.sym("h"), len(structure.states)
    equations = EquationsOfMotion(structure, parameters)
    initial = build_initial(structure, free_states=free_states, sensitivities=sensitivities)

    y = ca.SX.sym("y", 2 + states)
    carried = ca.SX.sym("carried", 2 + states, fitted.shape[0] + own)
    given = ca.vertcat(parameters, h)

    def by_column(by_state: Any, by_fitted: Any, state: Any = carried) -> Any:  # by parameters and unknowns
        return by_state @ state + ca.horzcat(by_fitted, ca.SX(by_fitted.shape[0], own))

    accumulated, read = ca.veccat(y, carried), ca.vertcat(*filtered(equations, y))
    columns = by_column(ca.jacobian(read, y), ca.jacobian(read, fitted))
    output = ca.densify(ca.vec(ca.horzcat(read, columns).T))
    slide = ca.SX.sym("slide") if structure.has_dry_friction else None
    stepped = _rk4_slopes(equations, y, fitted, parameters, h, slide)

    if slide is None:
        whole, by_state, by_fitted, _ = stepped
        moved = ca.veccat(whole, by_column(by_state, by_fitted))
        step = ca.Function("step", [accumulated, given], ca.cse([moved, output]))
        return Stepper(initial, step)

    sliding = ca.Function("sliding", [y, given, slide], stepped)
    direction = equations.sliding(y)
    whole, by_state, by_fitted, _ = sliding(y, given, direction)
    # A cut costs two steps more and is rare: it is computed only where the joint turns.
    turns = equations.turned(y, whole, direction)
    moved, output, turns = ca.cse([ca.veccat(whole, by_column(by_state, by_fitted)), output, turns])
    uncut, follows = ca.SX.sym("uncut", *y.shape), ca.SX.sym("follows", *carried.shape)
    share = equations.turning_share(y, uncut, h)
    first = ca.vertcat(parameters, share * h), ca.sign(equations.motion(y).rate)
    top, by_state, by_fitted, by_step = sliding(y, *first)
    moves = by_column(ca.jacobian(share, y), ca.jacobian(share, fitted))
    earlier = h * (moves + ca.jacobian(share, uncut) @ follows)
    halts = ca.jacobian(equations.halted(y), y)
    at_top = halts @ (by_column(by_state, by_fitted) + by_step @ earlier)
    top, left = equations.halted(top), ca.vertcat(parameters, (1 - share) * h)
    rest, by_state, by_fitted, by_step = sliding(top, left, equations.direction(top))
    after = ca.veccat(rest, by_column(by_state, by_fitted, at_top) - by_step @ earlier)
    cut = ca.Function("cut", [accumulated, given, ca.veccat(uncut, follows)], [after])
    state, numbers, slid = (ca.MX.sym("given", *value.shape) for value in (accumulated, given, moved))
    turned = ca.MX.sym("turned")
    met = ca.if_else(turned, cut(state, numbers, slid), slid, True)
    turn = ca.Function("turn", [turned, state, numbers, slid], [met], {"never_inline": True})
    step = ca.Function("step", [accumulated, given], [turn(turns, accumulated, given, moved), output])
    return Stepper(initial, step)


def _rk4_slopes(
    equations: EquationsOfMotion, y: Any, fitted: Any, parameters: Any, h: Any, direction: Any
) -> tuple[Any, Any, Any, Any]:
    """Return the state after a step of RK4, and its slopes with the state before, with parameters and with the step.

    The slopes run backwards from the last stage. The effect of a stage's rate on the end of the step is a small matrix, which
    multiplies the many parameters once.

    Args:
        y: State, shape (n,).
        fitted: Parameters whose slopes are wanted, shape (p,).
        parameters: All of them, shape (q,).
        h: Step [s].
        direction: Sliding direction of dry friction; None without friction.
    """
    import casadi

    ca: Any = casadi
    stage, before, slide = ca.SX.sym("stage", y.shape[0]), ca.SX.sym("before"), ca.SX.sym("slide")
    tilt = equations.motion(y).tilt
    known, given = (
        [stage, before, parameters, slide],
        [tilt, parameters, 0 if direction is None else direction],
    )

    def with_slopes(name: str, value: Any) -> Any:
        slopes = [ca.jacobian(value, wanted) for wanted in (stage, before, fitted)]
        return ca.Function(name, known, [value, *slopes])

    carried = equations.slipped(stage, before)
    rate = with_slopes("rate", equations.derivative(carried, None if direction is None else slide))
    stages = [rate(y, *given)]
    for share in (h / 2, h / 2, h):
        stages.append(rate(y + share * stages[-1][0], *given))
    whole = y
    for weight, (slope, *_) in zip((h / 6, h / 3, h / 3, h / 6), reversed(stages), strict=True):
        whole = whole + weight * slope
    # Sliders move from the tilt at the start of the step to the tilt at its end.
    whole, last, by_before, by_fitted = with_slopes("end", carried)(whole, *given)
    by_state, effect, (k1, k2, k3, k4) = last, 0, (slope for slope, *_ in stages)
    by_step = last @ (k1 + 2 * k2 + 2 * k3 + k4) / 6
    for weight, share, by_h, (_, of_state, of_before, of_fitted) in zip(
        (h / 6, h / 3, h / 3, h / 6),
        (0, h, h / 2, h / 2),
        (k3, k2 / 2, k1 / 2, 0 * k1),
        reversed(stages),
        strict=True,
    ):
        effect = weight * last + share * effect
        by_before, by_fitted = by_before + effect @ of_before, by_fitted + effect @ of_fitted
        effect = effect @ of_state
        by_state, by_step = by_state + effect, by_step + effect @ by_h
    by_state = by_state + by_before @ ca.jacobian(tilt, y)
    return whole, by_state, by_fitted + by_before @ ca.jacobian(tilt, fitted), by_step


def _first_state(equations: EquationsOfMotion, unknowns: Any, hold: Any, *, free_states: bool) -> Any:
    """Return the state at release: the unknowns, and the states after the hold."""
    import casadi

    ca: Any = casadi
    m, joint = equations.m, equations.joint
    roll = unknowns[0]
    internal: list[Any] = []
    free = iter(items_of(unknowns, slice(2, unknowns.shape[0])))
    for part, values, _ in equations.layout:
        is_sensor = isinstance(part, SensorEffect)
        for state in part.states:
            if state.sensed is not None:
                internal.append(state.sensed(m, roll, unknowns[1], hold, joint, values))
            elif free_states and not is_sensor:
                internal.append(next(free))
            else:
                of = roll if is_sensor else roll - joint.rest_angle
                internal.append(state.start(m, of, hold, joint.stiffness, values))
    return ca.vertcat(unknowns[:2], *internal)


@cache
def build_block(stepper: Stepper) -> Any:
    """Return (start, parameters and step) → (the same after `BLOCK` steps, outputs at the start of each).

    The steps are unrolled: a call costs as much as a small step, and values of the parameters alone are computed once.
    """
    import casadi

    ca: Any = casadi
    start, given = ca.SX.sym("start", stepper.step.size1_in(0)), ca.SX.sym("given", stepper.step.size1_in(1))
    step, symbols, values = ca.extract_parametric(ca.vertcat(*stepper.step(start, given)), given)
    known, numbers = ca.vertcat(*symbols), ca.vertcat(*values)
    one = ca.Function("one", [start, given, known], ca.vertsplit(step, [0, start.shape[0], step.shape[0]]))
    there, seen = start, list[Any]()
    for _ in range(BLOCK):
        there, read = one(there, given, numbers)
        seen.append(read)
    return ca.Function("path", [start, given], [there, ca.vertcat(*seen)])


class Buffered:
    """A CasADi function with inputs and outputs in numpy memory, so that a call has no overhead. Not for two threads at once."""

    def __init__(self, function: Any) -> None:
        """Allocate the memory."""
        self.inputs = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
        self.outputs = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
        self._buffer, self.run = function.buffer()
        for index, values in enumerate(self.inputs):
            self._buffer.set_arg(index, values.data)
        for index, values in enumerate(self.outputs):
            self._buffer.set_res(index, values.data)


class Rollout:
    """Steps of a joint, block by block: one function serves every length."""

    def __init__(self, stepper: Stepper, steps: int, block: Buffered | None = None) -> None:
        """Allocate the buffers for a multiple of `BLOCK` steps; rollouts of one joint may share the block."""
        self._block = block or Buffered(build_block(stepper))
        self._rows = stepper.step.size1_out(1)
        self._seen = np.zeros((steps // BLOCK, BLOCK * self._rows))

    def __call__(self, start: Array, given: Array) -> Array:
        """Return reading and rate at the start of each step in turn, with their derivatives, in SI.

        Args:
            start: State and sensitivities, shape (n,).
            given: Parameters and step, shape (p + 1,).

        Returns:
            Shape (2 steps, 1 + fitted parameters + unknowns); the next call overwrites it.
        """
        run, (here, numbers), (there, read) = self._block.run, self._block.inputs, self._block.outputs
        here[:], numbers[:] = start, given
        for seen in self._seen:
            run()
            here[:], seen[:] = there, read
        return self._seen.reshape(-1, self._rows // 2)


def steps_for(duration: float, h: float) -> int:
    """Return the number of grid points that cover a duration [s] at step h [s], in whole blocks."""
    return BLOCK * -(-(int(duration / h) + 2) // BLOCK)
