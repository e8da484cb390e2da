"""The true motion of a synthetic board: its own torque laws and its own event-driven integrator.

The integrator shares nothing with the fitted model (no CasADi, no MuJoCo), and the laws of `TrueLaw` are written out again. A
test that recovers their truth compares two independent accounts of the same physics. An effect without a formula here acts by
the catalogue's law; then the integration alone is independent.

Smooth stretches are integrated by DOP853. The integration stops at each kink or jump of a law: friction that sticks or slips, a
dead band, a stop, a slider that yields. Then it changes the mode and continues, so friction sticks and dissipates exactly. It
also stops at the knots of a hand's spline, over which a step of eighth order would miss its tolerance.

Equation of motion, with x = φ − s − rest and u = v − w: `I φ̈ = τ(x, u) − M sin φ − I' v²/2`, `I₂ s̈ = −k₂ s − d₂ w − τ(x, u)`
and `ż = u − z/T`.

Here s is the roll of a compliant support (0 without one) and z the stretch of a Maxwell arm. The internal states of the
catalogue's laws follow.
"""

import math
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.synth.hand import HandMotion
from sysid.synth.law import CatalogueLaw, Modes, TrueLaw

RTOL = 1e-8
ATOL = 1e-10
"""Tolerances of DOP853, relative and in rad: the motion is right to about 1e-8 rad, 1e-5 of a sensor's noise."""
_MAX_STEPS = 20_000
"""A few seconds of computing: a release needs some hundred steps, with hard stops some thousand."""


@dataclass(frozen=True, slots=True)
class Condition:
    """Start of a motion: state (φ, v, s, w, z, ...), shape (5 + n,), and modes."""

    state: Array
    modes: Modes

    @classmethod
    def at_rest(cls, law: TrueLaw) -> "Condition":
        """Return the condition of an untouched deck: no stretch in arm or slider."""
        roll = law.equilibrium()
        support = -law.gravity * math.sin(roll) / law.support_stiffness if law.support_inertia else 0.0
        x = roll - support - law.rest
        inner = [state for each in law.laws for state in each.at_rest()]
        return cls(np.array([roll, 0.0, support, 0.0, 0.0, *inner]), Modes(origin=x).regions(law, x))


@dataclass(slots=True)
class _Motion:
    """The hybrid system between two times: right-hand side and guards of the present modes."""

    law: TrueLaw
    modes: Modes
    hand: HandMotion | None

    def accelerations(self, time: float, y: Array, friction: float | None) -> tuple[float, float, float]:
        """Return (deck acceleration, support acceleration, friction torque).

        With `friction` None the joint is locked: the torque that keeps u constant comes out.
        """
        law = self.law
        roll, v, s, w, z, *inner = y.tolist()
        x, u = roll - s - law.rest, v - w
        torque = law.smooth_torque(x, u, self.modes) - law.arm_stiffness * z + self.slider(x)
        torque += sum(each.torque(x, u, roll, states) for each, states in self.remembering(inner))
        if self.hand is None:
            inertia, slope = law.inertia_at(roll)
            deck = (torque - law.gravity * math.sin(roll) - slope * v * v / 2) / inertia
            deck_gain = 1.0 / inertia
        else:
            deck, deck_gain = self.hand.acceleration(time), 0.0
        support = support_gain = 0.0
        if law.support_inertia:
            support = (-law.support_stiffness * s - law.support_damping * w - torque) / law.support_inertia
            support_gain = -1.0 / law.support_inertia
        gain = deck_gain - support_gain
        locking = (support - deck) / gain if gain else 0.0
        applied = locking if friction is None else friction
        return deck + deck_gain * applied, support + support_gain * applied, applied

    def slider(self, x: float) -> float:
        """Torque of the Jenkins slider [N*m]."""
        if self.modes.slider:
            return -self.modes.slider * self.law.slider_torque
        return -self.law.slider_stiffness * (x - self.modes.origin)

    def friction(self, x: float, u: float) -> float | None:
        """Dry friction torque of the present mode; None while it sticks."""
        if not self.law.has_friction:
            return 0.0
        return -self.modes.friction * self.law.sliding_friction(x, u) if self.modes.friction else None

    def rates(self, time: float, y: Array) -> Array:
        """Right-hand side of the differential equation, shape (5 + n,)."""
        roll, v, s, w, z, *inner = y.tolist()
        x, u = roll - s - self.law.rest, v - w
        deck, support, _ = self.accelerations(time, y, self.friction(x, u))
        flows = [flow for each, states in self.remembering(inner) for flow in each.rates(x, u, roll, states)]
        return np.array((v, deck, w, support, u - z / self.law.arm_time, *flows))

    def remembering(self, inner: list[float]) -> list[tuple[CatalogueLaw, list[float]]]:
        """Return the catalogue's laws that have internal states, with theirs."""
        left, laws = iter(inner), (each for each in self.law.laws if each.effect.states)
        return [(each, [next(left) for _ in each.effect.states]) for each in laws]

    def locks(self) -> bool:
        """Whether dry friction decides anything now (a hand on a rigid board overrules it)."""
        return self.law.has_friction and (self.hand is None or self.law.support_inertia > 0)

    def guards(self) -> list[tuple[str, Callable[[float, Array], float]]]:
        """Return named functions that are positive while the present modes hold."""
        law, modes = self.law, self.modes

        def x(y: Array) -> float:
            return float(y[0] - y[2]) - law.rest

        def u(y: Array) -> float:
            return float(y[1] - y[3])

        guards: list[tuple[str, Callable[[float, Array], float]]] = []
        if self.locks() and modes.friction:
            guards.append(("friction", lambda _, y: modes.friction * u(y)))
        elif self.locks():
            guards.append(
                ("friction", lambda t, y: law.holding_friction(x(y)) - abs(self.accelerations(t, y, None)[2]))
            )
        if law.slider_stiffness and modes.slider:
            guards.append(("slider", lambda _, y: modes.slider * u(y)))
        elif law.slider_stiffness:
            reach = law.slider_torque / law.slider_stiffness
            guards.append(("slider", lambda _, y: reach - abs(x(y) - modes.origin)))
        for name, edge, side in (("stop", law.stop_angle, modes.stop), ("gap", law.half_gap, modes.gap)):
            if edge == 0 or not math.isfinite(edge):
                continue
            if side:
                guards.append((name, lambda _, y, edge=edge, side=side: side * x(y) - edge))
            else:
                guards.append((name, lambda _, y, edge=edge: edge - abs(x(y))))
        return guards

    def switch(self, name: str, time: float, y: Array) -> Array:
        """Change the mode of a guard that became negative; return the state from which to continue."""
        law, modes = self.law, self.modes
        x = float(y[0] - y[2]) - law.rest
        if name == "friction":
            if modes.friction:
                y = y.copy()
                y[1 if self.hand is None else 3] = y[3 if self.hand is None else 1]  # u is 0, exactly
            self.modes = replace(modes, friction=0)
            _, _, needed = self.accelerations(time, y, None)
            slips = modes.friction == 0 or abs(needed) > law.holding_friction(x)
            self.modes = replace(modes, friction=-int(math.copysign(1, needed)) if slips else 0)
        elif name == "slider" and modes.slider:
            origin = x - modes.slider * law.slider_torque / law.slider_stiffness
            self.modes = replace(modes, slider=0, origin=origin)
        elif name == "slider":
            self.modes = replace(modes, slider=int(math.copysign(1, x - modes.origin)))
        else:
            side = 0 if getattr(modes, name) else int(math.copysign(1, x))
            self.modes = replace(modes, **{name: side})
        return y

    def begin(self, time: float, y: Array) -> None:
        """Choose the friction mode of the state."""
        x, u = float(y[0] - y[2]) - self.law.rest, float(y[1] - y[3])
        if not self.locks():
            return
        self.modes = replace(self.modes, friction=0)
        if abs(u) > 1e-12:
            self.modes = replace(self.modes, friction=int(math.copysign(1, u)))
            return
        _, _, needed = self.accelerations(time, y, None)
        if abs(needed) > self.law.holding_friction(x):
            self.modes = replace(self.modes, friction=-int(math.copysign(1, needed)))

    def stands_still(self) -> bool:
        """Whether the deck is stuck for good."""
        law = self.law
        free = self.hand is None and not law.arm_stiffness and not law.support_inertia and not law.laws
        return free and self.locks() and self.modes.friction == 0


@contextmanager
def _followed() -> Generator[None]:
    """Turn arithmetic errors into an error for people."""
    try:
        with np.errstate(all="ignore"):
            yield
    except (ArithmeticError, ValueError) as error:
        raise SysidError(
            f"the true motion cannot be followed ({error}): it grows without bound, chatters or is far too stiff. "
            "Use milder effects."
        ) from error


@_followed()
def simulate(
    law: TrueLaw, start: Condition, begin: float, end: float, times: Array, hand: HandMotion | None = None, *,
    accelerations: bool = False, tolerances: tuple[float, float] = (RTOL, ATOL),
) -> tuple[Array, Condition]:  # fmt: skip
    """Integrate from `begin` to `end` [s] and sample at `times` [s], shape (n,), ascending, in between.

    Args:
        begin: Start [s].
        end: End [s].
        times: Sampling instants [s].
        hand: Leads the deck instead of letting it move freely.
        accelerations: Fill the third column of the samples; it is 0 otherwise.

    Returns:
        Samples (roll, rate, acceleration), shape (n, 3), and the condition at `end`.

    Raises:
        SysidError: The motion grows without bound, chatters or is far too stiff.
    """
    from scipy.integrate import DOP853

    motion = _Motion(law, start.modes, hand)
    motion.begin(begin, start.state)
    samples = np.zeros((len(times), 3))
    time, state, taken, steps = begin, start.state, 0, 0
    longest = _longest_step(law) if law.has_kinks else np.inf
    knots = np.empty(0) if hand is None else hand.knots
    step = None
    while time < end:
        if motion.stands_still():
            state = state.copy()
            state[1] = 0.0
            samples[taken:] = (state[0], 0.0, 0.0)
            return samples, Condition(state, motion.modes)
        until = min([end, *knots[np.searchsorted(knots, time, side="right") :][:1]])
        solver: Any = DOP853(
            motion.rates, time, state, until, rtol=tolerances[0], atol=tolerances[1], max_step=longest,
            first_step=None if step is None else min(step, until - time),
        )  # fmt: skip
        guards = motion.guards()
        event = None
        while solver.status == "running" and event is None:
            steps += 1
            message = solver.step()
            if message is not None or steps > _MAX_STEPS or not abs(float(solver.y[0])) < math.tau:
                raise ArithmeticError(f"beyond t = {solver.t:.6g} s")
            step = solver.step_size
            stop = len(times) if solver.t >= end else int(np.searchsorted(times, solver.t))
            path = solver.dense_output() if guards or stop > taken else None
            event = _first_event(guards, path, solver.t_old, solver.t) if path and guards else None
            if event is not None:
                stop = int(np.searchsorted(times, event[1]))
            if path and stop > taken:
                _sample(motion, times[taken:stop], path, samples[taken:stop], accelerations=accelerations)
                taken = stop
            time, state = (solver.t, solver.y) if event is None or not path else (event[1], path(event[1]))
        if event is not None:
            state = motion.switch(event[0], time, state)
            step = longest / 4
    return samples, Condition(state, motion.modes)


def _sample(
    motion: _Motion, times: Array, path: Callable[[Array], Array], samples: Array, *, accelerations: bool
) -> None:
    states = path(times)
    samples[:, 0], samples[:, 1] = states[0], states[1]
    if not accelerations:
        return
    for row, (time, state) in enumerate(zip(times.tolist(), states.T, strict=True)):
        samples[row, 2] = motion.rates(time, state)[1]


def _longest_step(law: TrueLaw) -> float:
    """Return the square root of inertia over stiffness, a sixth of the shortest period [s]."""
    inertia = min(law.inertia, law.support_inertia or law.inertia)
    stiffness = law.stiffness + law.slider_stiffness + law.arm_stiffness
    stiffness += law.support_stiffness + (law.stop_stiffness if math.isfinite(law.stop_angle) else 0.0)
    if not stiffness:  # a pendulum: its weight, where it is steepest
        grid = np.linspace(-math.pi, math.pi, 73)
        pulls = [law.smooth_torque(x, 0.0, Modes()) for x in grid.tolist()]
        stiffness = abs(law.gravity) + float(np.abs(np.gradient(pulls, grid)).max())
    return math.sqrt(inertia / stiffness) if stiffness else math.inf


def _first_event(
    guards: list[tuple[str, Callable[[float, Array], float]]], path: Callable[[Array | float], Array],
    begin: float, end: float,
) -> tuple[str, float] | None:  # fmt: skip
    """Return name and time of the first guard that becomes negative between `begin` and `end`."""
    from scipy.optimize import brentq

    probes = np.linspace(begin, end, 6).tolist()  # a kink crossed twice within one step shows
    states = path(np.array(probes)).T
    first: tuple[str, float] | None = None
    for name, guard in guards:
        before = guard(begin, states[0])
        for left, right, state in zip(probes[:-1], probes[1:], states[1:], strict=True):
            after = guard(right, state)
            if after < 0:
                crossing: Any = left
                if before > 0:
                    crossing = brentq(lambda t, guard=guard: guard(t, path(t)), left, right, xtol=1e-14)
                if first is None or crossing < first[1]:
                    first = (name, float(crossing))
                break
            before = after
    return first
