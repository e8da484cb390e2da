"""The fit of a driven joint: starts from its missing torque, then output error over the whole log."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from sysid.driven.joint import BASE, Simulator, Structure
from sysid.driven.log import DrivenLog
from sysid.driven.missing import Motion, linear_start
from sysid.driven.problem import Problem, limits_of, scales_of, size_of
from sysid.effects._base import DriveEffect, TorqueEffect
from sysid.errors import SysidError
from sysid.least_squares import Minimum
from sysid.noise.autoregression import ResidualNoise, residual_noise
from sysid.quantity import Quantity, slide_unit
from sysid.roll import Array

FEWER = 4
"""Factor between the numbers of windows of fits that follow each other, from the equations alone to the whole log."""
FINER = 3
"""Factor of integration steps in the last fit, from which intervals come: a step's error falls by nine."""
SHORTEST = 12
"""Shortest window, six for each of its two first states [samples]."""
MATTERS = 0.1
"""Share of the residual's RMS that an effect must explain to be named: less is significant in a long log, but too small to matter."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenFit:
    """A driven joint fitted to one log."""

    log: DrivenLog
    structure: Structure
    values: Mapping[str, float]
    """All parameters."""
    quantities: Mapping[str, Quantity]
    """The fitted ones."""
    covariance: Array
    """Of the fitted ones in their order and units, shape (p, p)."""
    rmse: float
    """RMS of measured less simulated [rad]."""
    noise: float
    """Noise of the log [rad]."""
    colour: ResidualNoise
    """Autoregression of the residuals."""
    score: float
    """-2 log likelihood of correlated residuals, plus ln n for each parameter."""
    residual: Array
    """Measured less simulated [rad], shape (n,)."""
    problem: Problem
    """The least squares of the whole log."""
    point: Array
    """Its unknowns at the minimum, in units of their sizes, shape (p,)."""

    @property
    def motion(self) -> Array:
        """Simulated angle at the log's samples [rad], shape (n,)."""
        inside = len(self.residual)
        return np.r_[self.log.angle[:inside] - self.residual, self.log.angle[inside:]]

    @property
    def nrmse(self) -> float:
        """Error beyond the noise, over the RMS motion [1]."""
        beyond = math.sqrt(max(self.rmse**2 - self.noise**2, 0.0))
        return beyond / float(np.std(self.log.angle))

    @property
    def is_noise(self) -> bool:
        """Whether the residual's own past foretells too little of it for an effect to matter."""
        return _is_noise(self.colour)

    @property
    def moving(self) -> Array:
        """1 for each unknown with a finite interval, else 0 [1]; shape (p,)."""
        own = np.isfinite(np.diag(self.covariance))
        return np.r_[own, np.ones(len(self.point) - len(own))]

    def widened(self, factors: Array) -> "DrivenFit":
        """Return it with larger deviations of the fitted parameters, by factors [1] of shape (p,)."""
        quantities = {
            name: replace(quantity, std=quantity.std * float(factor))
            for (name, quantity), factor in zip(self.quantities.items(), factors, strict=True)
        }
        covariance = self.covariance * np.outer(factors, factors)
        return replace(self, covariance=covariance, quantities=quantities)

    def to_json(self) -> dict[str, object]:
        """Return what `fit --json` writes of a driven joint."""
        return {
            "log": self.log.name, "input": self.log.kind, "input_between": self.log.between, "effects": list(self.structure.effects), "rmse_rad": self.rmse,
            "noise_floor_rad": self.noise, "nrmse": self.nrmse, "memory_samples": self.colour.memory,
            "values": dict(self.values),
            "parameters": {name: quantity.to_json() for name, quantity in self.quantities.items()},
        }  # fmt: skip


def _is_noise(colour: ResidualNoise) -> bool:
    """Return whether residuals are less than `MATTERS` larger than what their own past leaves of them.

    Their memory would not do: a gear that rings leaves residuals whose correlations add up to less than white noise's.
    """
    return colour.std <= (1 + MATTERS) * math.sqrt(colour.innovation)


def free_of(
    structure: Structure, named: Sequence[str], fixed: Mapping[str, float], more: Sequence[str] = ()
) -> tuple[str, ...]:
    """Return the parameters that a fit may move: armature, damping, bias, and those of the effects that were named."""
    own = [
        f"{part.name}.{p.name}"
        for part in structure.parts
        if part.name in named
        for p in part.parameters
        if not p.held
    ]
    wanted = dict.fromkeys(("armature", "damping", "bias", *own, *more))
    unknown = [name for name in (*fixed, *more) if name not in structure.parameters]
    if unknown:
        raise SysidError(f"unknown parameter '{unknown[0]}'. Parameters: {', '.join(structure.parameters)}.")
    return tuple(name for name in wanted if name not in fixed)


def start_values(structure: Structure, given: Mapping[str, float], log: DrivenLog) -> dict[str, float]:
    """Return values of all parameters: those given, and neutral ones or sizes elsewhere."""
    values = {**dict.fromkeys(BASE, 0.0), **given}
    source = structure.source
    for p in source.parameters:
        default = 1.0 if p.default is None and len(source.parameters) == 1 else p.default
        if f"{source.name}.{p.name}" not in values:
            if default is None:
                raise SysidError(
                    f"a {log.kind} acts through {source.title}, which are not known: give --gains {','.join(q.name for q in source.parameters)}."
                )
            values[f"{source.name}.{p.name}"] = default
    scales = scales_of(log, structure, {**values, structure.delay: 0.0})
    for part in structure.parts:
        for p in part.parameters:
            values.setdefault(
                f"{part.name}.{p.name}",
                (p.neutral if p.neutral is not None else p.starts[0])
                * (p.size(scales) if p.neutral is None or p.neutral else 0.0),
            )
    return values


def fit(
    log: DrivenLog, structure: Structure, given: Mapping[str, float], free: tuple[str, ...], *,
    bounds: Mapping[str, tuple[float, float]] | None = None, begins: Sequence[Mapping[str, float]] = (),
    quick: bool = False, simulator: Simulator | None = None, finer: int = 1,
) -> DrivenFit:  # fmt: skip
    """Fit the free parameters of a structure to a log by output error.

    Args:
        given: Known values of parameters, in SI.
        begins: Starts of all parameters, where they are known; each is tried.
        quick: Skip the interval, and the search for better minima.
        simulator: Of a model that may have made the log; the likelier of it and nature is fitted.
        finer: Factor of integration steps.

    Raises:
        SysidError: The motion runs away from everywhere that was tried.
    """
    structure, bounds = structure.checked(), dict(bounds or {})
    if not quick:
        log = with_likelier_input(
            log, structure, given, free, bounds=bounds, begins=begins, simulator=simulator, finer=finer
        )
    values = start_values(structure, given, log)
    found = begins or starts(Motion(log), structure, values, free, bounds)[0]
    if structure.gear is not None and len(found) > 1:
        found = begins = _deepest(log, structure, found, free, bounds)
    windows = [1] if begins else windows_of(log, structure, values)
    iterations = 12 if quick else 40
    chains = [_chain(log, structure, one, free, bounds, windows, iterations, finer) for one in found]
    chains = [chain for chain in chains if chain and chain[-1][0].windows == 1]
    if not chains:
        raise SysidError(
            f"{log.name}: the simulated motion runs away wherever the fit starts. Check the input's unit and sign, and the gains."
        )
    best = min(chains, key=lambda chain: chain[-1][1].normal.cost)
    if simulator is not None and structure.gear is None and simulator.steps(log.step):
        moved = replace(structure, simulator=None if structure.simulator else simulator)
        other = _chain(log, moved, _values(best[-1]), free, bounds, windows, iterations, finer)
        if other and other[-1][1].normal.cost < best[-1][1].normal.cost:
            best = other
    if not quick:
        begun = _values(best[-1])
        again = [
            _chain(
                log, structure, {**begun, **other}, free, bounds, windows_of(log, structure, begun), 12, finer
            )
            for other in _restarts(structure, begun, free)
        ]
        best = min(
            (chain for chain in (best, *again) if chain and chain[-1][0].windows == 1),
            key=lambda chain: chain[-1][1].normal.cost,
        )
        best = _refined(best)
    return _result(best, quick=quick)


def with_likelier_input(
    log: DrivenLog, structure: Structure, given: Mapping[str, float], free: tuple[str, ...], **options: Any
) -> DrivenLog:
    """Return a log whose input is held or smooth between samples, the likelier of both; `options` are those of `fit`."""
    if log.held is not None:
        return log
    tried = [
        fit(replace(log, held=held), structure, given, free, quick=True, **options) for held in (True, False)
    ]
    return min(tried, key=lambda one: one.score).log


def windows_of(log: DrivenLog, structure: Structure, values: Mapping[str, float]) -> list[int]:
    """Return numbers of windows, from windows of about a period of the joint's fastest motion to the whole log."""
    periods = log.duration * scales_of(log, structure, values).frequency / (2 * math.pi)
    most = max(1.0, min(periods, len(log.time) / SHORTEST))
    return [FEWER**power for power in range(int(math.log(most, FEWER)), -1, -1)]


def _refined(chain: list[tuple[Problem, Minimum]]) -> list[tuple[Problem, Minimum]]:
    """Return a chain whose last fit has finer steps, as intervals may be narrower than the error of a step.

    If its residuals are correlated, fits over more windows come before it.
    """
    problem, found = chain[-1]
    fine = replace(problem, values=_values(chain[-1]), finer=FINER)
    again = fine.fitted(found.point * problem.sizes / fine.sizes, iterations=8)
    last = (fine, again) if np.isfinite(again.normal.cost) else chain[-1]
    before = chain[:-1]
    if not before and not _is_noise(residual_noise(last[0].residuals(last[1].point, slopes=False)[0])):
        before = _chain(
            problem.log, problem.structure, fine.values, problem.free, problem.bounds,
            windows_of(problem.log, problem.structure, fine.values)[:-1], 40,
        )  # fmt: skip
    return [*before, last]


def _deepest(
    log: DrivenLog, structure: Structure, found: Sequence[Mapping[str, float]], free: tuple[str, ...],
    bounds: Mapping[str, tuple[float, float]],
) -> list[Mapping[str, float]]:  # fmt: skip
    """Return the deepest of the valleys of a gear, one of each start, over short windows."""
    windows = windows_of(log, structure, found[0])[:-1]
    chains = [_chain(log, structure, one, free, bounds, windows, 10) for one in found]
    valleys = [chain for chain in chains if chain]
    return [_values(min(valleys, key=lambda one: one[-1][1].normal.cost)[-1])] if valleys else list(found)


def _chain(
    log: DrivenLog, structure: Structure, begin: Mapping[str, float], free: tuple[str, ...],
    bounds: Mapping[str, tuple[float, float]], windows: Sequence[int], iterations: int, finer: int = 1,
) -> list[tuple[Problem, Minimum]]:  # fmt: skip
    """Return fits over fewer and fewer windows, each from the one before."""
    chain: list[tuple[Problem, Minimum]] = []
    for number in windows:
        problem = Problem(
            log=log, structure=structure, values=begin, free=free, windows=number, bounds=bounds, finer=finer
        )
        found = problem.fitted(iterations=iterations if number > 1 else 40)
        if np.isfinite(found.normal.cost):
            chain.append((problem, found))
            begin = _values(chain[-1])
    return chain


def _values(one: tuple[Problem, Minimum]) -> dict[str, float]:
    """Return all parameters of a fit."""
    problem, found = one
    return dict(zip(problem.structure.parameters, problem.vector(found.point).tolist(), strict=True))


def starts(
    motion: Motion, structure: Structure, values: Mapping[str, float], free: tuple[str, ...],
    bounds: Mapping[str, tuple[float, float]], known: Collection[str] = (),
) -> tuple[list[dict[str, float]], float]:  # fmt: skip
    """Return starting values, of each combination of the effects' starts those that leave the least torque missing; and that [N*m].

    A gear does not show in the missing torque: each of its starts is tried.

    Args:
        known: Parameters whose value is a start already.
    """
    scales = scales_of(motion.log, structure, values)

    def limits(name: str) -> tuple[float, float]:
        low, high = np.array(limits_of(structure, name, scales)) * size_of(structure, name, scales)
        return bounds.get(name, (float(low), float(high)))

    choices: dict[str, list[float]] = {}
    geared: dict[str, list[float]] = {}
    for part in structure.parts:
        hidden = (isinstance(part, DriveEffect) and part.transmit is not None) or bool(part.states)
        for p in part.parameters:
            name = f"{part.name}.{p.name}"
            if name in free and name not in known and not (isinstance(part, DriveEffect) and part.sources):
                (geared if hidden else choices)[name] = [
                    float(np.clip(s * p.size(scales), *limits(name))) for s in p.starts
                ]
    linear = tuple(n for n in free if n not in geared)
    tried: list[tuple[float, dict[str, float]]] = []
    left = 0.0
    for one in product(*choices.values()):
        begin = {**values, **dict(zip(choices, one, strict=True))}
        for _ in range(2 if len(choices) < 3 else 1):
            begin, left = linear_start(structure, begin, linear, motion, limits)
        tried.append((left, begin))
    left, best = min(tried, key=lambda pair: pair[0])
    gear = structure.gear
    if gear is not None:  # the rotor needs an inertia of its own
        best["armature"] = max(best["armature"], 0.05 * scales.inertia)
    return [{**best, **dict(zip(geared, one, strict=True))} for one in product(*geared.values())], left


def _restarts(
    structure: Structure, values: Mapping[str, float], free: Collection[str]
) -> list[dict[str, float]]:
    """Return other starts of effects whose parameters may have lost their gradient."""
    return [
        {f"{part.name}.{name}": value for name, value in again.items()}
        for part in structure.parts
        if isinstance(part, TorqueEffect)
        and part.restarts
        and {f"{part.name}.{n}" for n in part.parameter_names} <= {*free}
        for again in part.restarts(part.of(values))
    ]


def _result(chain: Sequence[tuple[Problem, Minimum]], *, quick: bool) -> DrivenFit:
    """Return the fit of the whole log; if its residuals are correlated, the windows with the narrowest intervals give the parameters."""
    problem, found = chain[-1]
    log, structure, free = problem.log, problem.structure, problem.free
    rest = problem.residuals(found.point, slopes=False)[0]
    whole = np.concatenate(rest) * log.std
    noise = residual_noise([r * log.std for r in rest])
    vector, method = problem.vector(found.point), "output error"
    covariance = np.full((len(free),) * 2, np.nan)
    if not quick:
        covariance = problem.covariance(found)
        if len(chain) > 1 and not _is_noise(noise):
            vector, covariance, windows = _weighed(chain, covariance)
            method = f"output error over {windows} windows"
    values = dict(zip(structure.parameters, vector.tolist(), strict=True))
    quantities = {
        name: Quantity(
            values[name],
            math.nan if quick else math.sqrt(max(covariance[i, i], 0.0)),
            slide_unit(structure.parameters[name]) if log.slides else structure.parameters[name],
            method,
        )
        for i, name in enumerate(free)
    }
    n, rmse = len(whole), float(np.sqrt(np.mean(whole**2)))
    score = n * math.log(max(noise.innovation, 1e-300)) + (len(free) + structure.states) * math.log(n)
    return DrivenFit(
        log=log, structure=structure, values=values, quantities=quantities, covariance=covariance, rmse=rmse,
        noise=min(log.std, rmse), colour=noise, score=score, residual=whole, problem=problem, point=found.point,
    )  # fmt: skip


def _shorter(one: tuple[Problem, Minimum]) -> list[tuple[Problem, Minimum, Array]]:
    """Return fits over more and more windows, with their covariances, the one given last: until intervals stop narrowing."""
    found = [(*one, one[0].covariance(one[1]))]
    while len(one[0].log.time) >= SHORTEST * FEWER * one[0].windows:
        problem = replace(one[0], values=_values(one), windows=FEWER * one[0].windows)
        one = problem, problem.fitted()
        if not np.isfinite(one[1].normal.cost):
            break
        found.insert(0, (*one, problem.covariance(one[1])))
        if _sharpness(found[0][2], found[1][2]) > 0:
            break
    return found


def _sharpness(covariance: Array, other: Array) -> float:
    """Return the sum of ln of variances over those of another covariance: negative if it is the narrower one."""
    with np.errstate(all="ignore"):
        ratios = np.log(np.diag(covariance) / np.diag(other))
    return float(np.sum(ratios[np.isfinite(ratios)]))


def _weighed(chain: Sequence[tuple[Problem, Minimum]], last: Array) -> tuple[Array, Array, int]:
    """Return all parameters, shape (q,), and the covariance of the free ones, shape (p, p), in SI, of the best number of windows.

    It is the number whose intervals are narrowest. If other numbers disagree, deviations grow by the scale factor
    √(χ²/(N - 1)) of a weighted mean (Particle Data Group).
    """
    found = [*_shorter(chain[0]), *((p, m, p.covariance(m)) for p, m in chain[1:-1]), (*chain[-1], last)]
    names = list(chain[0][0].structure.parameters)
    free = [names.index(name) for name in chain[0][0].free]
    best = min(found, key=lambda one: _sharpness(one[2], last))
    variances = np.array([np.diag(covariance) for *_, covariance in found])
    values = np.array([problem.vector(minimum.point)[free] for problem, minimum, _ in found])
    with np.errstate(all="ignore"):
        mean = np.nansum(values / variances, axis=0) / np.nansum(1 / variances, axis=0)
        factor = np.sqrt(np.nansum((values - mean) ** 2 / variances, axis=0) / (len(found) - 1))
    factor = np.where(np.isfinite(factor), np.maximum(factor, 1.0), 1.0)
    return best[0].vector(best[1].point), best[2] * np.outer(factor, factor), best[0].windows
