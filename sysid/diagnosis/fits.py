"""Rival sets of effects, fitted by output error with the code of `fit`, and their evidence.

A fit sees all of a release: its start, where friction stops it, and where it rests. A set has error e and p parameters. Its evidence is:

    ln p = -ν e²/2σ² - p/2 ln ν + log odds of its families.

σ is the error of the best set, and ν the number of independent samples. It is Laplace's method with a unit-information prior
(Schwarz 1978; Kass and Raftery, JASA 90, 1995). If the best set reaches the noise, ν counts all samples. If not, no law is exact. The
error of a law is alike in each swing, so ν counts the correlation lengths of one swing.

The zero of an angle may wander. A drift slower than a swing is no error if the best set reaches the noise beside it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.ndimage import uniform_filter1d

from sysid.board import Board
from sysid.diagnosis.evidence import BREADTH, MOST_DEVIATIONS, ODDS, STRENGTH, log_odds
from sysid.diagnosis.laws import candidates
from sysid.diagnosis.posterior import Found, Posterior, Size
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.fitting.cross_validation import rms
from sysid.fitting.joint import FitOptions, Trial, fit_joint, record_values, trial_fit
from sysid.fitting.result import JointFit
from sysid.joint.torques import effect_torque
from sysid.joint.trajectory import Trajectory, simulate
from sysid.noise.whiteness import correlation_length
from sysid.quantity import Quantity
from sysid.roll import Array, Release


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """One set of effects, fitted."""

    effects: tuple[str, ...]
    """Beside the record's own."""
    fit: JointFit = field(repr=False)
    score: float = 0.0
    """Twice the log evidence below the best."""
    beside_drift: bool = False
    """Whether a drift slower than a swing is no error."""

    @property
    def families(self) -> tuple[str, ...]:
        """Families of the effects."""
        return tuple(effect(name).family for name in self.effects)

    @property
    def rmse(self) -> float:
        """Root mean square residual [rad or rad/s]."""
        return self.fit.rmse

    @cached_property
    def judged(self) -> float:
        """Error that counts [rad or rad/s]."""
        return rms(steady(self.fit, self.fit.residuals)) if self.beside_drift else self.rmse

    @property
    def beyond(self) -> float:
        """Judged error beyond the noise [rad or rad/s]."""
        return float(np.sqrt(max(self.judged**2 - self.fit.noise.std**2, 0.0)))

    @property
    def reaches_noise(self) -> bool:
        """Whether the judged error is within the 95 % interval of the noise."""
        return self.judged <= self.fit.noise.highest

    @cached_property
    def heldout_rmse(self) -> float:
        """Error on releases that the fit did not see [rad or rad/s]."""
        return self.fit.heldout_rmse()

    @property
    def parameters(self) -> Mapping[str, Quantity]:
        """Fitted quantities."""
        return self.fit.quantities


def fittable(names: Sequence[str]) -> tuple[str, ...]:
    """Return those of some effects that `fit` can add: not another number of the record."""
    parts = [effect(name) for name in names]
    return tuple(
        p.name for p in parts if (p.identifiable_from_decay or p.identifiable_with) and p.role != "shift"
    )


def swing_of(fit: JointFit) -> int:
    """Return the samples of a swing of a fit."""
    return max(round(2 * np.pi / fit.law.frequency / float(np.median(np.diff(fit.records[0].time)))), 1)


def steady(fit: JointFit, residuals: Sequence[Array]) -> list[Array]:
    """Return residuals like those of a fit [rad or rad/s], each shape (s,), without their mean over a swing: a drift of the zero."""
    return [r - uniform_filter1d(r, swing_of(fit), mode="nearest") for r in residuals]


def is_decided(found: Posterior) -> bool:
    """Return whether the equations decide: they explain the log to its noise without torque noise, and are sure of a set."""
    return found.exact and found.sets[0].probability > 1 - 1 / ODDS


@dataclass(frozen=True, slots=True)
class Yardstick:
    """How much an error and a parameter weigh among rival sets."""

    unit: float
    """σ [rad or rad/s]."""
    samples: float
    """ν [1]."""

    @classmethod
    def of(cls, base: JointFit, error: float, residuals: Sequence[Array]) -> "Yardstick":
        """Return that of rivals.

        Args:
            base: A fit of the same records.
            error: Of the best rival [rad or rad/s].
            residuals: Of the best rival, each shape (s,) [rad or rad/s].
        """
        if error <= base.noise.highest:
            return cls(error, base.problem.samples)
        return cls(error, max(swing_of(base) / correlation_length(steady(base, residuals)), 1.0))

    def log_evidence(self, effects: Sequence[str], error: float, parameters: int) -> float:
        """Return the log evidence of a set [1].

        Args:
            effects: The set.
            error: RMS error of its fit [rad or rad/s].
            parameters: Their number.
        """
        prior = sum(log_odds(effect(name).family) for name in effects)
        samples = self.samples
        return -0.5 * (samples * (error / self.unit) ** 2 + parameters * float(np.log(samples))) + prior


@dataclass(slots=True)
class Fits:
    """Fits of sets of effects to the releases, each made once."""

    releases: Sequence[Release]
    board: Board
    options: FitOptions
    base: Candidate
    """With the record's own effects alone."""
    made: dict[tuple[str, ...], Candidate] = field(default_factory=dict[tuple[str, ...], Candidate])
    tried: dict[tuple[str, ...], Trial] = field(default_factory=dict[tuple[str, ...], Trial])

    def __post_init__(self) -> None:
        """The record's law is a candidate."""
        self.made[()] = self.base

    def add(self, effects: Sequence[str], near: Mapping[str, float]) -> None:
        """Fit a set from near some parameters; one that cannot be fitted, or that ends in impossible torques, is left out."""
        names = fittable(effects)
        if names in self.made:
            return
        (every, start), scales = self._problem(names, near), self.base.fit.problem.scales
        start |= self.tried[names].parameters if names in self.tried else {}
        try:
            fit = fit_joint(self.releases, self.board, every, self.options, scales, start)
            if fit.rmse > self.base.rmse:  # no minimum: the set holds the record's law
                fit = fit_joint(self.releases, self.board, every, self.options, scales)
            possible = is_possible(fit, names)
        except SysidError:  # no law, or one without bound
            return
        if possible:
            self.made[names] = Candidate(effects=names, fit=fit, beside_drift=self.base.beside_drift)

    def _problem(
        self, names: Sequence[str], near: Mapping[str, float]
    ) -> tuple[tuple[str, ...], dict[str, float]]:
        """Return all effects of a joint with some more, and the parameters from which its fit starts."""
        every = (*(part.name for part in self.board.effects), *names)
        return every, {"rest_angle": 0.0, **record_values(self.board), **near}

    def of(self, effects: Sequence[str]) -> Candidate:
        """Return the best fit of the families of some effects, or that of the record's law if they cannot be fitted."""
        names = fittable(effects)
        want = {effect(name).family for name in names}

        def same() -> list[Candidate]:
            return [c for c in self.made.values() if set(c.families) == want]

        if not same():
            wider = [c for c in self.made.values() if set(c.effects) >= set(names)]
            nearest = min(wider, key=lambda c: c.rmse, default=self.base).fit
            self.add(names, nearest.problem.parameters(nearest.minimum.point))
        return min(same(), key=lambda c: c.rmse, default=self.base)

    def explore(self, found: Posterior) -> None:
        """Fit the likeliest set, and of all that compete with it the best in a trial.

        Parts of the likeliest sets compete. Other laws of its families compete if the best set misses the noise. All single laws, and
        pairs with the best of these, compete if the equations do not decide either: a short motion says more as a whole.
        """
        best = found.sets[0]
        self.add(best.effects, best.parameters)
        rivals = {part: best.parameters for part in _without_one(best.effects)}
        own = list(candidates([part.name for part in self.board.effects]))
        reached = any(c.reaches_noise for c in self.made.values() if c.effects)
        if not reached:
            rivals |= dict.fromkeys(_variants(best.effects, own), best.parameters)
        if not is_decided(found):
            for one in (s for s in found.sets[1 : BREADTH // 2] if len(fittable(s.effects)) <= 2):
                rivals |= {part: one.parameters for part in (one.effects, *_without_one(one.effects))}
            rivals |= {} if reached else self._pairs(found, own)
        if reached:  # one law more only costs
            rivals = {names: start for names, start in rivals.items() if not set(names) > set(best.effects)}
        for names in self._ranked(rivals)[: BREADTH - len(self.made)]:
            self.add(names, rivals[names])
        self.count_drift()

    def count_drift(self) -> None:
        """Count a drift of the zero as no error if a fit needs it to reach the noise. A rate and a counter have no such drift."""
        fit = self.base.fit
        if fit.records[0].is_rate or fit.noise.counts or any(c.reaches_noise for c in self.made.values()):
            return
        beside = {names: replace(c, beside_drift=True) for names, c in self.made.items()}
        if any(c.reaches_noise for c in beside.values()):
            self.made, self.base = beside, beside[()]

    def _pairs(self, found: Posterior, own: Sequence[str]) -> dict[tuple[str, ...], Mapping[str, float]]:
        """Return all single laws, and pairs of the best one with the best of each other family, with parameters to start from."""
        alone = {s.effects: s.parameters for s in found.singles}
        alone |= {(name,): {} for name in own if len(effect(name).parameters) == 1 and (name,) not in alone}
        best: dict[str, tuple[str, ...]] = {}
        for one in self._ranked(alone):
            best.setdefault(effect(one[0]).family, one)
        first, *others = best.values() or [()]
        return alone | {(*first, *one): {**alone[one], **self.tried[first].parameters} for one in others}

    def _ranked(self, rivals: Mapping[tuple[str, ...], Mapping[str, float]]) -> list[tuple[str, ...]]:
        """Return the sets that a trial can fit, the likeliest first."""
        errors: dict[tuple[str, ...], float] = {}
        for effects, near in rivals.items():
            names = fittable(effects)
            if names and names not in self.tried:
                every, start = self._problem(names, near)
                try:
                    self.tried[names] = trial_fit(self.base.fit, self.board, every, self.options, start)
                except SysidError:
                    continue
            if names:
                errors[effects] = rms(self.tried[names].residuals)
        if not errors:
            return []
        best = min(errors, key=errors.__getitem__)
        measure = Yardstick.of(self.base.fit, errors[best], self.tried[fittable(best)].residuals)
        plain = len(self.base.fit.problem.names)

        def cost(effects: tuple[str, ...]) -> float:
            count = sum(len(effect(name).parameters) for name in fittable(effects))
            return -measure.log_evidence(fittable(effects), errors[effects], plain + count)

        return sorted(errors, key=cost)

    def rivals(self, found: Posterior) -> list[Candidate]:
        """Return the candidates with their scores, the likeliest first.

        Exact and sure equations rule out other families. A part of their set still competes. A fit also sees the first moments of a
        release, in which a hand may act and a sensor's filter lags.
        """
        rivals = list(self.made.values())
        if is_decided(found):
            families = {effect(name).family for name in found.sets[0].effects}
            rivals = [c for c in rivals if set(c.families) <= families]
        best = min(rivals, key=lambda c: c.judged)
        measure = Yardstick.of(best.fit, best.judged, best.fit.residuals)
        logs = [measure.log_evidence(c.effects, c.judged, len(c.fit.problem.names)) for c in rivals]
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
