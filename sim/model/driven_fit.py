"""All driven joints of a model fitted together, each beside the simulated motion of the others."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag

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
        known = {joint: one.simulator for joint, one in stated.items()}
        for joint, one in _together(setup, alone, known).items():
            fits[joint][number] = one
    return fits


def _together(
    setup: Setup, fits: dict[str, DrivenFit], simulators: Mapping[str, Simulator]
) -> dict[str, DrivenFit]:
    """Return the fits of the joints to one log, each beside the motions that the fits of the others have."""
    for number in range(PASSES):
        first, last = number == 0, number == PASSES - 1
        for joint, one in fits.items():
            problem, simulator = _beside(setup, fits, joint, simulators[joint], finer=1 if first else FINER)
            if first or last:
                fits[joint] = fit(problem, begins=[problem.values], quick=first, simulator=simulator)
            else:
                fits[joint] = one.continued(problem)
    return _coupled(setup, fits)


def _beside(
    setup: Setup, fits: Mapping[str, DrivenFit], joint: str, simulator: Simulator, *, finer: int
) -> tuple[Problem, Simulator]:
    """Return the problem of a joint beside the motions of the others, and the simulator of the model there."""
    own_setup, before = setup.with_(joint=joint), fits[joint]
    problem, middle = replace(before.problem, values=before.values, finer=finer), before.structure.middle
    time = problem.load_time
    armatures = {other: one.values["armature"] for other, one in fits.items()}
    simulator = replace(simulator, alone=free_inertia(own_setup, armatures))
    structure = before.structure
    if structure.simulator is not None:
        structure = replace(structure, simulator=simulator)
    load = load_along(own_setup, _courses(fits, before.log, time, middle=middle), time)
    return replace(problem, log=replace(before.log, load=load), structure=structure), simulator


def _courses(
    fits: Mapping[str, DrivenFit], log: DrivenLog, time: Array, *, middle: bool
) -> dict[str, Course]:
    """Return the courses of all joints at even times, shape (n,): simulated if they have a fit, else measured."""
    measured = {name: Course.measured(log.time, angle, time) for name, angle in log.beside.items()}
    return measured | {name: _course(one, time, middle=middle) for name, one in fits.items()}


def _course(fit: DrivenFit, time: Array, *, middle: bool) -> Course:
    """Return the simulated motion, and of the residual as much as stands above its noise, at even times, shape (n,)."""
    log, simulator = fit.log, fit.structure.simulator
    (path,) = fit.problem.paths(fit.point, slopes=False)
    angle, rate, acceleration = _at(time, fit.problem.grid, path[:, :2, 0].T, middle=middle)
    smooth = Motion(log.time, log.angle - fit.motion)
    rest = CubicSpline(smooth.time, smooth.angle)
    lag = 0.0 if middle else (time[1] - time[0]) / 2
    source = fit.structure.source
    gains = [fit.values[f"{source.name}.{p.name}"] for p in source.parameters[1:]]
    implicit = "nothing" if simulator is None else simulator.implicit
    damping = 0.0 if implicit == "nothing" else fit.values["damping"]
    return Course(
        angle=angle + rest(time) - fit.values[ZERO], rate=rate + rest(time - lag, 1), acceleration=acceleration + rest(time, 2),
        armature=fit.values["armature"], damping=damping + (sum(gains) if implicit == "actuator" else 0.0),
    )  # fmt: skip


def _at(time: Array, grid: Array, states: Array, *, middle: bool) -> Array:
    """Return angle, rate and mean acceleration of steps, shape (3, n), of states (angle and rate) on a grid, shape (2, m).

    Args:
        time: Even times, at the middle or at the start of each step [s], shape (n,).
    """
    step = time[1] - time[0]
    nodes = np.r_[time, time[-1] + step] - middle * step / 2
    angle, rate = (np.interp(nodes, grid, one) for one in states)
    acceleration = np.diff(rate) / step
    if middle:
        return np.stack([(angle[1:] + angle[:-1]) / 2, (rate[1:] + rate[:-1]) / 2, acceleration])
    return np.stack([angle[:-1], rate[:-1], acceleration])


def _coupled(setup: Setup, fits: Mapping[str, DrivenFit]) -> dict[str, DrivenFit]:
    """Return the fits of the joints to one log, their intervals with those of the others' motions.

    Noise n and the errors of the others' motions, through the load, make the error of all unknowns: e = A n + B e.
    """
    own = list(fits.values())
    problems = [one.problem for one in own]
    rows = [problem.residuals(one.point) for problem, one in zip(problems, own, strict=True)]
    rest, slopes = [r[0] for r, _ in rows], [j[0] for _, j in rows]
    back = [np.linalg.pinv(j * one.moving) * one.moving[:, None] for j, one in zip(slopes, own, strict=True)]
    alone = [b @ residual_noise([r]).applied(b.T) for b, r in zip(back, rest, strict=True)]
    ends = np.cumsum([0, *(len(one) for one in alone)])
    taken = np.zeros((ends[-1], ends[-1]))
    paths = [next(problem.paths(one.point, slopes=True)) for problem, one in zip(problems, own, strict=True)]
    clock = own[0].log.motion.time
    courses = _courses(fits, own[0].log, clock, middle=True)
    coupling = coupling_along(setup, {name: courses[name] for name in (*fits, *courses)})
    for i, problem in enumerate(problems):
        time, middle = problem.log.load_time, own[i].structure.middle
        for j in range(len(own)):
            if i == j:
                continue
            derivatives = np.stack([np.interp(time, clock, one) for one in coupling[i, j]])
            for k, size in enumerate(np.sqrt(np.diag(alone[j]))):
                wave = _at(time, problems[j].grid, paths[j][:, :2, 1 + k].T, middle=middle)
                if list(problems[j].free)[k : k + 1] == [ZERO]:
                    wave[0] -= problems[j].sizes[k]
                load = problem.log.load
                more = replace(load, torque=load.torque + size * (derivatives * wave).sum(axis=0))
                changed = replace(problem, log=replace(problem.log, load=more))
                found = changed.residuals(own[i].point, slopes=False)[0][0]
                taken[ends[i] : ends[i + 1], ends[j] + k] = back[i] @ (found - rest[i]) / max(size, 1e-300)
    whole = np.asarray(np.linalg.inv(np.eye(ends[-1]) - taken), dtype=np.float64)
    blocks = np.asarray(block_diag(*alone), dtype=np.float64)
    spread = np.diag(whole @ blocks @ whole.T)
    before = np.concatenate([np.diag(one) for one in alone])
    factors = np.sqrt(np.maximum(np.divide(spread, before, out=np.ones_like(spread), where=before > 0), 1.0))
    return {
        name: one.widened(factors[a : a + len(one.quantities)])
        for (name, one), a in zip(fits.items(), ends, strict=False)
    }
