"""Every model that the catalogue can make of some releases: effects alone, pairs of the best, and their neighbours.

Each is a full fit. A richer model starts from the optimum of each model that it contains, where what it has more
vanishes, besides starts of its own: so adding an effect never makes the error larger, whatever valleys there are.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from sysid.diagnosis.pendulum import hanging, hanging_start, sprung_start, weight
from sysid.diagnosis.workers import WorkerPool
from sysid.effects import catalogue, drifting, effect
from sysid.effects._base import Scales
from sysid.fitting.cross_validation import rms, surprising_residuals
from sysid.fitting.problem import Problem
from sysid.fitting.records import Bias, Record
from sysid.fitting.search import catalogue_starts, first_swings, followed, scouts, search
from sysid.joint.structure import structure_of
from sysid.least_squares import Minimum
from sysid.noise.whiteness import correlation_length
from sysid.roll import Array

COARSE, FINE = 24, 32
"""Integration steps per period while searching, the same for all so that costs compare; and in the end, times the
sharpness of the law."""
SAMPLES = 40
"""Samples per period that are kept: the fifth harmonic of the swing still has eight."""
PARENTS, FEW = 4, 2
"""Single effects, the best of their families, whose pairs with all others are tried; and if the best of them is at the noise already."""
AT_NOISE = 1.02
"""Error over the noise floor up to which a model is at the noise: a floor is known to a few percent."""
INEXACT = 1.5
"""Error over the noise from which even the best model is not exact: over the floor, and over what does not fade with the motion."""
STARTS = 3
"""Starts tried of an effect that joins another."""
EARLY = 4.0
"""Periods of each release by which starts are ranked."""
FRICTIONLESS = 0.4
"""Share of a model's damping that is left to it where dry friction joins."""
HANGS = 1.1
"""Ratio of squared errors up to which a joint with a spring beside gravity is no better than one without: 5 % of error."""
VARIANTS = 3
"""Models of one set of families that are predicted."""
ASIDE = (0.7, 1.5)
"""Factors of a nonsmooth effect's parameters from which it is searched again on the fine grid, where it is not at the noise."""
UNSETTLED = 8.0
"""Fall of χ², in units of what is left, for each internal state of each release from which the hold before it has not settled that."""
ASTRAY = 2.0
"""Squared error over the least after a few steps [1] up to which a start's promise is believed: a choice."""
TREMOR = 0.03
"""Share of the most that a state can be by which a hand that trembles keeps moved what would have settled while it held the deck: a choice."""
TRIED = 8
"""Iterations after which a start on the fine grid is given up that does not promise what another model has reached: a choice."""
AHEAD = 0.99
"""Ratio of squared errors in the first swings up to which a search that was begun aside is brought to its end."""
BEATEN, FAR = 6, 60.0
"""A union is given up when this many others have reached less than it promises, by that much of χ²."""
HOPELESS = 8.0
"""Error beyond the noise, squared, over the best model's, from which a model is not predicted: far beyond what is not told apart."""
LOST = 3.0
"""Squared error, over that with which a model is still predicted, from which its kinks are not searched again: a choice."""

Progress = Callable[[str, float], None]
_Simpler = tuple["Candidate", tuple[str, ...], Sequence[Mapping[str, float]]]
"""A model, effects of a simpler one, and for each start of that what is elsewhere, or what the model did not have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One fitted model."""

    effects: tuple[str, ...]
    problem: Problem = field(repr=False)
    minimum: Minimum = field(repr=False)
    heldout: tuple[Array, ...] | None = None
    """What is missed of each release, predicted without it [rad or rad/s]; of its thirds, if there is one only."""
    shape: str = ""
    """Of a torque outside the catalogue that it has besides, by its name in `sysid.diagnosis.surrogates`."""

    @property
    def heldout_rmse(self) -> float:
        """Root mean square of what is missed of held-out releases; inf where a prediction ran away."""
        if self.heldout is None:
            return float("inf")
        ran_away = any(np.abs(errors).max() >= 1e6 or np.isnan(errors).any() for errors in self.heldout)
        return float("inf") if ran_away else rms(self.heldout)

    @property
    def samples(self) -> int:
        """Number of samples that were fitted, singly or averaged."""
        return sum(len(record.time) for record in self.problem.records)

    @property
    def chi2(self) -> float:
        """Sum of squared residuals in units of the noise floor; what averaging hid is taken for noise."""
        return self.cost + self.samples - self.problem.samples

    @property
    def rmse(self) -> float:
        """Root mean square residual [rad or rad/s]."""
        squares = self.misfit + self.samples - self.problem.samples
        return float(np.sqrt(max(squares, 0.0) / self.samples)) * self.problem.records[0].std

    @property
    def cost(self) -> float:
        """Sum of squared residuals in units of the noise."""
        return 2.0 * self.minimum.normal.cost

    @property
    def misfit(self) -> float:
        """The same, without what starts cost that are too fast: predictions are not charged for those."""
        return self.cost - self.problem.start_penalty(self.minimum.point)

    @property
    def families(self) -> frozenset[str]:
        """What a practitioner would call its effects."""
        return frozenset(effect(name).family for name in self.effects)

    @property
    def size(self) -> int:
        """Number of parameters of the physics, and of internal states beyond roll and rate that were fitted."""
        states = self.problem.n_local - 2 - (self.problem.bias == "per-release")
        return len(self.problem.names) + states * len(self.problem.records)

    @property
    def at_edge(self) -> bool:
        """Whether it is at the edge of what an effect is, as far as the sensor's noise is known before any fit."""
        return self.edged(INEXACT * self.problem.records[0].std)

    def edged(self, exact: float) -> bool:
        """Return whether an effect ended where it is nothing of its own, a stop as a weak bend or an arm that never relaxes: another law is asked for.

        So it is where the spring is pushed out of rest, and an arm that never relaxes has its place. A share may be anything from
        none to all.

        Args:
            exact: Error up to which nothing but noise is left [rad or rad/s].
        """
        point = dict(zip(self.problem.names, self.minimum.point, strict=False))
        spring = self.parameters["stiffness"] + sum(
            part.stiffness_at(self.parameters.get("rest_angle", 0.0), part.of(self.parameters))
            for part in self.problem.structure.torques
        )  # fmt: skip
        scales, parts = self.problem.scales, self.problem.structure.parts
        idle = any(part.idle(part.of(self.parameters), scales) for part in parts if part.idle is not None)
        return spring < 0 or idle or any(
            p.edged(point[f"{part.name}.{p.name}"], exact=self.rmse < exact)
            for part in parts for p in part.parameters if f"{part.name}.{p.name}" in point
        )  # fmt: skip

    @property
    def parameters(self) -> Mapping[str, float]:
        """Parameters by name."""
        return self.problem.parameters(self.minimum.point)

    @property
    def residuals(self) -> list[Array]:
        """Model minus measurement of each release [rad or rad/s], shape (n,)."""
        return self.problem.residuals(self.minimum.point)


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """Fits candidates to the records of one problem."""

    records: tuple[Record, ...]
    scales: Scales
    bias: Bias
    base: tuple[str, ...] = ()
    """Effects that the board's record has already: every model has them."""
    fixed: Mapping[str, float] = field(default_factory=dict[str, float])
    """Parameters held in every model."""
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    """What the record knows of parameters that are not: value and standard deviation, in their units."""
    hangs: bool = False
    """Whether gravity takes the spring's place wherever it is."""
    pool: WorkerPool = field(default_factory=lambda: WorkerPool(1), repr=False)
    progress: Progress | None = None

    def __getstate__(self) -> dict[str, object]:
        """Leave pool and progress at home when a job goes to another process."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("pool", "progress")}

    def __setstate__(self, state: dict[str, object]) -> None:
        """Take up the work alone."""
        for name, value in {**state, "pool": WorkerPool(1), "progress": None}.items():
            object.__setattr__(self, name, value)

    @property
    def average(self) -> int:
        """Samples of which means are fitted."""
        period = 2 * np.pi / self.scales.frequency
        step = float(np.median(np.diff(self.records[0].time)))
        return max(1, int(period / step / SAMPLES))

    def names(self) -> list[str]:
        """Return the effects that a free decay can show, which are worth a fit here."""
        known = catalogue()
        # A zero that is free in each release leaves a rate no drift of its sensor, and a fused roll nothing to say of it.
        hidden = drifting() if self.records[0].is_rate else ()
        sensed = self.bias == "shared" or self.records[0].is_rate
        chosen = {
            n for n, e in known.items()
            if (sensed or e.role != "measurement") and e.role in ("torque", "support", "measurement")
            and e.minimum_amplitude <= self.scales.amplitude and e.identifiable_from_decay
            and "rest_angle" not in e.same_as and n not in hidden
        }  # fmt: skip
        # What sets the period is free already where it has a prior: by how far it is off, the record says (`against_record`).
        beside = (
            set()
            if self.priors
            else {n for n, e in known.items() if set(e.identifiable_with) & set(self.base)}
        )
        return sorted((chosen | beside) - set(self.base))

    def problem(self, effects: Sequence[str], *, free_states: bool = False) -> Problem:
        """Return the least squares of a model, on the coarse grid."""
        names, fixed = self._names_and_fixed(effects)
        return Problem(
            structure_of(names), self.records, self.scales, bias=self.bias, steps_per_period=COARSE, fixed=fixed,
            priors=self.priors, average=self.average, free_states=free_states,
        )  # fmt: skip

    def _names_and_fixed(self, effects: Sequence[str]) -> tuple[Sequence[str], Mapping[str, float]]:
        if not (self.hangs and weight() in effects):
            return effects, self.fixed
        return hanging(effects, self.fixed, fit_zero=self.bias == "shared" and not self.records[0].is_rate)

    def single(self, effects: Sequence[str], known: Candidate | None = None) -> Candidate:
        """Fit one model from the catalogue's own starts, and from a simpler one that is fitted already."""
        names, fixed = self._names_and_fixed(effects)
        problem, minimum, _ = search(
            structure_of(names), self.records, self.scales, bias=self.bias, steps_per_period=COARSE, fixed=fixed,
            priors=self.priors, average=self.average, exact=False,
        )  # fmt: skip
        if known is not None:
            start = inherited(problem, known)
            other = problem.fitted(start, 15, 1e-5)
            minimum = min(minimum, other, key=lambda m: m.normal.cost)
        return Candidate(effects=tuple(sorted(effects)), problem=problem, minimum=minimum)

    def union(self, one: Candidate, other: Candidate) -> Candidate:
        """Fit the union of two models."""
        return self.finished(self.begun(one, other), one, other)

    def begun(self, one: Candidate, other: Candidate) -> Candidate:
        """Return the union of two models after a few steps from the start that promises most: what adds nothing is soon at its best."""
        effects = tuple(sorted({*one.effects, *other.effects}))
        free = one.problem.free_states or other.problem.free_states
        problem = self.problem(effects, free_states=free)
        starts = [{**other.parameters, **one.parameters}, {**one.parameters, **other.parameters}]
        for known in (one, other):
            new = set(effects) - set(known.effects)
            # A model without friction gave the damper all of the loss.
            left = FRICTIONLESS if structure_of(tuple(new)).has_dry_friction else 1.0
            damping = left * known.parameters["damping"]
            starts += [{**little, **known.parameters, "damping": damping} for little in self._little(new)]
        # A start that is a little off is far off after many swings, so the first ones rank starts better, and sooner.
        kept, parents = scouts(self.records), [inherited(problem, known) for known in (one, other)]
        some = problem.with_(records=[self.records[i] for i in kept])
        early = some.with_(records=[first_swings(r, self.scales, EARLY) for r in some.records])
        first = [early.fitted(early.start(completed(early, start)), 1, 1e-7) for start in starts]
        chosen = [min(group, key=lambda m: m.normal.cost) for group in (first[:2], first[2:]) if group]
        points = [*(m.point for m in chosen), *(problem.of(kept, point)[1] for point in parents)]
        trials = [some.fitted(point, 4, 1e-3) for point in points]
        enough = ASTRAY * min(m.normal.cost for m in trials)
        best = min((m for m in trials if m.normal.cost <= enough), key=promise)
        if len(kept) < len(self.records):
            best = problem.fitted(followed(problem, parents[0], kept, best.point), 4, 1e-3)
        return Candidate(effects=effects, problem=problem, minimum=best)

    def finished(self, model: Candidate, *parents: Candidate) -> Candidate:
        """Return a model that was only begun with its fit brought to an end, no worse than what it contains."""
        problem = model.problem

        def small(cost: float) -> float:  # at the noise, a tenth of what chance gains
            return max(0.2 / problem.samples, problem.unnoticed(cost))

        found = problem.fitted(model.minimum.point, 16, small, model.minimum.normal)
        for known in parents:
            if known.minimum.normal.cost < found.normal.cost:
                again = problem.fitted(inherited(problem, known), 16, small)
                found = min(found, again, key=lambda m: m.normal.cost)
        return replace(model, minimum=found)

    def _little(self, effects: Iterable[str]) -> list[dict[str, float]]:
        """Return the catalogue's starts of effects that join a model, a few where there are several valleys."""
        return list(itertools.islice(catalogue_starts(structure_of(tuple(effects)), self.scales), STARTS))

    def each(
        self, what: str, job: Callable[..., Candidate], arguments: Sequence[tuple[object, ...]], begin: float, end: float
    ) -> list[Candidate]:  # fmt: skip
        """Run one of the methods for each tuple of arguments, on all workers."""
        results: list[Candidate] = []
        for count, model in enumerate(self.pool.each(job, [(self, *one) for one in arguments]), start=1):
            model.problem.records = self.records  # not the copy that came back from another process
            results.append(model)
            if self.progress is not None:
                name = ", ".join(model.effects) or "spring and damper"
                self.progress(f"{what}: {name}", begin + (end - begin) * count / len(arguments))
        return results

    def singles(self) -> list[Candidate]:
        """Fit the linear joint and every effect alone; the linear joint comes first."""
        linear = self.single(self.base)
        jobs = [((*self.base, name), linear) for name in self.names()]
        return [linear, *self.each("alone", Search.single, jobs, 0.0, 0.3)]

    def hung(self, singles: Sequence[Candidate]) -> tuple["Search", list[Candidate]]:
        """Let weight take the spring's place if it does as well alone as beside a spring, or the spring came out pushing."""
        names = tuple(sorted({*self.base, weight()}))
        both = next((m for m in singles if m.effects == names), None)
        if both is None or "stiffness" not in both.problem.names:
            return self, list(singles)
        other = replace(self, hangs=True)
        alone = other.single(names, singles[0])
        if alone.cost > HANGS * both.cost and both.parameters["stiffness"] > 0:
            return self, list(singles)
        if names == self.base:  # every one of them has the weight
            return other, other.singles()
        return other, [alone if m is both else m for m in singles]

    def unions(
        self, wanted: Sequence[tuple[Candidate, Candidate]], begin: float, end: float
    ) -> list[Candidate]:
        """Fit unions of models, the promising ones to the end.

        All take a few steps first. What the quadratic model of the cost still promises at best is a bound
        that errs on the hopeful side; a union whose promise is worse than what others have reached is left
        where it is.
        """
        if not wanted:
            return []
        half = (begin + end) / 2
        waiting = sorted(
            self.each("pair", Search.begun, wanted, begin, half), key=lambda m: promise(m.minimum)
        )
        parents = {tuple(sorted({*a.effects, *b.effects})): (a, b) for a, b in wanted}
        total, done = len(waiting), list[Candidate]()
        batch = max(4, total // 8)
        while waiting:
            reached = sorted(m.minimum.normal.cost for m in done)
            if len(reached) >= BEATEN and 2 * promise(waiting[0].minimum) > 2 * reached[BEATEN - 1] + FAR:
                break
            now, waiting = waiting[:batch], waiting[batch:]
            share = half + (end - half) * len(done) / total
            done += self.each("pair", Search.finished, [(m, *parents[m.effects]) for m in now], share, share)
        return [*done, *waiting]

    def added(self, model: Candidate) -> tuple[str, ...]:
        """Return the effects of a model that the record does not have."""
        return tuple(name for name in model.effects if name not in self.base)

    def at_noise(self, models: Sequence[Candidate]) -> Candidate | None:
        """Return the best of some models if it is at the noise, on the fine grid if only there."""
        best, enough = min(models, key=lambda m: m.cost), AT_NOISE * self.records[0].std
        best = best if best.rmse <= enough else self.fine(best, walk=False)
        return best if best.rmse <= enough else None

    def pairs(self, singles: Sequence[Candidate], reached: Candidate | None) -> list[Candidate]:
        """Fit the pairs of the best single effects with all others; if one is at the noise, of fewer, and what is no richer than it.

        Else every pair that is no richer than the best single effect too: what has three numbers mimics what two of one each do, and
        leaves either of them behind it.
        """
        best = best_of(leaders(singles[1:], frugality), PARENTS)
        if not reached:  # alone, a richer law takes over what another effect does beside the simpler one
            simpler = {name for part in best[0].problem.structure.parts for name, _ in part.limiting_cases}
            # The most frugal of the first family may lack what its best has, which then takes the place of another effect.
            own = min((m for m in singles[1:] if m.families == best[0].families), key=lambda m: m.cost)
            best += [m for m in singles[1:] if set(self.added(m)) <= simpler or m is own]
        wanted = {
            tuple(sorted({*a.effects, *b.effects})): (a, b)
            for i, a in enumerate(best) for b in singles[1:]
            if a is not b and _sensible(a, b)
            and (not reached or i < FEW or _choices(a) + _choices(b) - _choices(singles[0]) <= _choices(reached))
        }  # fmt: skip
        if not reached:
            most = _choices(min(inside(singles[1:]), key=lambda m: m.cost)) + _choices(singles[0])
            for a, b in itertools.combinations(singles[1:], 2):
                if _sensible(a, b) and _choices(a) + _choices(b) <= most:
                    wanted.setdefault(tuple(sorted({*a.effects, *b.effects})), (a, b))
        return self.unions(list(wanted.values()), 0.3, 0.7)

    def neighbours(self, best: Candidate, known: Sequence[Candidate]) -> list[Candidate]:
        """Fit the pairs that share an effect with the best one and were not tried yet."""
        done = {m.effects for m in known}
        single = {m.effects: m for m in known if len(m.effects) == len(self.base) + 1}
        halves = [m for names, m in single.items() if set(names) < set(best.effects)]
        wanted = {
            effects: (a, b)
            for a in halves for b in single.values()
            if (effects := tuple(sorted({*a.effects, *b.effects}))) not in done and a is not b and _sensible(a, b)
        }  # fmt: skip
        return self.unions(list(wanted.values()), 0.7, 0.8)

    def kinked(self, singles: Sequence[Candidate], reached: Candidate | None) -> list[Candidate]:
        """Search the pairs of the simplest dry friction and a stop or a gap from the catalogue's starts, the first swings first.

        Friction decides in which swing a stop is last met, so alone neither comes near to what it is beside the other. If one effect
        is at the noise, only those that are no richer than it: a Stribeck friction mimics a gap beside friction.
        """
        laws = [(m, structure_of(self.added(m))) for m in singles]
        rubbed = [m for m, law in laws if law.has_dry_friction]
        kinked = [m for m, law in laws if law.nonsmooth and not law.has_dry_friction and not law.states]
        one = min(rubbed, key=lambda m: m.size, default=None)
        most = _choices(reached) + _choices(singles[0]) if reached else np.inf
        jobs = [
            ((*one.effects, *self.added(m)), one)
            for m in kinked if one and _sensible(one, m) and _choices(one) + _choices(m) <= most
        ]  # fmt: skip
        return self.each("friction and", Search.single, jobs, 0.8, 0.8)

    def reduced(self, models: Sequence[Candidate], found: Sequence[Candidate]) -> list[Candidate]:
        """Re-fit every model that is one of `models` with an effect less, or simplified, from what that one found.

        Returns:
            `found`, with those replaced or added that came out better.
        """
        less = [
            (model, rest, [{}])
            for model in models
            for name in self.added(model)
            if len(rest := tuple(n for n in model.effects if n != name)) > len(self.base)
        ]
        jobs = [*less, *(job for model in models for job in self._simpler(model))]
        return _better(found, self.each("taking away again", Search.without, jobs, 0.8, 0.85))

    def simplified(
        self, models: Sequence[Candidate], found: Sequence[Candidate], share: float = 0.3
    ) -> list[Candidate]:
        """Re-fit every model as each simpler one that it nearly is, from what it found, if that one did not come as far.

        Args:
            models: What is simplified.
            found: What is known.
            share: Of the search that is done [1].

        Returns:
            `found`, with those replaced or added that came out better.
        """
        known = {m.effects: m.cost for m in found}
        jobs = [job for m in models for job in self._simpler(m) if known.get(job[1], np.inf) > m.cost]
        return _better(found, self.each("variants", Search.without, jobs, share, share))

    def _simpler(self, model: Candidate) -> Iterator["_Simpler"]:
        """Yield a model's simpler ones, each with its effects and starts."""
        for part in model.problem.structure.parts:
            rest = tuple(n for n in model.effects if n != part.name)
            for simpler, turned in part.limiting_cases if part.name in self.added(model) else ():
                starts = turned(model.parameters) if _compatible((*rest, simpler)) else []
                if starts:
                    yield model, tuple(sorted((*rest, simpler))), starts

    def without(
        self, model: Candidate, effects: tuple[str, ...], changes: Sequence[Mapping[str, float]]
    ) -> Candidate:
        """Fit some of a model's effects, or simpler ones, each start and parameter where the model had it.

        Args:
            model: What was found.
            effects: Of the simpler model.
            changes: For each start, parameters that are elsewhere, or that the model did not have.
        """
        problem = self.problem(effects, free_states=model.problem.free_states)
        found: list[Minimum] = []
        for changed in changes:
            start = problem.start(completed(problem, {**model.parameters, **changed}))
            take_motion(problem, start, model)
            found.append(problem.fitted(start, 20, 1e-5))
        return Candidate(effects=effects, problem=problem, minimum=min(found, key=lambda m: m.normal.cost))

    def finalists(self, models: Iterable[Candidate]) -> list[Candidate]:
        """Return those of some models that are in the running, fitted on the fine grid, simple ones first; not predicted yet."""
        done: dict[tuple[str, ...], Candidate] = {}
        models = list(models)
        lost = LOST * _hopeless(models)
        for _, group in itertools.groupby(sorted(models, key=_count), key=_count):
            jobs = [
                (m, [known for names, known in done.items() if set(names) < set(m.effects)], m.misfit < lost)
                for m in group
            ]
            share = 0.85 + 0.05 * (len(done) > 1)
            done.update({m.effects: m for m in self.each("refining", Search.fine, jobs, share, share + 0.02)})
        # A law may have found on this grid what its simpler variant missed on the other.
        groups = itertools.groupby(sorted(done.values(), key=_count), key=_count)
        best = [min(group, key=lambda m: m.cost) for _, group in groups]
        simpler = self.simplified(best, list(done.values()), 0.91)
        jobs = [(m,) for m in simpler if m.misfit < lost and m is not done.get(m.effects)]
        again = self.each("refining", Search.fine, jobs, 0.91, 0.92)
        done = {m.effects: m for m in _better(list(done.values()), again)}
        # What the best one needs not may have kept its own fit from the right valley.
        best = min(done.values(), key=lambda m: m.cost)
        again = [
            (m, [best], False)
            for names, m in done.items()
            if names != self.base and set(names) < set(best.effects)
        ]
        for model in self.each("refining", Search.fine, again, 0.92, 0.93):
            done[model.effects] = min(done[model.effects], model, key=lambda m: m.cost)
        ranked = sorted(done.values(), key=lambda m: m.cost)
        hopeless = _hopeless(ranked)
        # Of coloured noise many numbers more take much away: what the best one holds may be as likely.
        running = {
            m.effects
            for i, m in enumerate(ranked)
            if i < BEATEN or m.misfit < hopeless or set(m.effects) < set(ranked[0].effects)
        }
        return [m for m in done.values() if m.effects in running]

    def foretold(self, models: Sequence[Candidate]) -> list[Candidate]:
        """Return models with what they miss of held-out releases."""
        return self.each("predicting", Search.predicted, [(m,) for m in models], 0.93, 0.98)

    def finalist(self, model: Candidate) -> Candidate:
        """Return a model fitted on the fine grid, and its predictions."""
        return self.predicted(self.fine(model))

    def predicted(self, model: Candidate) -> Candidate:
        """Return a model with what it misses of held-out releases."""
        return replace(model, heldout=surprising_residuals(model.problem, model.minimum))

    def fine(
        self,
        model: Candidate,
        parents: Sequence[Candidate] = (),
        walk: bool = True,
        *,
        average: int | None = None,
    ) -> Candidate:
        """Return a model fitted on the fine grid.

        Args:
            model: Where it starts.
            parents: Other models, simpler or richer, whose optima are starts too.
            walk: Whether to search aside of its kinks too.
            average: Samples of which means are fitted; as in the search, and walked if asked for, if left out.
        """
        old = model.problem
        problem = Problem(
            old.structure, self.records, self.scales, bias=self.bias, fixed=old.fixed, priors=old.priors, free_states=old.free_states,
            steps_per_period=int(FINE * old.structure.sharpness), average=self.average if average is None else average,
        )  # fmt: skip
        start = np.clip(model.minimum.point, *problem.bounds())
        here, reached = problem.normal(start), min((k.minimum.normal.cost for k in parents), default=np.inf)
        best = problem.fitted(start, TRIED if here.cost > reached else 30, known=here)
        if here.cost > reached > promise(best):
            best = problem.fitted(best.point, 30, known=best.normal)
        for known in parents:
            if known.minimum.normal.cost < best.normal.cost:  # else it ends in no better valley
                best = min(best, problem.fitted(inherited(problem, known), 30), key=lambda m: m.normal.cost)
        walk = walk and average is None and old.structure.nonsmooth
        if walk and best.normal.cost > 0.55 * problem.samples:
            best = _walked(problem, best)
        return _freed(replace(model, problem=problem, minimum=best, heldout=None))


def _freed(model: Candidate) -> Candidate:
    """Return a model whose internal states begin anywhere, if that pays: a hand that trembles lets nothing settle."""
    states = len(model.problem.structure.internal_states) * len(model.problem.records)
    if not states or model.problem.free_states:
        return model
    problem = model.problem.with_(free_states=True)
    here = problem.fitted(inherited(problem, model), 0)
    if 2 * promise(here) > model.cost - UNSETTLED * states:
        return model
    freed = replace(model, problem=problem, minimum=problem.fitted(here.point, 20, known=here.normal))
    # What is left may be more than the floor, and last: then it holds fewer values, and larger ones.
    lasting = max(1.0, freed.cost / problem.samples * correlation_length(freed.residuals))
    pays = freed.cost < model.cost - UNSETTLED * states * lasting
    return freed if pays and _could_begin_so(freed) else model


def _could_begin_so(model: Candidate) -> bool:
    """Return whether no internal state begins where the motion and the hold before cannot have left it."""
    problem, parameters = model.problem, model.parameters
    parts = [(p, state) for p in problem.structure.parts if p.role != "measurement" for state in p.states]
    rates = np.array([state.settles(p.of(parameters)) if state.settles else 0.0 for p, state in parts])
    holds = np.array([[max(record.release.hold, 0.0)] for record in problem.records])
    begins, settled = (
        problem.own(point)[:, 2 : 2 + len(parts)]
        for point in (model.minimum.point, problem.start(parameters))
    )
    most = np.array([state.most for _, state in parts]) * (np.exp(-rates * holds) + TREMOR)
    return bool(np.all((np.abs(begins - settled) <= most) | (rates == 0.0)))


def _walked(problem: Problem, found: Minimum) -> Minimum:
    """Return the best fit from points aside of one: on the coarse grid a kink fell between two steps.

    Args:
        problem: On the fine grid.
        found: Where a fit ended.
    """
    kinks = [f"{e.name}.{p.name}" for e in problem.structure.parts if e.nonsmooth for p in e.parameters]
    # The first swings are wide enough to show a better valley, and in them no start is out of step yet.
    kept = scouts(problem.records)
    some, start = problem.of(kept, found.point)
    early = some.with_(records=[first_swings(r, problem.scales, EARLY) for r in some.records])
    here = early.fitted(start, 6, 1e-3)
    trials = [here]
    for name, factor in itertools.product(kinks, ASIDE):
        if name in problem.names:
            point = start.copy()
            point[problem.names.index(name)] *= factor
            trials.append(early.fitted(point, 6, 1e-3))
    best = min(trials, key=lambda m: m.normal.cost)
    if best.normal.cost > AHEAD * here.normal.cost:
        return found
    aside = followed(problem, found.point, kept, best.point)
    return min(found, problem.fitted(aside, 30), key=lambda m: m.normal.cost)


def _better(found: Sequence[Candidate], again: Iterable[Candidate]) -> list[Candidate]:
    """Return models, each replaced by the one of its effects that came out better, and what is new."""
    best: dict[tuple[str, ...], Candidate] = {}
    for model in (*found, *again):
        best[model.effects] = min(best.get(model.effects, model), model, key=lambda m: m.cost)
    return list(best.values())


def _hopeless(models: Sequence[Candidate]) -> float:
    """Return the misfit, in units of the noise, from which one of some models is out of the running."""
    least = min(m.misfit for m in models)
    return least + max(FAR, HOPELESS * (least - models[0].problem.samples))


def _count(model: Candidate) -> int:
    return len(model.effects)


def _choices(model: Candidate) -> int:
    return len(model.effects) + len(model.problem.names)


def best_of(models: Sequence[Candidate], count: int) -> list[Candidate]:
    """Return the best models: in turn the one with the least error, and the one with the least for its size."""
    turns = zip(sorted(models, key=lambda m: m.cost), sorted(models, key=frugality), strict=True)
    return list({id(m): m for pair in turns for m in pair}.values())[:count]


def inside(models: Sequence[Candidate]) -> list[Candidate]:
    """Return the models whose effects are something of their own: what stands in for another law takes no law's place; all where none are."""
    return [m for m in models if not m.at_edge] or list(models)


def frugality(model: Candidate) -> float:
    """Return what ranks models by error and size: a parameter is worth a sixth of the squared error."""
    return 6 * float(np.log(max(model.cost, 1e-300))) + model.size


def leaders(
    models: Iterable[Candidate], rank: Callable[[Candidate], float] = lambda m: m.cost
) -> list[Candidate]:
    """Return the first model of each set of families, by least error where no rank is given: variants of one law say the same."""
    best: dict[frozenset[str], Candidate] = {}
    for model in models:
        best[model.families] = min(best.get(model.families, model), model, key=rank)
    return list(best.values())


def best_families(models: Sequence[Candidate], count: int) -> list[Candidate]:
    """Return the best models of the best sets of families: of each the one with the least error, and the one with the least for its size.

    And the best of all: it shows what can be reached, if only at the edge of what an effect is.
    """
    own = inside(models)
    best = best_of(leaders(own), count)
    picked = [m for one in best for m in best_of([m for m in own if m.families == one.families], VARIANTS)]
    return list({id(m): m for m in [*picked, *best_of(models, 1)]}.values())


def inherited(problem: Problem, known: Candidate) -> Array:
    """Return a start at a simpler model's optimum, where what the richer one has more vanishes, in units of sizes, shape (p,)."""
    start = problem.start(completed(problem, known.parameters))
    take_motion(problem, start, known)
    return start


def completed(problem: Problem, known: Mapping[str, float]) -> dict[str, float]:
    """Return a model's parameters with those that a richer one has more where they make no difference."""
    parameters = dict(known)
    if problem.fixed.get("stiffness") == 0.0 and parameters.get("stiffness", 0.0) != 0.0:
        parameters = hanging_start(parameters)
    elif parameters.get("stiffness") == 0.0 and problem.fixed.get("stiffness") != 0.0:
        parameters = sprung_start(parameters, problem.scales.stiffness)  # the weight was taken away again
    for part in problem.structure.parts:
        for p in part.parameters:
            value = p.starts[0] if p.neutral is None else min(max(p.neutral, p.low), p.high)
            parameters.setdefault(f"{part.name}.{p.name}", value * p.size(problem.scales))
    return parameters


def take_motion(problem: Problem, start: Array, known: Candidate) -> None:
    """Copy each release's roll and rate from another model into a start, shape (p,), in units of sizes, in place."""
    other = known.problem
    for index in range(len(problem.records)):
        mine, its = len(problem.names) + index * problem.n_local, len(other.names) + index * other.n_local
        start[mine : mine + 2] = known.minimum.point[its : its + 2]
        if problem.bias == "per-release":
            start[mine + problem.n_local - 1] = known.minimum.point[its + other.n_local - 1]


def _sensible(one: Candidate, other: Candidate) -> bool:
    """Whether no two effects are of one family, whose variants say the same, and none rules another out."""
    return _compatible((*one.effects, *(name for name in other.effects if name not in one.effects)))


def _compatible(names: Sequence[str]) -> bool:
    families = {effect(name).family for name in names}
    return len(families) == len(names) and not any({*names} & {*effect(name).excludes} for name in names)


def promise(minimum: Minimum) -> float:
    """Return the cost that the quadratic model of it promises at best."""
    normal = minimum.normal
    if not np.isfinite(normal.cost):
        return float("inf")
    diagonal = np.maximum(np.diag(normal.hessian), 1e-12 * max(float(np.diag(normal.hessian).max()), 1e-300))
    scale = 1.0 / np.sqrt(diagonal)
    scaled = normal.hessian * np.outer(scale, scale) + 1e-3 * np.eye(len(scale))
    gradient = scale * np.where(minimum.at_bound, 0.0, normal.gradient)
    return normal.cost - 0.5 * float(gradient @ np.linalg.solve(scaled, gradient))
