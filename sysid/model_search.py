"""Every model that the catalogue can make of some releases: effects alone, in pairs, and neighbours of the best.

Searching one effect at a time is not enough: an effect may look useless until another one is there.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.effects import catalogue
from sysid.effects.base import Scales
from sysid.fit_problem import Bias, Problem, Record
from sysid.fit_search import replace_records, search
from sysid.joint_flow import structure_of
from sysid.least_squares import Minimum, minimise
from sysid.roll import Array

COARSE, FINE = 24, 60
"""Integration steps per period while screening and in the end."""
POLISHED = 1e-5
"""Relative fall of the cost that ends a final fit: a hundredth of a standard deviation."""
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
        states = self.problem.own - 2 - (self.problem.bias == "own")
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
    workers: int = 2
    progress: Progress | None = None

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

    def alone(self, effects: Sequence[str], steps: int = COARSE) -> Model:
        """Search one model from the catalogue's own starts."""
        problem, minimum, _ = search(
            structure_of(effects), self.records, self.scales, bias=self.bias, steps_per_period=steps,
            fixed={**defaults(effects), **self.fixed}, average=self.average,
        )  # fmt: skip
        return Model(effects=tuple(sorted(effects)), problem=problem, minimum=minimum)

    def joined(self, one: Model, other: Model) -> Model:
        """Search the union of two models from what both found, and from one with a little of the other."""
        effects = tuple(sorted({*one.effects, *other.effects}))
        problem = Problem(
            structure_of(effects), self.records, self.scales, bias=self.bias, steps_per_period=COARSE,
            fixed={**defaults(effects), **self.fixed}, average=self.average,
            free_states=one.problem.free_states or other.problem.free_states,
        )  # fmt: skip
        own = {**self._small(effects)}
        starts = [
            {**own, **other.parameters, **one.parameters},
            {**own, **one.parameters, **other.parameters},
            {**own, **one.parameters},
            {**own, **other.parameters},
        ]
        trials: list[Minimum] = []
        for start in starts:
            point = problem.start(start)
            trials.append(minimise(problem.normal, point, *problem.bounds(), iterations=4, tolerance=1e-3))
        trials.sort(key=lambda trial: trial.normal.cost)
        small = max(
            1e-5, 0.2 / problem.samples
        )  # at the noise: a tenth of what one parameter gains by chance
        best = [
            minimise(problem.normal, trial.point, *problem.bounds(), iterations=14, tolerance=small)
            for trial in trials[: 2 if trials[1].normal.cost < 1.3 * trials[0].normal.cost else 1]
        ]
        return Model(effects=effects, problem=problem, minimum=min(best, key=lambda m: m.normal.cost))

    def _small(self, effects: Iterable[str]) -> dict[str, float]:
        parts = structure_of(tuple(effects)).parts
        return {f"{e.name}.{p.name}": p.starts[0] * p.size(self.scales) for e in parts for p in e.parameters}

    def polished(self, model: Model) -> Model:
        """Refine a model on the fine grid, and see whether free internal states at release fit better."""
        kinked = any(name in ("end-stop", "freeplay", "hysteresis") for name in model.effects)
        fine = Problem(
            model.problem.structure, self.records, self.scales, bias=self.bias, fixed=model.problem.fixed,
            steps_per_period=FINE * (3 if kinked else 1), free_states=model.problem.free_states,
        )  # fmt: skip
        minimum = minimise(
            fine.normal, model.minimum.point, *fine.bounds(), iterations=30, tolerance=POLISHED
        )
        result = Model(effects=model.effects, problem=fine, minimum=minimum)
        states = len(fine.structure.memories)
        if not states or fine.free_states:
            return result
        freed = Problem(
            fine.structure, self.records, self.scales, bias=self.bias, fixed=fine.fixed,
            steps_per_period=fine.steps_per_period, free_states=True,
        )  # fmt: skip
        start = freed.start(result.parameters)
        start[: len(fine.names)] = minimum.point[: len(fine.names)]
        other = Model(
            effects=model.effects, problem=freed,
            minimum=minimise(freed.normal, start, *freed.bounds(), iterations=30, tolerance=POLISHED),
        )  # fmt: skip
        gain = (result.chi2 - other.chi2) / max(other.chi2 / freed.samples, 1e-300)
        return other if gain > 12.0 * states * len(self.records) else result

    def each(self, what: str, jobs: Sequence[Callable[[], Model]], begin: float, end: float) -> list[Model]:
        """Run jobs on all workers; CasADi computes outside Python's lock."""
        results: list[Model] = []
        with ThreadPoolExecutor(self.workers) as pool:
            for count, model in enumerate(pool.map(_run, jobs), start=1):
                results.append(model)
                if self.progress is not None:
                    self.progress(what, begin + (end - begin) * count / len(jobs))
        return results

    def singles(self) -> list[Model]:
        """Fit the linear joint and every effect alone; the linear joint comes first."""
        jobs = [
            lambda names=names: self.alone(names)
            for names in [self.base, *((*self.base, n) for n in self.names())]
        ]
        return self.each("effects alone", jobs, 0.0, 0.25)

    def pairs(self, singles: Sequence[Model], among: Sequence[Model] | None = None) -> list[Model]:
        """Fit every pair of effects, or every pair with one of `among`."""
        wanted = [
            (a, b)
            for a, b in itertools.combinations(singles[1:], 2)
            if not any(pair <= {*a.effects, *b.effects} for pair in _NESTED)
            and (among is None or a in among or b in among)
        ]
        return self.each("pairs", [lambda a=a, b=b: self.joined(a, b) for a, b in wanted], 0.25, 0.75)

    def neighbours(self, best: Sequence[Model], singles: Sequence[Model]) -> list[Model]:
        """Fit the best models with one effect more."""
        wanted = {
            tuple(sorted((*model.effects, *single.effects))): (model, single)
            for model in best
            for single in singles[1:]
            if not set(single.effects) <= set(model.effects)
            and not any(pair <= {*model.effects, *single.effects} for pair in _NESTED)
        }
        jobs = [lambda a=a, b=b: self.joined(a, b) for a, b in wanted.values()]
        return self.each("neighbours of the best", jobs, 0.75, 0.8)

    def reduced(self, models: Sequence[Model], found: Sequence[Model]) -> list[Model]:
        """Re-fit every model with one effect less than one of `models`, started from what that one found.

        A slider or a stop searched alone may end in a false valley that its pair has left.

        Returns:
            `found`, with those replaced or added that came out better.
        """
        wanted = [
            (model, tuple(n for n in model.effects if n != name))
            for model in models
            for name in model.effects
            if name not in self.base
        ]
        jobs = [lambda m=m, n=n: self._without(m, n) for m, n in wanted if len(n) > len(self.base)]
        best = {m.effects: m for m in found}
        for model in self.each("taking effects away again", jobs, 0.8, 0.85):
            known = best.get(model.effects)
            if known is None or model.chi2 < known.chi2:
                best[model.effects] = model
        return list(best.values())

    def _without(self, model: Model, effects: tuple[str, ...]) -> Model:
        """Fit some of a model's effects, each start and each parameter where the model had it."""
        larger = model.problem
        problem = Problem(
            structure_of(effects), self.records, self.scales, bias=self.bias, steps_per_period=COARSE,
            fixed={**defaults(effects), **self.fixed}, average=self.average, free_states=larger.free_states,
        )  # fmt: skip
        start = problem.start(model.parameters)
        for index in range(len(self.records)):
            mine, its = len(problem.names) + index * problem.own, len(larger.names) + index * larger.own
            start[mine : mine + 2] = model.minimum.point[its : its + 2]
        minimum = minimise(problem.normal, start, *problem.bounds(), iterations=20, tolerance=1e-5)
        return Model(effects=effects, problem=problem, minimum=minimum)

    def predicted(self, model: Model) -> Model:
        """Return the model with its held-out residuals."""
        if len(self.records) == 1:
            return replace(model, heldout=(self._forecast(model),))
        return replace(
            model, heldout=tuple(self._left_out(model, index) for index in range(len(self.records)))
        )

    def _left_out(self, model: Model, index: int) -> Array:
        """Fit the physics to the other releases, then only roll and rate at release to this one."""
        problem, shared, own = model.problem, len(model.problem.names), model.problem.own
        others = [i for i in range(len(self.records)) if i != index]
        training = replace_records(problem, [self.records[i] for i in others])
        pick = np.r_[0:shared, *(np.arange(shared + i * own, shared + (i + 1) * own) for i in others)]
        fitted = minimise(
            training.normal, model.minimum.point[pick], *training.bounds(), iterations=10, tolerance=1e-5
        )
        held = Problem(
            problem.structure, [self.records[index]], self.scales, bias=self.bias,
            fixed={**problem.fixed, **training.parameters(fitted.point)},
            free_states=problem.free_states, steps_per_period=problem.steps_per_period,
        )  # fmt: skip
        start = model.minimum.point[shared + index * own : shared + (index + 1) * own]
        found = minimise(held.normal, start, *held.bounds(), iterations=12)
        return held.residuals(found.point)[0]

    def _forecast(self, model: Model) -> Array:
        """Fit the first half of the motion and predict the second."""
        problem, record = model.problem, self.records[0]
        half = len(record.time) // 2
        first = replace(record, time=record.time[:half], signal=record.signal[:half])
        training = replace_records(problem, [first])
        fitted = minimise(training.normal, model.minimum.point, *training.bounds(), iterations=25)
        return problem.residuals(fitted.point)[0][half:]


def _run(job: Callable[[], Model]) -> Model:
    return job()
