"""Every model that the catalogue can make of some releases: effects alone, in pairs, and neighbours of the best.

Searching one effect at a time is not enough: an effect may look useless until another one is there.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from sysid.diagnosis.workers import Crew
from sysid.effects import catalogue
from sysid.effects._base import Scales
from sysid.fitting.cross_validation import heldout_residuals
from sysid.fitting.problem import Problem
from sysid.fitting.records import Bias, Record
from sysid.fitting.search import first_swings, search
from sysid.joint.structure import structure_of
from sysid.least_squares import Minimum, minimise
from sysid.roll import Array

COARSE, FINE = 16, 32
"""Integration steps per period while screening and in the end, where the law is smooth. A sharp law gets as many times
more as it needs in the end, and half as many again at most while screening: less than ten of χ² then."""
POLISHED = 1e-5
"""Relative fall of the cost that ends a final fit: a hundredth of a standard deviation."""
KEPT, FAR = 6, 60.0
"""A union is given up when this many others have reached less than it promises, by that much of χ²."""
STARTS = 3
"""Starts tried of an effect that joins another."""
EARLY = 4.0
"""Periods of each release by which starts are ranked."""
FRICTIONLESS = 0.4
"""Share of a model's damping that is left to it where dry friction joins."""
WIDE = 0.6
"""Tilt from which the sine of gravity bends enough to tell it from a stiffness [rad]."""
_NESTED = ({"coulomb", "stribeck"}, {"sensor-drift", "lowpass"})
"""Pairs that make no sense: one contains the other, or both are the sensor's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """One fitted model."""

    effects: tuple[str, ...]
    problem: Problem = field(repr=False)
    minimum: Minimum = field(repr=False)
    heldout: tuple[Array, ...] | None = None
    """Residuals of each release, predicted without it [rad]; of its second half, if there is only one."""

    @property
    def chi2(self) -> float:
        """Sum of squared residuals in units of the noise floor; what averaging hid is taken for noise."""
        return 2.0 * self.minimum.normal.cost + self.samples - self.problem.samples

    @property
    def samples(self) -> int:
        """Number of samples that were fitted, singly or averaged."""
        return sum(len(record.time) for record in self.problem.records)

    @property
    def size(self) -> int:
        """Number of parameters of the physics, and of internal states beyond roll and rate that were fitted."""
        states = self.problem.n_local - 2 - (self.problem.bias == "per-release")
        return len(self.problem.names) + states * len(self.problem.records)

    @property
    def parameters(self) -> Mapping[str, float]:
        """Fitted parameters by name."""
        return self.problem.parameters(self.minimum.point)

    @property
    def residuals(self) -> list[Array]:
        """Model minus measurement of each release."""
        return self.problem.residuals(self.minimum.point)

    @property
    def rmse(self) -> float:
        """Root mean square residual."""
        squares = self.chi2 - self.problem.start_penalty(self.minimum.point)
        return float(np.sqrt(squares / self.samples)) * self.problem.records[0].std

    @property
    def heldout_rmse(self) -> float:
        """Root mean square residual of what was predicted; inf before that was done."""
        if self.heldout is None:
            return float("inf")
        return float(np.sqrt(np.mean(np.concatenate(self.heldout) ** 2)))


def defaults(effects: Iterable[str]) -> dict[str, float]:
    """Return the parameters that are left at their defaults while searching: refinements of an effect."""
    parts = structure_of(tuple(effects)).parts
    return {f"{e.name}.{p.name}": p.default for e in parts for p in e.parameters if p.default is not None}


Progress = Callable[[str, float], None]
"""Called with what is being done and the share that is done."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Searcher:
    """Fits models to the records of one problem."""

    records: tuple[Record, ...]
    scales: Scales
    bias: Bias
    base: tuple[str, ...] = ()
    """Effects that the board's record has already: every model has them."""
    fixed: Mapping[str, float] = field(default_factory=dict[str, float])
    """Parameters held in every model."""
    crew: Crew = field(default_factory=lambda: Crew(1), repr=False)
    progress: Progress | None = None

    def __getstate__(self) -> dict[str, object]:
        """Leave crew and progress at home when a job goes to another process."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("crew", "progress")}

    def __setstate__(self, state: dict[str, object]) -> None:
        """Take up the work alone."""
        for name, value in {**state, "crew": Crew(1), "progress": None}.items():
            object.__setattr__(self, name, value)

    @property
    def average(self) -> int:
        """Samples averaged while screening: what leaves forty a period."""
        period = 2 * np.pi / self.scales.frequency
        step = float(np.median(np.diff(self.records[0].time)))
        return max(1, int(period / step / 40))

    def names(self) -> list[str]:
        """Return the effects that a free decay can show, which are worth a fit here."""
        known = catalogue()
        chosen = [n for n, e in known.items() if e.role in ("torque", "support")]
        chosen += ["lowpass", "sensor-drift"] if self.bias == "shared" else []
        if self.scales.amplitude < WIDE:
            chosen.remove("gravity")
        return sorted(set(chosen) - set(self.base))

    def alone(self, effects: Sequence[str]) -> Model:
        """Search one model from the catalogue's own starts."""
        problem, minimum, _ = search(
            structure_of(effects), self.records, self.scales, bias=self.bias, steps_per_period=_coarse(effects),
            fixed={**defaults(effects), **self.fixed}, average=self.average,
        )  # fmt: skip
        return Model(effects=tuple(sorted(effects)), problem=problem, minimum=minimum)

    def joined(self, one: Model, other: Model) -> Model:
        """Search the union of two models from what both found, and from one with a little of the other."""
        return self.finished(self.glimpsed(one, other))

    def glimpsed(self, one: Model, other: Model) -> Model:
        """Return the union of two models after a few steps from the better of its starts."""
        effects = tuple(sorted({*one.effects, *other.effects}))
        problem = Problem(
            structure_of(effects), self.records, self.scales, bias=self.bias, steps_per_period=_coarse(effects),
            fixed={**defaults(effects), **self.fixed}, average=self.average,
            free_states=one.problem.free_states or other.problem.free_states,
        )  # fmt: skip
        starts = [{**other.parameters, **one.parameters}, {**one.parameters, **other.parameters}]
        for known in (one, other):
            new = set(effects) - set(known.effects)
            # A model without friction gave the damper all of the loss.
            left = FRICTIONLESS if structure_of(tuple(new)).has_dry_friction else 1.0
            damping = left * known.parameters["damping"]
            starts += [{**little, **known.parameters, "damping": damping} for little in self._little(new)]
        bounds = problem.bounds()
        # A start that is a little off is far off after many swings, so the first ones rank starts better, and sooner.
        early = problem.with_(records=[first_swings(r, self.scales, EARLY) for r in self.records])
        first = [minimise(early.normal, early.start(start), *bounds, iterations=1) for start in starts]
        first.sort(key=lambda trial: trial.normal.cost)
        trials = [
            minimise(problem.normal, trial.point, *bounds, iterations=4, tolerance=1e-3)
            for trial in first[:2]
        ]
        return Model(effects=effects, problem=problem, minimum=min(trials, key=lambda m: m.normal.cost))

    def finished(self, model: Model) -> Model:
        """Return a model that was only glimpsed with its fit brought to an end."""
        # At the noise, the tolerance is a tenth of what one parameter gains by chance.
        small = max(1e-5, 0.2 / model.problem.samples)
        minimum = minimise(
            model.problem.normal, model.minimum.point, *model.problem.bounds(), iterations=16, tolerance=small,
            known=model.minimum.normal,
        )  # fmt: skip
        return replace(model, minimum=minimum)

    def race(self, what: str, unions: Sequence[tuple[Model, Model]], begin: float, end: float) -> list[Model]:
        """Fit unions of models, the promising ones to the end.

        All take a few steps first. What the quadratic model of the cost still promises at best is a bound
        that errs on the hopeful side; a union whose promise is worse than what others have reached is left
        where it is.
        """
        if not unions:
            return []
        half = (begin + end) / 2
        seen = self.each(what, Searcher.glimpsed, unions, begin, half)
        waiting = sorted(seen, key=_promise)
        done: list[Model] = []
        batch = max(4, len(waiting) // 8)
        while waiting:
            reached = sorted(m.minimum.normal.cost for m in done)
            if len(reached) >= KEPT and 2 * _promise(waiting[0]) > 2 * reached[KEPT - 1] + FAR:
                break
            now, waiting = waiting[:batch], waiting[batch:]
            share = half + (end - half) * len(done) / len(seen)
            done += self.each(what, Searcher.finished, [(m,) for m in now], share, share)
        return [*done, *waiting]

    def _little(self, effects: Iterable[str]) -> list[dict[str, float]]:
        """Return the catalogue's starts of effects that join a model, a few where there are several valleys."""
        parameters = [(e, p) for e in structure_of(tuple(effects)).parts for p in e.parameters]
        choices = itertools.product(*(p.starts for _, p in parameters))
        return [
            {
                f"{e.name}.{p.name}": s * p.size(self.scales)
                for (e, p), s in zip(parameters, choice, strict=True)
            }
            for choice in itertools.islice(choices, STARTS)
        ]

    def polished(self, model: Model) -> Model:
        """Refine a model on the fine grid, and see whether free internal states at release fit better."""
        fine = model.problem.with_(steps_per_period=_fine(model.effects), average=1)
        minimum = minimise(
            fine.normal, model.minimum.point, *fine.bounds(), iterations=30, tolerance=POLISHED
        )
        result = Model(effects=model.effects, problem=fine, minimum=minimum)
        states = len(fine.structure.internal_states)
        if not states or fine.free_states:
            return result
        freed = fine.with_(free_states=True)
        start = freed.start(result.parameters)
        start[: len(fine.names)] = minimum.point[: len(fine.names)]
        other = Model(
            effects=model.effects, problem=freed,
            minimum=minimise(freed.normal, start, *freed.bounds(), iterations=30, tolerance=POLISHED),
        )  # fmt: skip
        gain = (result.chi2 - other.chi2) / max(other.chi2 / freed.samples, 1e-300)
        return other if gain > 12.0 * states * len(self.records) else result

    def each(
        self,
        what: str,
        job: Callable[..., Model],
        arguments: Sequence[tuple[object, ...]],
        begin: float,
        end: float,
    ) -> list[Model]:
        """Run one of the methods for each tuple of arguments, on all workers."""
        results: list[Model] = []
        for count, model in enumerate(self.crew.each(job, [(self, *one) for one in arguments]), start=1):
            model.problem.records = self.records  # not the copy that came back from another process
            results.append(model)
            if self.progress is not None:
                self.progress(what, begin + (end - begin) * count / len(arguments))
        return results

    def singles(self) -> list[Model]:
        """Fit the linear joint and every effect alone; the linear joint comes first."""
        wanted = [self.base, *((*self.base, name) for name in self.names())]
        return self.each("effects alone", Searcher.alone, [(names,) for names in wanted], 0.0, 0.25)

    def pairs(self, singles: Sequence[Model], among: Sequence[Model] | None = None) -> list[Model]:
        """Fit every pair of effects, or every pair with one of `among`."""
        wanted = [
            (a, b)
            for a, b in itertools.combinations(singles[1:], 2)
            if not any(pair <= {*a.effects, *b.effects} for pair in _NESTED)
            and (among is None or a in among or b in among)
        ]
        return self.race("pairs", wanted, 0.25, 0.75)

    def neighbours(self, best: Sequence[Model], singles: Sequence[Model]) -> list[Model]:
        """Fit the best models with one effect more."""
        wanted = {
            tuple(sorted((*model.effects, *single.effects))): (model, single)
            for model in best
            for single in singles[1:]
            if not set(single.effects) <= set(model.effects)
            and not any(pair <= {*model.effects, *single.effects} for pair in _NESTED)
        }
        return self.race("neighbours of the best", list(wanted.values()), 0.75, 0.8)

    def reduced(self, models: Sequence[Model], found: Sequence[Model]) -> list[Model]:
        """Re-fit every model that is one of `models` with an effect less, or simplified, from what that one found.

        A slider or a stop searched alone may end in a false valley that its pair has left. And some effects turn into
        simpler ones: a stop that carries nearly all of the stiffness is a freeplay, which says the same with one number.

        Returns:
            `found`, with those replaced or added that came out better.
        """
        jobs: list[tuple[Model, tuple[str, ...], Sequence[Mapping[str, float]]]] = []
        for model in models:
            for part in model.problem.structure.parts:
                if part.name in self.base:
                    continue
                rest = tuple(n for n in model.effects if n != part.name)
                if len(rest) > len(self.base):
                    jobs.append((model, rest, [{}]))
                for simpler, turned in part.limiting_cases:
                    starts = [] if simpler in model.effects else turned(model.parameters)
                    if starts:
                        jobs.append((model, tuple(sorted((*rest, simpler))), starts))
        best = {m.effects: m for m in found}
        for model in self.each("taking effects away again", Searcher.without, jobs, 0.8, 0.85):
            known = best.get(model.effects)
            if known is None or model.chi2 < known.chi2:
                best[model.effects] = model
        return list(best.values())

    def without(
        self, model: Model, effects: tuple[str, ...], changes: Sequence[Mapping[str, float]]
    ) -> Model:
        """Fit some of a model's effects, or simpler ones, each start and parameter where the model had it.

        Args:
            model: What was found.
            effects: Of the simpler model.
            changes: For each start, parameters that are elsewhere, or that the model did not have.
        """
        larger = model.problem
        problem = larger.with_(
            structure=structure_of(effects),
            steps_per_period=_coarse(effects),
            fixed={**defaults(effects), **self.fixed},
            average=self.average,
        )
        found: list[Minimum] = []
        for changed in changes:
            start = problem.start({**model.parameters, **changed})
            for index in range(len(self.records)):
                mine, its = (
                    len(problem.names) + index * problem.n_local,
                    len(larger.names) + index * larger.n_local,
                )
                start[mine : mine + 2] = model.minimum.point[its : its + 2]
            found.append(minimise(problem.normal, start, *problem.bounds(), iterations=20, tolerance=1e-5))
        return Model(effects=effects, problem=problem, minimum=min(found, key=lambda m: m.normal.cost))

    def finalist(self, model: Model) -> Model:
        """Return the model polished and with its held-out residuals."""
        return self.predicted(self.polished(model))

    def predicted(self, model: Model) -> Model:
        """Return the model with its held-out residuals."""
        return replace(model, heldout=heldout_residuals(model.problem, model.minimum))


def _coarse(effects: Sequence[str]) -> int:
    return int(COARSE * min(1.5, structure_of(effects).sharpness))


def _fine(effects: Sequence[str]) -> int:
    return int(FINE * structure_of(effects).sharpness)


def _promise(model: Model) -> float:
    """Return the cost that the quadratic model of it promises at best."""
    normal = model.minimum.normal
    if not np.isfinite(normal.cost):
        return float("inf")
    diagonal = np.maximum(np.diag(normal.hessian), 1e-12 * max(float(np.diag(normal.hessian).max()), 1e-300))
    scale = 1.0 / np.sqrt(diagonal)
    scaled = normal.hessian * np.outer(scale, scale) + 1e-3 * np.eye(len(scale))
    gradient = scale * np.where(model.minimum.at_bound, 0.0, normal.gradient)
    return normal.cost - 0.5 * float(gradient @ np.linalg.solve(scaled, gradient))
