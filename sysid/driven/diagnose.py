"""Which effect a driven model is missing: output-error fits of the likeliest sets, judged by correlated residuals."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from sysid.driven.fit import WHITE, DrivenFit, fit, free_of, start_values, starts
from sysid.driven.joint import Structure
from sysid.driven.log import DrivenLog
from sysid.driven.missing import Motion
from sysid.effects import catalogue, drives, effect
from sysid.effects._base import DriveEffect, Effect, TorqueEffect
from sysid.errors import SysidError

SCORE_TOLERANCE = 12.0
"""Twice the log likelihood within which two sets tie: odds of 400 to 1, as for free decays."""
MATTERS = 0.1
"""Share of the residual's RMS that an effect must take away to be named: less is certain in a long log, and worthless."""
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
        return tuple(sorted({effect(name).family for name in self.effects}))

    @cached_property
    def alike(self) -> list[tuple[str, ...]]:
        """Sets of other families that fit as well."""
        own = set(self.base.structure.effects)
        found = {tuple(sorted(set(key) - own)): one.score for key, one in self.fits.items()}
        near = sorted(
            (score, key) for key, score in found.items() if score < self.best.score + SCORE_TOLERANCE
        )
        mine = {effect(name).family for name in self.effects}
        return [
            key
            for _, key in near
            if {effect(name).family for name in key} != mine
            and not mine < {effect(name).family for name in key}
        ]

    @property
    def confidence(self) -> float:
        """Probability of the families among all sets that were fitted."""
        own = set(self.base.structure.effects)
        best: dict[frozenset[str], float] = {}
        for key, one in self.fits.items():
            families = frozenset(effect(name).family for name in set(key) - own)
            best[families] = min(best.get(families, math.inf), one.score)
        mine = frozenset(effect(name).family for name in self.effects)
        weights = {
            key: math.exp(-0.5 * min(score - self.best.score, 1400.0))
            for key, score in best.items()
            if not mine < key
        }
        return weights[mine] / sum(weights.values())

    @property
    def explained(self) -> float:
        """Share of the squared error beyond the noise that the named effects take away [1]."""
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
    fixed: Mapping[str, float] | None = None, told: Callable[[str], None] | None = None,
) -> DrivenVerdict:  # fmt: skip
    """Find the effects that a driven model lacks.

    Args:
        given: Known parameters, in SI: those of the model.
        structure: Effects that the model has already.
        fixed: Parameters that are held.
        told: Called with each set as it is fitted.

    Raises:
        SysidError: The model itself cannot be fitted.
    """
    plain = structure or Structure(log.kind)
    fixed = fixed or {}
    known = {**given, **fixed}
    fits: dict[tuple[str, ...], DrivenFit] = {}

    motion, every = Motion(log), candidates(plain)

    def tried(key: tuple[str, ...], begins: Sequence[Mapping[str, float]] = ()) -> DrivenFit | None:
        if key not in fits:
            if told is not None:
                told(", ".join(key) or "the model as it is")
            chosen = Structure(log.kind, key, plain.encoder)
            try:
                fits[key] = fit(log, chosen, known, free_of(chosen, key, fixed), begins=begins, quick=True)
            except SysidError:
                if not begins:
                    raise
                return None
        return fits[key]

    def grown_from(before: DrivenFit) -> list[DrivenFit]:
        """Fit, of each family, the effect that leaves the least torque missing; and each gear where the rest is no noise."""
        found: list[tuple[float, tuple[str, ...], list[dict[str, float]]]] = []
        for name in every:
            if _combines(name, before.structure.effects):
                key = tuple(sorted((*before.structure.effects, name)))
                chosen = Structure(log.kind, key, plain.encoder)
                free = free_of(chosen, key, fixed)
                values = start_values(chosen, dict(before.values), log)
                begins, left = starts(motion, chosen, values, free, {}, known=before.values)
                found.append((-1.0 if getattr(effect(name), "transmit", None) else left, key, begins))
        likeliest: dict[str, tuple[float, tuple[str, ...], list[dict[str, float]]]] = {}
        gears = [one for one in found if one[0] < 0]
        for one in sorted((one for one in found if one[0] >= 0), key=lambda one: one[0]):
            (new,) = set(one[1]) - set(before.structure.effects)
            likeliest.setdefault(effect(new).family, one)
        done = [one for _, key, begins in likeliest.values() if (one := tried(key, begins))]
        if any(one.memory <= WHITE for one in done):
            return done
        return done + [one for _, key, begins in gears if (one := tried(key, begins))]

    base = tried(tuple(sorted(plain.effects)))
    assert base is not None
    leading, best = [base], base
    for _ in range(MAX_EFFECTS):
        if best.memory <= WHITE:  # what is left is noise
            break
        grown = [one for before in leading for one in grown_from(before)]
        best = min(fits.values(), key=lambda one: one.score)
        grown = sorted(
            (one for one in grown if one.score < base.score - SCORE_TOLERANCE), key=lambda one: one.score
        )
        if not grown or grown[0].score > min(one.score for one in leading) - SCORE_TOLERANCE:
            break
        leading = grown[: 2 if len(leading) == 1 and leading[0] is base else 1]
    best = _simplest(fits, plain)
    final = fit(log, best.structure, known, tuple(best.quantities), begins=[best.values])
    return DrivenVerdict(base=base, best=final, fits={**fits, tuple(sorted(final.structure.effects)): final})


def _combines(name: str, others: Sequence[str]) -> bool:
    """Return whether an effect adds to others: none of its family is there, and none excludes it."""
    part = effect(name)
    return all(_apart(part, effect(other)) for other in others)


def _apart(one: Effect, other: Effect) -> bool:
    gears = [getattr(part, "transmit", None) is not None for part in (one, other)]
    return (
        one.family != other.family
        and not all(gears)
        and other.name not in one.excludes
        and one.name not in other.excludes
    )


def _simplest(fits: Mapping[tuple[str, ...], DrivenFit], plain: Structure) -> DrivenFit:
    """Return the set with the fewest parameters that ties with the best, without effects that matter to nothing."""
    best = min(fits.values(), key=lambda one: one.score)
    tied = [one for one in fits.values() if one.score < best.score + SCORE_TOLERANCE]
    best = min(tied, key=lambda one: (len(one.quantities), one.score))
    while True:
        own = [name for name in best.structure.effects if name not in plain.effects]
        smaller = [fits.get(tuple(n for n in best.structure.effects if n != name)) for name in own]
        idle = [
            one
            for one in smaller
            if one and (one.rmse < (1 + MATTERS) * best.rmse or one.score < best.score + SCORE_TOLERANCE)
        ]
        if not idle:
            return best
        best = min(idle, key=lambda one: one.score)


def next_experiment(verdict: DrivenVerdict) -> str:
    """Return the experiment that tells the named effect from its look-alikes."""
    names = verdict.effects or (verdict.alike[0] if verdict.alike else ())
    return (
        effect(names[0]).experiment_on()
        if names
        else "Repeat with a larger or faster input, or on the robot's own motions."
    )
