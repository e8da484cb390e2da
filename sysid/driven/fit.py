"""The fit of a driven joint: starts from its missing torque, then output error over the whole log."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from sysid.driven.joint import BASE, Simulator, Structure
from sysid.driven.log import DrivenLog
from sysid.driven.missing import linear_start
from sysid.driven.problem import Problem, scales_of
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
Fitted = tuple[Problem, Minimum]
"""A problem and its minimum."""
Chain = list[Fitted]
"""Fits over fewer and fewer windows; the last is that of the whole log."""
MATTERS = 0.1
"""Share of the residual's RMS that an effect must explain to be named: less is significant in a long log, but too small to matter."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenFit:
    """A driven joint fitted to one log."""

    problem: Problem
    """The least squares of the whole log."""
    point: Array
    """Its unknowns at the minimum, in units of their sizes, shape (p,)."""
    residual: Array
    """Measured less simulated there [rad], shape (n,)."""
    values: Mapping[str, float]
    """All parameters."""
    quantities: Mapping[str, Quantity]
    """The fitted ones."""
    covariance: Array
    """Of the fitted ones in their order and units, shape (p, p)."""

    @property
    def log(self) -> DrivenLog:
        """The log."""
        return self.problem.log

    @property
    def structure(self) -> Structure:
        """Effects of the joint."""
        return self.problem.structure

    @cached_property
    def rmse(self) -> float:
        """RMS of measured less simulated [rad]."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def noise(self) -> float:
        """Noise of the log [rad]."""
        return min(self.log.std, self.rmse)

    @cached_property
    def colour(self) -> ResidualNoise:
        """Autoregression of the residuals."""
        return residual_noise([self.residual])

    @property
    def score(self) -> float:
        """-2 log likelihood of correlated residuals, plus ln n for each parameter."""
        n, unknowns = len(self.residual), len(self.quantities) + self.structure.states
        return n * math.log(max(self.colour.innovation, 1e-300)) + unknowns * math.log(n)

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

    def continued(self, problem: Problem) -> "DrivenFit":
        """Return the quick fit of a problem that differs little, from this minimum on."""
        found = problem.fitted(self.point * self.problem.sizes / problem.sizes)
        return _result([(problem, found)], quick=True)

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
    problem: Problem, *, begins: Sequence[Mapping[str, float]] = (), quick: bool = False,
    simulator: Simulator | None = None,
) -> DrivenFit:  # fmt: skip
    """Fit the free parameters of a problem to the whole log by output error.

    Args:
        problem: Its values are those that are known, in SI; others begin neutral.
        begins: Starts of all parameters, where they are known; each is tried.
        quick: Skip the interval, and the search for better minima.
        simulator: Of a model that may have made the log; the likelier of it and nature is fitted.

    Raises:
        SysidError: The motion runs away from everywhere that was tried.
    """
    structure = problem.structure.checked()
    if not quick:
        problem = replace(problem, log=with_likelier_input(problem, begins=begins, simulator=simulator))
    log = problem.log
    problem = replace(problem, values=start_values(structure, problem.values, log))
    found = begins or starts(problem)[0]
    if structure.gear is not None and len(found) > 1:
        found = begins = _deepest(problem, found)
    windows, iterations = [1] if begins else windows_of(problem), 12 if quick else 40
    chains = [_chain(problem, one, windows, iterations) for one in found]
    chains = [chain for chain in chains if chain and chain[-1][0].windows == 1]
    if not chains:
        raise SysidError(
            f"{log.name}: the simulated motion runs away wherever the fit starts. Check the input's unit and sign, and the gains."
        )
    best = min(chains, key=_cost)
    if simulator is not None and structure.gear is None and simulator.steps(log.step):
        moved = replace(structure, simulator=None if structure.simulator else simulator)
        other = _chain(replace(problem, structure=moved), _values(best[-1]), windows, iterations)
        if other and _cost(other) < _cost(best):
            best = other
    if not quick:
        likelier = replace(best[-1][0], values=_values(best[-1]))
        again = [
            _chain(likelier, {**likelier.values, **other}, windows_of(likelier))
            for other in _restarts(likelier)
        ]
        best = min((one for one in (best, *again) if one and one[-1][0].windows == 1), key=_cost)
        best = _refined(best)
    return _result(best, quick=quick)


def with_likelier_input(problem: Problem, **options: Any) -> DrivenLog:
    """Return a log whose input is held or smooth between samples, the likelier of both; `options` are those of `fit`."""
    log = problem.log
    if log.held is not None:
        return log
    tried = (replace(problem, log=replace(log, held=held)) for held in (True, False))
    return min((fit(one, quick=True, **options) for one in tried), key=lambda one: one.score).log


def windows_of(problem: Problem) -> list[int]:
    """Return numbers of windows, from windows of about a period of the joint's fastest motion to the whole log."""
    log = problem.log
    periods = log.duration * problem.scales.frequency / (2 * math.pi)
    most = max(1.0, min(periods, len(log.time) / SHORTEST))
    return [FEWER**power for power in range(int(math.log(most, FEWER)), -1, -1)]


def _refined(chain: Chain) -> Chain:
    """Return a chain whose last fit has finer steps, as intervals may be narrower than the error of a step.

    If its residuals are correlated, fits over more windows come before it.
    """
    problem, found = chain[-1]
    fine = replace(problem, values=_values(chain[-1]), finer=FINER)
    again = fine.fitted(found.point * problem.sizes / fine.sizes, iterations=8)
    last = (fine, again) if np.isfinite(again.normal.cost) else chain[-1]
    before = chain[:-1]
    if not before and not _is_noise(residual_noise(last[0].residuals(last[1].point, slopes=False)[0])):
        before = _chain(replace(problem, finer=1), fine.values, windows_of(fine)[:-1], 40)
    return [*before, last]


def _deepest(problem: Problem, found: Sequence[Mapping[str, float]]) -> list[Mapping[str, float]]:
    """Return the deepest of the valleys of a gear, one of each start, over short windows."""
    windows = windows_of(replace(problem, values=found[0]))[:-1]
    valleys = [chain for one in found if (chain := _chain(problem, one, windows, 10))]
    return [_values(min(valleys, key=_cost)[-1])] if valleys else list(found)


def _chain(
    problem: Problem, begin: Mapping[str, float], windows: Sequence[int], iterations: int = 12
) -> Chain:
    """Return fits over fewer and fewer windows, each from the one before."""
    chain: Chain = []
    for number in windows:
        one = replace(problem, values=begin, windows=number)
        found = one.fitted(iterations=iterations if number > 1 else 40)
        if np.isfinite(found.normal.cost):
            chain.append((one, found))
            begin = _values(chain[-1])
    return chain


def _cost(chain: Chain) -> float:
    """Return the cost of a chain's last fit [1]."""
    return chain[-1][1].normal.cost


def _values(one: Fitted) -> dict[str, float]:
    """Return all parameters of a fit."""
    problem, found = one
    return dict(zip(problem.structure.parameters, problem.vector(found.point).tolist(), strict=True))


def starts(problem: Problem, known: Collection[str] = ()) -> tuple[list[dict[str, float]], float]:
    """Return starting values, of each combination of the effects' starts those that leave the least torque missing; and that [N*m].

    A gear does not show in the missing torque: each of its starts is tried.

    Args:
        known: Parameters whose value is a start already.
    """
    scales, values, free = problem.scales, problem.values, problem.free
    choices: dict[str, list[float]] = {}
    geared: dict[str, list[float]] = {}
    for part in problem.structure.parts:
        hidden = (isinstance(part, DriveEffect) and part.transmit is not None) or bool(part.states)
        for p in part.parameters:
            name = f"{part.name}.{p.name}"
            if name in free and name not in known and not (isinstance(part, DriveEffect) and part.sources):
                begins = [float(np.clip(s * p.size(scales), *problem.limits_of(name))) for s in p.starts]
                (geared if hidden else choices)[name] = begins
    linear = tuple(n for n in free if n not in geared)
    tried: list[tuple[float, dict[str, float]]] = []
    left = 0.0
    for one in product(*choices.values()):
        begin = {**values, **dict(zip(choices, one, strict=True))}
        for _ in range(2 if len(choices) < 3 else 1):
            begin, left = linear_start(problem, begin, linear)
        tried.append((left, begin))
    left, best = min(tried, key=lambda pair: pair[0])
    if problem.structure.gear is not None:  # the rotor needs an inertia of its own
        best["armature"] = max(best["armature"], 0.05 * scales.inertia)
    return [{**best, **dict(zip(geared, one, strict=True))} for one in product(*geared.values())], left


def _restarts(problem: Problem) -> list[dict[str, float]]:
    """Return other starts of effects whose parameters may have lost their gradient."""
    return [
        {f"{part.name}.{name}": value for name, value in again.items()}
        for part in problem.structure.parts
        if isinstance(part, TorqueEffect)
        and part.restarts
        and {f"{part.name}.{n}" for n in part.parameter_names} <= {*problem.free}
        for again in part.restarts(part.of(problem.values))
    ]


def _result(chain: Chain, *, quick: bool) -> DrivenFit:
    """Return the fit of the whole log; if its residuals are correlated, the windows with the narrowest intervals give the parameters."""
    problem, found = chain[-1]
    log, structure, free = problem.log, problem.structure, problem.free
    residual = problem.residuals(found.point, slopes=False)[0][0] * log.std
    vector, method = problem.vector(found.point), "output error"
    covariance = np.full((len(free),) * 2, np.nan)
    if not quick:
        covariance = problem.covariance(found)
        if len(chain) > 1 and not _is_noise(residual_noise([residual])):
            vector, covariance, windows = _weighed(chain, covariance)
            method = f"output error over {windows} windows"
    values = dict(zip(structure.parameters, vector.tolist(), strict=True))
    quantities = {
        name: Quantity(
            values[name],
            math.sqrt(max(covariance[i, i], 0.0)),
            slide_unit(structure.parameters[name]) if log.slides else structure.parameters[name],
            method,
        )
        for i, name in enumerate(free)
    }
    return DrivenFit(
        problem=problem, point=found.point, residual=residual, values=values, quantities=quantities, covariance=covariance
    )  # fmt: skip


def _shorter(one: Fitted) -> list[tuple[Problem, Minimum, Array]]:
    """Return fits over more and more windows, down to `SHORTEST` samples, with their covariances; the one given is last."""
    found = [(*one, one[0].covariance(one[1]))]
    while len(one[0].log.time) >= SHORTEST * FEWER * one[0].windows:
        problem = replace(one[0], values=_values(one), windows=FEWER * one[0].windows)
        one = problem, problem.fitted()
        if not np.isfinite(one[1].normal.cost):
            break
        found.insert(0, (*one, problem.covariance(one[1])))
    return found


def _sharpness(covariance: Array, other: Array) -> float:
    """Return the sum of ln of variances over those of another covariance: negative if it is the narrower one."""
    with np.errstate(all="ignore"):
        ratios = np.log(np.diag(covariance) / np.diag(other))
    return float(np.sum(ratios[np.isfinite(ratios)]))


def _weighed(chain: Chain, last: Array) -> tuple[Array, Array, int]:
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
