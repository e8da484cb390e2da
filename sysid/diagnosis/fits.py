"""Rival sets of effects, fitted by output error with the code of `fit`, and their evidence.

A fit sees all of a release: its start, where friction stops it, and where it rests. A set has error e and p parameters. Its evidence is:

    ln p = -ν e²/2σ² - p/2 ln n + log odds of its families.

The best set has the error σ. n counts independent samples. It is Laplace's method with a unit-information prior (Schwarz 1978; Kass and
Raftery, JASA 90, 1995). No law is exact, and the error of a law is alike in each swing. If the best set misses the noise, n is the
number s of correlation lengths in a swing, and ν is n. If it reaches the noise, n counts all samples. A law may still be off by a tenth
of the error that it explains, δ. Then 1/ν = 1/n + δ²/(s σ²).

The zero of an angle may wander. Its drift is no error if a set leaves only noise beside it.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from sysid.board import Board
from sysid.diagnosis.evidence import BREADTH, DEPTH, MOST_DEVIATIONS, ODDS, STRENGTH, log_odds
from sysid.diagnosis.laws import candidates
from sysid.diagnosis.nuisances import DRIFT, TENTH
from sysid.diagnosis.posterior import Found, Posterior, Size
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.fitting.cross_validation import rms
from sysid.fitting.joint import FitOptions, Near, Trial, fit_joint, record_values, trial_fit
from sysid.fitting.result import JointFit
from sysid.joint.torques import effect_torque
from sysid.joint.trajectory import Trajectory, simulate
from sysid.noise.whiteness import correlation_length, lag_one
from sysid.quantity import Quantity
from sysid.roll import Array, Release

WIDTH = 3
"""Sets of a size from which larger ones grow in trials."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One set of effects, fitted."""

    effects: tuple[str, ...]
    """Beside the record's own."""
    fit: JointFit = field(repr=False)
    score: float = 0.0
    """Twice the log evidence below the best."""
    beside_drift: bool = False
    """Whether a drift of the zero is no error."""

    @property
    def families(self) -> tuple[str, ...]:
        """Families of the effects."""
        return tuple(effect(name).family for name in self.effects)

    @property
    def rmse(self) -> float:
        """Root mean square residual [rad or rad/s]."""
        return self.fit.rmse

    @cached_property
    def residuals(self) -> Sequence[Array]:
        """Residuals that count [rad or rad/s], shape (s,) of each record."""
        return without_drift(self.fit) if self.beside_drift else self.fit.residuals

    @property
    def judged(self) -> float:
        """Their RMS [rad or rad/s]."""
        return rms(self.residuals) if self.beside_drift else self.rmse

    @property
    def beyond(self) -> float:
        """Judged error beyond the noise [rad or rad/s]."""
        return float(np.sqrt(max(self.judged**2 - self.fit.noise.std**2, 0.0)))

    @property
    def reaches_noise(self) -> bool:
        """Whether the judged error is within the 95 % interval of the noise; beside a drift, it is white too."""
        return self.judged <= self.fit.noise.highest and not (self.beside_drift and lag_one(self.residuals))

    @cached_property
    def heldout_rmse(self) -> float:
        """Error on releases that the fit did not see [rad or rad/s]."""
        return self.fit.heldout_rmse()

    @property
    def end(self) -> Near:
        """The minimum."""
        return Near(self.fit.problem.parameters(self.fit.minimum.point), self.fit.starts)

    @property
    def parameters(self) -> Mapping[str, Quantity]:
        """Fitted quantities."""
        return self.fit.quantities


def fittable(names: Sequence[str]) -> tuple[str, ...]:
    """Return those of some effects that `fit` can add, sorted: not another number of the record."""
    parts = [effect(name) for name in sorted(names)]
    return tuple(
        p.name for p in parts if (p.identifiable_from_decay or p.identifiable_with) and p.role != "shift"
    )


def swing_of(fit: JointFit) -> int:
    """Return the samples of a swing of a fit."""
    return max(round(2 * np.pi / fit.law.frequency / float(np.median(np.diff(fit.records[0].time)))), 1)


def without_drift(fit: JointFit) -> list[Array]:
    """Return the residuals of a fit beside a drift of the zero [rad], white if they are noise and drift, shape (s,) of each record.

    They are the innovations of a random walk beside white noise in the steady state, in units of their deviation. A Gauss-Newton step
    leads there from the least squares of white noise. The walk may start anywhere.

    Source: Durbin and Koopman, Time Series Analysis by State Space Methods, 2012, section 2.2.
    """
    scales, noise, free = fit.problem.scales, fit.noise.std, len(fit.problem.names)
    rows: list[Array] = []
    for record, line in zip(fit.records, fit.problem.linearise(fit.minimum.point), strict=True):
        swings = float(np.median(np.diff(record.time))) * scales.frequency / (2 * np.pi)
        walk = (DRIFT * scales.amplitude / noise) ** 2 * swings
        spread = (walk + np.sqrt(walk**2 + 4 * walk)) / 2
        table = np.column_stack([*line, np.ones(len(record.time))])
        innovations = np.asarray(lfilter([1.0, -1.0], [1.0, -1 / (1 + spread)], table, axis=0))
        white = innovations / np.sqrt(1 + spread)
        own = np.linalg.qr(white[:, 1 + free :])[0]
        rows.append(white[:, : 1 + free] - own @ (own.T @ white[:, : 1 + free]))
    every = np.concatenate(rows)
    change = np.linalg.lstsq(every[:, 1:], every[:, 0], rcond=None)[0]
    return [row[:, 0] - row[:, 1:] @ change for row in rows]


def is_decided(found: Posterior) -> bool:
    """Return whether the equations decide: they explain the log to its noise without torque noise, and are sure of a set."""
    return found.exact and found.sets[0].probability > 1 - 1 / ODDS


@dataclass(frozen=True, slots=True)
class Yardstick:
    """How much an error and a parameter weigh among rival sets."""

    unit: float
    """σ [rad or rad/s]."""
    counted: float
    """n [1]."""
    samples: float
    """ν [1]."""

    @classmethod
    def of(cls, base: "Candidate", error: float, residuals: Sequence[Array]) -> "Yardstick":
        """Return that of rivals.

        Args:
            base: The record's own law.
            error: Of the best rival [rad or rad/s].
            residuals: Of the best rival, each shape (s,) [rad or rad/s].
        """
        fit = base.fit
        size = swing_of(fit)  # the mean over a swing is a drift, not an error of the law
        length = correlation_length([r - uniform_filter1d(r, size, mode="nearest") for r in residuals])
        swing = max(size / length, 1.0)
        if error > fit.noise.highest:
            return cls(error, swing, swing)
        off = TENTH**2 * max(base.judged**2 - error**2, 0.0)
        return cls(error, fit.problem.samples, 1 / (1 / fit.problem.samples + off / error**2 / swing))

    def log_evidence(self, effects: Sequence[str], error: float, parameters: int) -> float:
        """Return the log evidence of a set [1].

        Args:
            effects: The set.
            error: RMS error of its fit [rad or rad/s].
            parameters: Their number.
        """
        odds = sum(log_odds(effect(name).family) for name in effects)
        return odds - 0.5 * (
            self.samples * (error / self.unit) ** 2 + parameters * float(np.log(self.counted))
        )


@dataclass(slots=True)
class Fits:
    """Fits of sets of effects to the releases, each made once."""

    releases: Sequence[Release]
    board: Board
    options: FitOptions
    base: Candidate
    """With the record's own effects alone."""
    made: dict[tuple[str, ...], Candidate] = field(default_factory=dict[tuple[str, ...], Candidate])
    tried: dict[tuple[str, ...], Trial | None] = field(default_factory=dict[tuple[str, ...], Trial | None])
    """Trials of sets; None where the motion has no bound."""

    def __post_init__(self) -> None:
        """The record's law is a candidate."""
        self.made[()] = self.base

    def add(self, effects: Sequence[str], near: Near, *, again: bool = False) -> None:
        """Fit a set from a place near its minimum; one that cannot be fitted, or that ends in impossible torques, is left out.

        A set that was fitted before is fitted again only if asked for, and keeps the better fit.
        """
        names = fittable(effects)
        if not names or (names in self.made and not again):
            return
        if (trial := self.tried.get(names)) and not again:
            near = Near(trial.end.parameters)  # the finer grid has another cost
        (every, start), scales = self._problem(names, near), self.base.fit.problem.scales
        try:
            fit = fit_joint(self.releases, self.board, every, self.options, scales, start)
            if fit.rmse > self.base.rmse:  # no minimum: the set holds the record's law
                fit = fit_joint(self.releases, self.board, every, self.options, scales)
            possible = is_possible(fit, names)
        except SysidError:  # no law, or one without bound
            return
        if possible and (names not in self.made or fit.rmse < self.made[names].rmse):
            self.made[names] = Candidate(effects=names, fit=fit, beside_drift=self.base.beside_drift)

    def _problem(self, names: Sequence[str], near: Near) -> tuple[tuple[str, ...], Near]:
        """Return all effects of a joint with some more, and the place from which its fit starts."""
        every = (*(part.name for part in self.board.effects), *names)
        known = {"rest_angle": 0.0, **record_values(self.board), **near.parameters}
        return every, replace(near, parameters=known)

    def of(self, effects: Sequence[str]) -> Candidate:
        """Return the fit of some effects, else the best one of their families, or that of the record's law if they cannot be fitted."""
        names = fittable(effects)
        if names in self.made:
            return self.made[names]
        want = {effect(name).family for name in names}

        def same() -> list[Candidate]:
            return [c for c in self.made.values() if set(c.families) == want]

        if not same():
            wider = [c for c in self.made.values() if set(c.effects) >= set(names)]
            self.add(names, min(wider, key=lambda c: c.rmse, default=self.base).end)
        return min(same(), key=lambda c: c.rmse, default=self.base)

    def explore(self, found: Posterior) -> None:
        """Fit the likeliest set, and of all that compete with it the best in a trial.

        Parts of the likeliest sets compete. Other laws of its families compete if the best set misses the noise. All single laws, and
        pairs with the best of these, compete if the equations do not decide either: a short motion says more as a whole. Richer sets
        compete if they reach the noise: one that misses it too is no better law.
        """
        best = found.sets[0]
        near = Near(best.parameters)
        self.add(best.effects, near)
        rivals = dict.fromkeys(_without_one(best.effects), near)
        own = list(candidates([part.name for part in self.board.effects]))
        reached = any(c.reaches_noise for c in self.made.values() if c.effects)
        if not reached:
            rivals |= dict.fromkeys(_variants(best.effects, own), near)
        if not is_decided(found):
            for one in (s for s in found.sets[1 : BREADTH // 2] if len(fittable(s.effects)) <= 2):
                rivals |= dict.fromkeys((one.effects, *_without_one(one.effects)), Near(one.parameters))
            rivals |= {} if reached else self._grown(found, own, 1, 2)
        if reached:  # one law more only costs
            rivals = {names: start for names, start in rivals.items() if not set(names) > set(best.effects)}
        self._add_best(rivals, BREADTH - len(self.made))
        if not is_decided(found):
            before = set(self.made)
            self._add_best(self._grown(found, own, WIDTH, DEPTH), BREADTH)
            self.made = {n: c for n, c in self.made.items() if n in before or c.reaches_noise}
        self._prune()
        self.count_drift()

    def _add_best(self, sets: Mapping[tuple[str, ...], Near], count: int) -> None:
        """Fit the `count` sets that do best in a trial."""
        starts = {fittable(names): start for names, start in sets.items()}
        for names in self._ranked(starts)[:count]:
            self.add(names, starts[names])

    def _prune(self) -> None:
        """Fit the parts of the best set, and go on with a better one."""
        asked: set[tuple[str, ...]] = set()
        while (best := _scored(list(self.made.values()))[0]).effects not in asked:
            asked.add(best.effects)
            for part in _without_one(best.effects):
                self.add(part, best.end, again=True)

    def count_drift(self) -> None:
        """Count a drift of the zero as no error if a fit needs it to reach the noise. A rate and a counter have no such drift."""
        fit = self.base.fit
        if fit.records[0].is_rate or fit.noise.counts or any(c.reaches_noise for c in self.made.values()):
            return
        beside = {names: replace(c, beside_drift=True) for names, c in self.made.items()}
        if any(c.reaches_noise for c in beside.values()):
            self.made, self.base = beside, beside[()]

    def _grown(
        self, found: Posterior, own: Sequence[str], width: int, depth: int
    ) -> dict[tuple[str, ...], Near]:
        """Return sets of at most `depth` laws that grow in trials from the best `width` of each size, with places to start from."""
        starts = {fittable(s.effects): Near(s.parameters) for s in found.singles if fittable(s.effects)}
        plain = [(name,) for name in own if len(effect(name).parameters) == 1]
        starts |= {one: Near({}) for one in plain if one not in starts}
        alone, laws = dict(starts), dict[str, tuple[str, ...]]()
        for one in self._ranked(alone):
            laws.setdefault(effect(one[0]).family, one)
        tops = self._ranked(starts)[:width]
        for size in range(2, depth + 1):
            layer: dict[tuple[str, ...], Near] = {}
            for top in (top for top in tops if len(top) < size):
                if trial := self.tried[top]:
                    known = trial.end.parameters
                    for f in sorted(laws.keys() - {effect(name).family for name in top}):
                        parameters = {**alone[laws[f]].parameters, **known}
                        layer[fittable((*top, *laws[f]))] = replace(trial.end, parameters=parameters)
            starts |= layer
            tops = self._ranked(starts)[:width]
            if not tops or tops[0] not in layer:  # one law more only costs
                break
        return starts

    def _ranked(self, sets: Mapping[tuple[str, ...], Near]) -> list[tuple[str, ...]]:
        """Try sets, each once, and return those with a bounded motion, the likeliest first."""
        for names in [names for names in sets if names and names not in self.tried]:
            every, start = self._problem(names, sets[names])
            with suppress(SysidError):
                self.tried[names] = None
                self.tried[names] = trial_fit(self.base.fit, self.board, every, self.options, start)
        trials = {names: trial for names in sets if (trial := self.tried.get(names))}
        if not trials:
            return []
        errors = {names: rms(trial.residuals) for names, trial in trials.items()}
        best = min(errors, key=errors.__getitem__)
        measure = Yardstick.of(self.base, errors[best], trials[best].residuals)
        plain = len(self.base.fit.minimum.point)

        def cost(names: tuple[str, ...]) -> float:
            count = plain + sum(len(effect(name).parameters) for name in names)
            return -measure.log_evidence(names, errors[names], count)

        return sorted(errors, key=cost)

    def rivals(self, found: Posterior) -> list[Candidate]:
        """Return the candidates with their scores, the likeliest first.

        Exact and sure equations rule out other families. A part of their set still competes. A fit also sees the first moments, in which
        a sensor's filter lags.
        """
        rivals = list(self.made.values())
        if is_decided(found):
            families = {effect(name).family for name in found.sets[0].effects}
            rivals = [c for c in rivals if set(c.families) <= families]
        return _scored(rivals)


def _scored(rivals: Sequence[Candidate]) -> list[Candidate]:
    """Return candidates with their scores, the likeliest first."""
    best, base = min(rivals, key=lambda c: c.judged), next(c for c in rivals if not c.effects)
    measure = Yardstick.of(base, best.judged, best.fit.residuals)
    logs = [measure.log_evidence(c.effects, c.judged, len(c.fit.minimum.point)) for c in rivals]
    scored = [replace(c, score=2 * (max(logs) - log)) for c, log in zip(rivals, logs, strict=True)]
    return sorted(scored, key=lambda c: c.score)


def by_fits(found: Posterior, rivals: Sequence[Candidate]) -> Posterior:
    """Return the posterior with fitted sets, the likeliest first, in the place of its own.

    If the equations decide, they keep the word unless a fit reaches the noise. Each fit has a rest angle of its own, so that only the
    equations speak of another rest angle.
    """
    exact = any(c.reaches_noise for c in rivals)
    if is_decided(found) and not exact:
        return found
    odds = np.exp([-0.5 * c.score for c in rivals])
    chances = odds / odds.sum()
    moved = found.inclusion.get("rest", 0.0)
    rest = (("rest",), ("offset",)) if moved > 1 - 1 / ODDS else ((), ())
    sets = tuple(
        Found(
            families=(*c.families, *rest[0]), effects=(*c.effects, *rest[1]), probability=float(chance),
            parameters=c.fit.problem.parameters(c.fit.minimum.point),
        )
        for c, chance in zip(rivals, chances, strict=True)
    )  # fmt: skip
    inclusion = {
        family: float(sum(p for p, c in zip(chances, rivals, strict=True) if family in c.families))
        for family in found.inclusion
    }
    inclusion |= {"rest": moved} if "rest" in inclusion else {}
    return replace(found, sets=sets, inclusion=inclusion, nameless=0.0 if exact else found.nameless)


def _without_one(effects: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Return a set without each of its effects."""
    return [part for i in range(len(effects)) if (part := effects[:i] + effects[i + 1 :])]


def _variants(effects: tuple[str, ...], own: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Yield a set with each of its effects replaced by each other one of its family."""
    for i, name in enumerate(effects):
        alike = (n for n in own if n != name and effect(n).family == effect(name).family)
        yield from ((*effects[:i], other, *effects[i + 1 :]) for other in alike)


def is_possible(fit: JointFit, names: Sequence[str]) -> bool:
    """Return whether no effect's torque is beyond a possible share of the torque of spring and effects together, both RMS over the motion.

    Large torques that cancel each other are no explanation. The share is that of the evidence.
    """
    squares, whole, law = dict.fromkeys(names, 0.0), 1e-300, fit.law.of_joint()
    for time, path in _paths(fit):
        total = -fit.law.stiffness * (path.roll - fit.law.rest_angle)
        for name in names:
            torque = effect_torque(law, name, time, path.roll, path.rate)
            squares[name] += float(np.mean(torque**2))
            total = total + torque
        whole += float(np.mean(total**2))
    return max(squares.values()) <= (MOST_DEVIATIONS * STRENGTH) ** 2 * whole


def _paths(fit: JointFit) -> Iterator[tuple[Array, Trajectory]]:
    """Yield time [s] and the fitted motion of each record."""
    for record, (angle, rate) in zip(fit.records, fit.starts, strict=True):
        time = np.linspace(0.0, float(record.time[-1]), 2000)
        yield time, simulate(fit.law.of_joint(), time, angle, rate)


def sizes_of(best: Candidate, rest: float) -> dict[str, Size]:
    """Return how much each family does in the fitted motion, and another rest angle than `rest` [rad].

    The deviation is that of the effect's first parameter, as a share of it.
    """
    fit, names = best.fit, best.effects
    law, plain = fit.law, fit.law.of_joint()
    peaks, works = dict.fromkeys(names, 0.0), dict.fromkeys(names, 0.0)
    widest, loss = 1e-300, 0.0
    for time, path in _paths(fit):
        swing = path.roll - law.rest_angle
        widest = max(widest, float(np.abs(swing).max()))
        loss += law.damping * float(np.trapezoid(path.rate**2, time))
        for name in names:
            torque = effect_torque(plain, name, time, path.roll, path.rate)
            peaks[name] = max(peaks[name], float(np.quantile(np.abs(torque), 0.999)))
            if effect(name).states:  # like a spring and a damper
                table = np.column_stack([path.rate, swing, np.ones_like(swing)])
                spent = np.linalg.lstsq(table, torque, rcond=None)[0][0] * path.rate
            else:  # what changes sign with the rate; the rest is stored
                spent = (torque - effect_torque(plain, name, time, path.roll, -path.rate)) / 2
            works[name] -= float(np.trapezoid(spent * path.rate, time))
    loss = loss + sum(works.values()) or 1e-300
    found: dict[str, Size] = {}
    if (moved := fit.quantities.get("rest_angle")) is not None:
        share = abs(moved.value - rest) / widest
        found["rest"] = Size(
            torque_share=share, torque_std=moved.std / widest, energy_share=0.0, energy_std=0.0
        )
    for name in names:
        first = fit.quantities.get(f"{name}.{effect(name).parameters[0].name}")
        known = first is not None and first.value and np.isfinite(first.std)
        doubt = first.std / abs(first.value) if first and known else 0.0
        torque, energy = peaks[name] / (law.frequency**2 * law.inertia * widest), works[name] / loss
        found[effect(name).family] = Size(
            torque_share=torque,
            torque_std=doubt * torque,
            energy_share=energy,
            energy_std=doubt * abs(energy),
        )
    return found
