"""Which effect a driven model is missing: output-error fits of the likeliest sets, judged by correlated residuals."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from sysid.driven.fit import MATTERS, DrivenFit, fit, free_of, start_values, starts, with_likelier_input
from sysid.driven.joint import Simulator, Structure
from sysid.driven.log import DrivenLog
from sysid.driven.problem import Problem
from sysid.effects import catalogue, drives, effect
from sysid.effects._base import DriveEffect, TorqueEffect
from sysid.errors import SysidError

SCORE_TOLERANCE = 12.0
"""Twice the log likelihood within which two sets tie: odds of 400 to 1, as for free decays."""
MAX_EFFECTS = 3
"""Effects in a set at most."""
FAMILIES = ("friction", "drag", "hardening", "asymmetry")
"""Families of a joint's own effects that a driven log can show."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenVerdict:
    """Which effects a driven model lacks."""

    base: DrivenFit
    best: DrivenFit
    fits: Mapping[tuple[str, ...], DrivenFit]
    """Every set that was fitted."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects of the best set beyond the model's."""
        return tuple(name for name in self.best.structure.effects if name not in self.base.structure.effects)

    @property
    def families(self) -> tuple[str, ...]:
        """Their families."""
        return tuple(sorted(_families(self.effects)))

    @cached_property
    def _scores(self) -> dict[tuple[str, ...], float]:
        """Score of each set, by its effects beyond the model's."""
        own = {*self.base.structure.effects}
        return {tuple(sorted({*key} - own)): one.score for key, one in self.fits.items()}

    @cached_property
    def alike(self) -> list[tuple[str, ...]]:
        """Sets of other families that fit as well."""
        mine, worst = _families(self.effects), self.best.score + SCORE_TOLERANCE
        near = sorted((score, key) for key, score in self._scores.items() if score < worst)
        return [key for _, key in near if not mine <= _families(key)]

    @property
    def confidence(self) -> float:
        """Probability of the families among all sets that were fitted."""
        best: dict[frozenset[str], float] = {}
        for key, score in self._scores.items():
            best[_families(key)] = min(best.get(_families(key), math.inf), score)
        mine = _families(self.effects)
        weights = {
            key: math.exp(-0.5 * min(score - self.best.score, 1400.0))
            for key, score in best.items()
            if not mine < key
        }
        return weights[mine] / sum(weights.values())

    @property
    def explained(self) -> float:
        """Share of the squared error beyond the noise that the named effects explain [1]."""
        before, after = (one.rmse**2 - one.noise**2 for one in (self.base, self.best))
        return 1.0 if before <= 0 else max(0.0, 1 - max(after, 0.0) / before)

    @property
    def status(self) -> str:
        """'missing', 'none-missing', or 'unexplained'."""
        beyond = self.best.nrmse > 0.02
        if self.effects:
            return "unexplained" if beyond and self.explained < 0.5 else "missing"
        return "unexplained" if beyond else "none-missing"

    def to_json(self) -> dict[str, object]:
        """Return what `diagnose --json` writes of a driven joint."""
        ranked = sorted(self.fits.values(), key=lambda one: one.score)
        return {
            "log": self.base.log.name, "input": self.base.log.kind, "noise_floor_rad": self.base.noise,
            "baseline": {"rmse_rad": self.base.rmse},
            "candidates": [
                {"effects": list(one.structure.effects), "rmse_rad": one.rmse, "score": one.score - ranked[0].score,
                 "parameters": {name: one.values[name] for name in one.quantities}}
                for one in ranked
            ],
            "verdict": {
                "status": self.status, "effects": list(self.effects), "families": list(self.families),
                "confidence": self.confidence, "explained": self.explained,
                "indistinguishable_from": [list(one) for one in self.alike], "error_before_rad": self.base.rmse,
                "error_after_rad": self.best.rmse, "next_experiment": next_experiment(self),
                "parameters": {name: quantity.to_json() for name, quantity in self.best.quantities.items()},
            },
        }  # fmt: skip


def candidates(structure: Structure) -> list[str]:
    """Return the effects that a driven joint may be missing."""
    found: list[str] = []
    for name, part in {**drives(), **catalogue()}.items():
        drive = isinstance(part, DriveEffect) and (not part.sources or structure.kind in part.sources)
        own = (
            isinstance(part, TorqueEffect)
            and part.role == "torque"
            and part.family in FAMILIES
            and not part.states
        )
        if (
            (drive or own)
            and name not in structure.effects
            and not part.is_known
            and not getattr(part, "grounded", False)
        ):
            found.append(name)
    return found


def diagnose(
    log: DrivenLog, given: Mapping[str, float], *, structure: Structure | None = None,
    fixed: Mapping[str, float] | None = None, simulator: Simulator | None = None,
    told: Callable[[str], None] | None = None,
) -> DrivenVerdict:  # fmt: skip
    """Find the effects that a driven model lacks.

    Args:
        given: Known parameters, in SI: those of the model.
        structure: Effects that the model has already.
        fixed: Parameters that are held.
        simulator: Of a model that may have made the log.
        told: Called with each set as it is fitted.

    Raises:
        SysidError: The model itself cannot be fitted.
    """
    plain, fixed = structure or Structure(log.kind), fixed or {}
    problem = Problem(
        log=log, structure=plain, values={**given, **fixed}, free=free_of(plain, plain.effects, fixed)
    )
    search = _Search(
        replace(problem, log=with_likelier_input(problem, simulator=simulator)), fixed, simulator, told
    )
    base = search.fitted(tuple(sorted(plain.effects)))
    assert base is not None
    leading, best = [base], base
    for _ in range(MAX_EFFECTS):
        if best.is_noise:
            break
        grown = [one for before in leading for one in search.grown_from(before)]
        best = min(search.fits.values(), key=lambda one: one.score)
        grown = sorted(
            (one for one in grown if one.score < base.score - SCORE_TOLERANCE), key=lambda one: one.score
        )
        if not grown or grown[0].score > min(one.score for one in leading) - SCORE_TOLERANCE:
            break
        leading = grown[: 2 if len(leading) == 1 and leading[0] is base else 1]
    best = search.simplest()
    final = fit(search.posed(best.structure.effects), begins=[best.values], simulator=simulator)
    fits = {**search.fits, tuple(sorted(final.structure.effects)): final}
    return DrivenVerdict(base=base, best=final, fits=fits)


@dataclass(eq=False)
class _Search:
    """Sets of effects of one log, each fitted once."""

    plain: Problem
    """The model as it is."""
    fixed: Mapping[str, float]
    simulator: Simulator | None
    told: Callable[[str], None] | None
    fits: dict[tuple[str, ...], DrivenFit] = field(default_factory=dict[tuple[str, ...], DrivenFit])

    def posed(self, key: tuple[str, ...]) -> Problem:
        """Return the problem of a set."""
        structure = replace(self.plain.structure, effects=key)
        return replace(self.plain, structure=structure, free=free_of(structure, key, self.fixed))

    def fitted(self, key: tuple[str, ...], begins: Sequence[Mapping[str, float]] = ()) -> DrivenFit | None:
        """Return the fit of a set; None if it runs away from its starts."""
        return self.fits[key] if key in self.fits else self.again(key, begins)

    def again(self, key: tuple[str, ...], begins: Sequence[Mapping[str, float]]) -> DrivenFit | None:
        """Fit a set from starts, and return its best fit so far."""
        if self.told is not None:
            self.told(", ".join(key) or "the model as it is")
        try:
            found = fit(self.posed(key), begins=begins, quick=True, simulator=self.simulator)
        except SysidError:
            if not begins:
                raise
            return self.fits.get(key)
        self.fits[key] = min(found, self.fits.get(key, found), key=lambda one: one.score)
        return self.fits[key]

    def simplest(self) -> DrivenFit:
        """Return the set with the fewest parameters that ties with the best, without effects that matter to nothing.

        A smaller set is fitted from the larger one too: it may have stopped in another valley. A simpler effect of the same
        family may stand in for one.
        """
        best = min(self.fits.values(), key=lambda one: one.score)
        tied = [one for one in self.fits.values() if one.score < best.score + SCORE_TOLERANCE]
        best = min(tied, key=lambda one: (len(one.quantities), one.score))
        while True:
            smaller: list[DrivenFit | None] = []
            for name in set(best.structure.effects) - set(self.plain.structure.effects):
                rest = tuple(other for other in best.structure.effects if other != name)
                smaller.append(self.again(rest, [best.values]))
                for other in candidates(self.plain.structure):
                    simpler = len(effect(other).parameters) < len(effect(name).parameters)
                    if simpler and effect(other).family == effect(name).family:
                        key = tuple(sorted((*rest, other)))
                        smaller.append(self.again(key, self.begins(key, best)[0]))
            idle = [
                one
                for one in smaller
                if one and (one.rmse < (1 + MATTERS) * best.rmse or one.score < best.score + SCORE_TOLERANCE)
            ]
            if not idle:
                return best
            best = min(idle, key=lambda one: one.score)

    def begins(self, key: tuple[str, ...], before: DrivenFit) -> tuple[list[dict[str, float]], float]:
        """Return starts of a set from the fit of another, and the least torque that they leave missing [N*m]."""
        posed = self.posed(key)
        values = start_values(posed.structure, before.values, posed.log)
        return starts(replace(posed, values=values), before.values)

    def grown_from(self, before: DrivenFit) -> list[DrivenFit]:
        """Fit the effect of each family that leaves the least missing torque; gears only if the residual stays correlated."""
        found: list[tuple[float, str, tuple[str, ...], list[dict[str, float]]]] = []
        gears: list[tuple[tuple[str, ...], list[dict[str, float]]]] = []
        for name in candidates(self.plain.structure):
            if not _combines(name, before.structure.effects):
                continue
            key = tuple(sorted((*before.structure.effects, name)))
            begins, left = self.begins(key, before)
            if getattr(effect(name), "transmit", None):
                gears.append((key, begins))
            else:
                found.append((left, effect(name).family, key, begins))
        likeliest: dict[str, tuple[tuple[str, ...], list[dict[str, float]]]] = {}
        for _, family, key, begins in sorted(found, key=lambda one: one[0]):
            likeliest.setdefault(family, (key, begins))
        done = [one for key, begins in likeliest.values() if (one := self.fitted(key, begins))]
        if any(one.is_noise for one in done):
            return done
        return done + [one for key, begins in gears if (one := self.fitted(key, begins))]


def _families(names: Iterable[str]) -> frozenset[str]:
    return frozenset(effect(name).family for name in names)


def _combines(name: str, others: Sequence[str]) -> bool:
    """Return whether an effect adds to others of other families that allow it."""
    part = effect(name)
    for other in map(effect, others):
        gears = getattr(part, "transmit", None) and getattr(other, "transmit", None)
        if gears or part.family == other.family or other.name in part.excludes or name in other.excludes:
            return False
    return True


def next_experiment(verdict: DrivenVerdict) -> str:
    """Return the experiment that tells the named effect from its look-alikes."""
    names = verdict.effects or (verdict.alike[0] if verdict.alike else ())
    if not names:
        return "Repeat with a larger or faster input, or on the robot's own motions."
    if isinstance(part := effect(names[0]), DriveEffect):
        return part.experiment
    return f"Play the motion that `fit --effect {part.name} --next-motion FILE` writes, and diagnose its log too."
