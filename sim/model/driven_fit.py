"""All driven joints of a model fitted together, each beside the simulated motion of the others."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from sim.model.driven import Course, Stated, coupling_along, free_inertia, load_along
from sim.model.setup import Setup
from sysid.driven.fit import FINER, DrivenFit, fit, free_of
from sysid.driven.joint import Simulator
from sysid.driven.log import DrivenLog
from sysid.driven.motion import Motion
from sysid.driven.problem import Problem
from sysid.noise.autoregression import residual_noise
from sysid.roll import Array

PASSES = 6
"""Fits of each joint beside the motion of the others: encoder zeros of two joints keep a fifth of their error each time."""
DRAWS = 200
"""Draws of noise for a deviation: its own is then 5 %."""
ZERO = "zero"
"""The parameter that moves all angles of a joint in the model."""

Fits = dict[str, list[DrivenFit]]
"""Fits of each joint, one for each log."""


def fit_joints(
    setup: Setup, logs: Mapping[str, Sequence[DrivenLog]], stated: Mapping[str, Stated], effects: Sequence[str], *,
    fixed: Mapping[str, float] | None = None, bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Fits:  # fmt: skip
    """Fit the joints of a model to logs.

    Args:
        logs: By joint, in the same order for each.
        fixed: Parameters that are held, in SI.
        bounds: Ends of parameters, in SI; those are fitted too.

    Raises:
        SysidError: An effect or a parameter is unknown, or the motion runs away.
    """
    fixed, bounds = fixed or {}, bounds or {}
    fits: Fits = {}
    coupled = len(logs) > 1 or ZERO in bounds
    for joint, own in logs.items():
        known = stated[joint]
        structure = replace(known.structure, effects=tuple(sorted({*known.structure.effects, *effects})))
        free = free_of(structure, structure.effects, fixed, more=tuple(bounds))
        given = {**known.values, **fixed}
        posed = (Problem(log=log, structure=structure, values=given, free=free, bounds=bounds) for log in own)
        law = None if coupled else known.simulator
        fits[joint] = [fit(one, quick=coupled, simulator=law) for one in posed]
    for number in range(len(next(iter(logs.values())))) if coupled else ():
        alone = {joint: own[number] for joint, own in fits.items()}
        simulators = {joint: one.simulator for joint, one in stated.items()}
        for joint, one in _together(setup, alone, simulators).items():
            fits[joint][number] = one
    return fits


def _together(
    setup: Setup, fits: Mapping[str, DrivenFit], simulators: Mapping[str, Simulator]
) -> dict[str, DrivenFit]:
    """Return the fits of the joints to one log, each beside the motions that the fits of the others have."""
    joints = {name: Beside(fit=one, simulator=simulators[name]) for name, one in fits.items()}
    for number in range(PASSES):
        first, last = number == 0, number == PASSES - 1
        for name, one in joints.items():
            problem, simulator = posed_beside(setup, joints, name, 1 if first else FINER)
            if first or last:
                found = fit(problem, begins=[problem.values], quick=first, simulator=simulator)
            else:
                found = one.fit.continued(problem)
            joints[name] = replace(one, fit=found)
    if len(joints) == 1:
        return {name: one.fit for name, one in joints.items()}
    factors = widenings(setup, joints)
    return {
        name: one.fit.widened(factor[: len(one.fit.quantities)])
        for (name, one), factor in zip(joints.items(), factors, strict=True)
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class Beside:
    """A fitted joint of a model, and its course for the others: the simulated path and the filtered residual."""

    fit: DrivenFit
    simulator: Simulator
    """Of the model."""

    @cached_property
    def smooth(self) -> Motion:
        """The residual through a filter that leaves as much as stands above its noise."""
        return Motion(self.fit.log.time, self.fit.log.angle - self.fit.motion)

    @cached_property
    def rest(self) -> CubicSpline:
        """The filtered residual [rad], as a function of time."""
        return CubicSpline(self.smooth.time, self.smooth.angle)

    def course(self, time: Array, *, middle: bool) -> Course:
        """Return its course at even times, at the middle or at the start of each step [s], shape (n,)."""
        values, step = self.fit.values, time[1] - time[0]
        (path,) = self.fit.problem.paths(self.fit.point, slopes=False)
        nodes = np.r_[time, time[-1] + step] - middle * step / 2
        angle, rate = (np.interp(nodes, self.fit.problem.grid, one) for one in path[:, :2, 0].T)
        acceleration = np.diff(rate) / step
        angle, rate = ((x[1:] + x[:-1]) / 2 if middle else x[:-1] for x in (angle, rate))
        source, simulator = self.fit.structure.source, self.fit.structure.simulator
        implicit = "nothing" if simulator is None else simulator.implicit
        damping = 0.0 if implicit == "nothing" else values["damping"]
        if implicit == "actuator":
            damping += sum(values[f"{source.name}.{p.name}"] for p in source.parameters[1:])
        lag = 0.0 if middle else step / 2
        return Course(
            angle=angle + self.rest(time) - values[ZERO], rate=rate + self.rest(time - lag, 1),
            acceleration=acceleration + self.rest(time, 2), armature=values["armature"], damping=damping,
        )  # fmt: skip


def courses_of(joints: Mapping[str, Beside], time: Array, *, middle: bool) -> dict[str, Course]:
    """Return the courses of all joints at even times [s], shape (n,): of those without a fit, the measured ones."""
    log = next(iter(joints.values())).fit.log
    measured = {name: Course.measured(log.time, angle, time) for name, angle in log.beside.items()}
    return {name: one.course(time, middle=middle) for name, one in joints.items()} | measured


def posed_beside(
    setup: Setup, joints: Mapping[str, Beside], joint: str, finer: int
) -> tuple[Problem, Simulator]:
    """Return the problem of a joint beside the courses of the others, and the simulator of the model there."""
    own, fit = setup.with_(joint=joint), joints[joint].fit
    problem, structure = replace(fit.problem, values=fit.values, finer=finer), fit.structure
    armatures = {name: one.fit.values["armature"] for name, one in joints.items()}
    simulator = replace(joints[joint].simulator, alone=free_inertia(own, armatures))
    if structure.simulator is not None:
        structure = replace(structure, simulator=simulator)
    time = problem.load_time
    load = load_along(own, courses_of(joints, time, middle=structure.middle), time)
    return replace(problem, log=replace(fit.log, load=load), structure=structure), simulator


def widenings(setup: Setup, joints: Mapping[str, Beside]) -> list[Array]:
    """Return factors by which the deviations of each joint's unknowns grow with the errors of the others' motions [1], shape (p,).

    A joint's reading is fitted by its own slopes A. It depends on all unknowns by P, and on the noise in the others' courses.
    So noise n and its part m through the others make the error (A⁺ P)⁻¹ A⁺ (n - m). Without the others it is A⁺ n.
    """
    fits, rng = [one.fit for one in joints.values()], np.random.default_rng(0)
    problems, time = [one.problem for one in fits], fits[0].log.motion.time
    ends = np.cumsum([0, *(len(one.point) for one in fits)])
    paths = [
        next(p.paths(one.point, slopes=True))[:: p.substeps] for p, one in zip(problems, fits, strict=True)
    ]
    noise = [residual_noise([one.residual]) for one in fits]
    drawn = [np.stack([one.drawn(len(time), rng) for _ in range(DRAWS)], axis=1) for one in noise]
    waves = np.zeros((len(fits), len(time), 2, ends[-1] + DRAWS))
    for i, (problem, path, one) in enumerate(zip(problems, paths, joints.values(), strict=True)):
        where = [*range(ends[i], ends[i + 1]), *range(ends[-1], ends[-1] + DRAWS)]
        slow = CubicSpline(time, one.smooth.filtered(np.hstack([-path[:, 0, 1:], drawn[i]])))
        waves[i][:, :, where] = np.stack([slow(time), slow(time, 1)], axis=1)
        waves[i, :, :, ends[i] : ends[i + 1]] += path[:, :2, 1:]
        if ZERO in problem.free:
            place = problem.free.index(ZERO)
            waves[i, :, 0, ends[i] + place] -= problem.sizes[place]
    courses = courses_of(joints, time, middle=True)
    coupling = coupling_along(setup, courses)[: len(fits), : len(fits)]
    moves = [
        p.transitions(one.point, path[:, :, 0]) for p, one, path in zip(problems, fits, paths, strict=True)
    ]
    shifts = shifts_of(moves, coupling, np.concatenate([*waves], axis=1), time[1] - time[0])
    before, after = np.zeros((2, ends[-1], DRAWS))
    taken = np.eye(ends[-1])
    for i, (problem, one, shift) in enumerate(zip(problems, fits, shifts, strict=True)):
        where = slice(ends[i], ends[i + 1])
        rows = problem.residuals(one.point)[1][0] * problem.log.std
        seen = CubicSpline(time, shift[:, problem.measured])(problem.log.time[: len(rows)])
        back = np.linalg.pinv(rows * one.moving) * one.moving[:, None]
        taken[where] += back @ seen[:, : ends[-1]]
        before[where] = back @ drawn[i][: len(rows)]
        after[where] = before[where] - back @ seen[:, ends[-1] :]
    spread, alone = (np.mean(x**2, axis=1) for x in (np.linalg.solve(taken, after), before))
    factors = np.sqrt(np.maximum(np.divide(spread, alone, out=np.ones_like(alone), where=alone > 0), 1.0))
    return np.split(factors, ends[1:-1])


def shifts_of(
    moves: Sequence[tuple[Array, Array]], coupling: Array, waves: Array, step: float
) -> list[Array]:
    """Return the changes of each joint's state by those of the others, shape (n, s, c) each.

    Args:
        moves: Of each joint, derivatives of the state after a step by the state before and by a torque.
        coupling: Derivatives of each joint's load by angle, rate and acceleration of each joint, shape (j, j, 3, n).
        waves: Changes of all angles and rates without the others, shape (n, 2 j, c).
        step: Of these times [s].
    """
    size, own = len(coupling), np.arange(len(coupling))
    coupling = coupling.copy()
    coupling[own, own, 0] = coupling[own, own, 2] = 0.0  # a joint's path has its own angle and acceleration
    by_angle, by_rate, by_acceleration = np.moveaxis(
        (coupling[..., 1:] + coupling[..., :-1]) / 2, (2, 3), (0, 1)
    )
    later, now = (
        np.stack([by_angle / 2, by_rate / 2 + sign * by_acceleration / step], axis=-1).reshape(
            -1, size, 2 * size
        )
        for sign in (1, -1)
    )
    ends = np.cumsum([0, *(push.shape[1] for _, push in moves)])
    carry, push = np.zeros((len(now), ends[-1], ends[-1])), np.zeros((len(now), ends[-1], size))
    for i, (matrix, column) in enumerate(moves):
        where = slice(ends[i], ends[i + 1])
        carry[:, where, where], push[:, where, i] = matrix, column
    shown = np.zeros((2 * size, ends[-1]))  # angle and rate of each joint
    shown[np.arange(2 * size), [place for end in ends[:-1].tolist() for place in (end, end + 1)]] = 1.0
    implicit = np.linalg.inv(np.eye(ends[-1]) - push @ later @ shown)
    forced = implicit @ push @ (later @ waves[1:] + now @ waves[:-1])
    carry = implicit @ (carry + push @ now @ shown)
    found = np.zeros((len(waves), ends[-1], waves.shape[2]))
    for k in range(len(carry)):
        found[k + 1] = carry[k] @ found[k] + forced[k]
    return np.split(found, ends[1:-1], axis=1)
