"""All driven joints of a model fitted together, each beside the simulated motion of the others."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from sim.model.driven import Stated, free_inertia, load_along
from sim.model.setup import Setup
from sysid.driven.fit import DrivenFit, fit, free_of
from sysid.driven.log import DrivenLog
from sysid.driven.missing import Motion
from sysid.noise.autoregression import residual_noise
from sysid.roll import Array

PASSES = 5
"""Fits of each joint beside the motion of the others before the last: encoder zeros of two joints keep a fifth of their error each time."""
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
        stated: By joint: what the model states.
        effects: Effects to fit beside armature, damping and bias.
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
        fits[joint] = [
            fit(
                log,
                structure,
                given,
                free,
                bounds=bounds,
                quick=coupled,
                simulator=None if coupled else known.simulator,
            )
            for log in own
        ]
    for last in (*(False,) * PASSES, True) if coupled else ():
        for joint, own in fits.items():
            own[:] = [
                _beside(setup, fits, stated, joint, number, bounds, last=last) for number in range(len(own))
            ]
    for number in range(len(next(iter(fits.values())))) if coupled else ():
        for own, one in zip(fits.values(), _coupled(setup, fits, number), strict=True):
            own[number] = one
    return fits


def _beside(
    setup: Setup, fits: Fits, stated: Mapping[str, Stated], joint: str, number: int,
    bounds: Mapping[str, tuple[float, float]], *, last: bool,
) -> DrivenFit:  # fmt: skip
    """Fit a joint beside the motions that the fits of the others have."""
    before = fits[joint][number]
    motion = {other: _motion(own[number]) - own[number].values[ZERO] for other, own in fits.items()}
    own_setup = setup.with_(joint=joint)
    load = load_along(own_setup, motion, before.log.time, simulated=True, lag=_lag(before))
    armatures = {other: own[number].values["armature"] for other, own in fits.items()}
    simulator = replace(stated[joint].simulator, alone=free_inertia(own_setup, armatures))
    structure = before.structure
    if structure.simulator is not None:
        structure = replace(structure, simulator=simulator)
    return fit(
        replace(before.log, load=load), structure, before.values, tuple(before.quantities), bounds=bounds,
        begins=[before.values], quick=not last, simulator=simulator,
    )  # fmt: skip


def _lag(fit: DrivenFit) -> float:
    """Return by how much the rate of a simulator lags behind its angle [s]."""
    simulator = fit.structure.simulator
    return 0.0 if simulator is None or simulator.implicit == "nothing" else simulator.step / 2


def _waves(fit: DrivenFit, slopes: Array) -> Array:
    """Return the change of a joint's angle in the model with each unknown, from residuals' slopes, shape (n, p) each."""
    waves = np.zeros((len(fit.log.time), slopes.shape[1]))
    waves[: len(slopes)] = slopes * fit.log.std
    for k, name in enumerate(fit.quantities):
        waves[:, k] -= fit.problem.sizes[k] * (name == ZERO)
    return waves


def _motion(fit: DrivenFit) -> Array:
    """Return the simulated angle, and of the residual as much as stands above its noise [rad], shape (n,)."""
    time = fit.log.time
    rest = Motion.of(time, fit.log.angle - fit.motion)
    return fit.motion + np.interp(time, rest.time, rest.angle)


def _coupled(setup: Setup, fits: Fits, number: int) -> list[DrivenFit]:
    """Return the fits of the joints to one log, their intervals with those of the others' motions.

    Noise n and the errors of the others' motions, through the load, make the error of all unknowns: e = A n + B e.
    """
    names, own = list(fits), [one[number] for one in fits.values()]
    if len(own) == 1:
        return own
    problems = [one.problem for one in own]
    rows = [problem.residuals(one.point) for problem, one in zip(problems, own, strict=True)]
    rest, slopes = [r[0] for r, _ in rows], [j[0] for _, j in rows]
    back = [np.linalg.pinv(j * one.moving) * one.moving[:, None] for j, one in zip(slopes, own, strict=True)]
    alone = [b @ residual_noise([r]).applied(b.T) for b, r in zip(back, rest, strict=True)]
    ends = np.cumsum([0, *(len(one) for one in alone)])
    taken = np.zeros((ends[-1], ends[-1]))
    waves = [_waves(one, j) for one, j in zip(own, slopes, strict=True)]
    motion = {name: one.motion - one.values[ZERO] for name, one in zip(names, own, strict=True)}
    for i, (name, problem) in enumerate(zip(names, problems, strict=True)):
        beside = setup.with_(joint=name)
        lag = _lag(own[i])
        plain = load_along(beside, motion, problem.log.time, simulated=True, lag=lag)
        for j, other in enumerate(names):
            for k, size in enumerate(np.sqrt(np.diag(alone[j])) if i != j else ()):
                moved = motion[other] + size * waves[j][:, k]
                load = load_along(beside, {**motion, other: moved}, problem.log.time, simulated=True, lag=lag)
                more = replace(problem.log.load, torque=problem.log.load.torque + load.torque - plain.torque)
                changed = replace(problem, log=replace(problem.log, load=more))
                found = changed.residuals(own[i].point, slopes=False)[0][0]
                taken[ends[i] : ends[i + 1], ends[j] + k] = back[i] @ (found - rest[i]) / max(size, 1e-300)
    whole = np.asarray(np.linalg.inv(np.eye(ends[-1]) - taken), dtype=np.float64)
    blocks = np.asarray(block_diag(*alone), dtype=np.float64)
    spread = np.diag(whole @ blocks @ whole.T)
    before = np.concatenate([np.diag(one) for one in alone])
    factors = np.sqrt(np.maximum(np.divide(spread, before, out=np.ones_like(spread), where=before > 0), 1.0))
    return [one.widened(factors[a : a + len(one.quantities)]) for one, a in zip(own, ends, strict=False)]
