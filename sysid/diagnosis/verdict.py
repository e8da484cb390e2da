"""From the posterior to a verdict: which effects are named, how sure that is, and whether something has no name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from sysid.diagnosis.evidence import ODDS
from sysid.diagnosis.fits import Candidate
from sysid.diagnosis.nuisances import TENTH
from sysid.diagnosis.posterior import Found, Posterior, Size

SMALL, LARGE = 0.01, 0.03
"""Shares [1]. An effect matters from `SMALL` of the spring's peak torque, or from `LARGE` of the energy lost. Another rest angle matters
from `LARGE` of the torque. An error matters from `SMALL` of the motion."""
MOSTLY = 0.5
"""Share of the error beyond the noise that an explanation may leave."""

Status = Literal["none-missing", "missing", "unexplained"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Hint:
    """A family that the log hints at, too weakly or too unsurely to be named."""

    effects: tuple[str, ...]
    probability: float
    size: Size | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What is missing."""

    status: Status
    effects: tuple[str, ...]
    families: tuple[str, ...]
    confidence: float
    indistinguishable_from: tuple[tuple[str, ...], ...]
    """Sets of effects that the best one beats by odds below 20."""
    hints: tuple[Hint, ...]


def matters(family: str, size: Size | None) -> bool:
    """Return whether a family does enough to be named."""
    if size is None:
        return False
    if family == "rest":
        return size.torque_share > LARGE
    return size.torque_share > SMALL or abs(size.energy_share) > LARGE


def decide(found: Posterior, best: Candidate, base: Candidate) -> Verdict:
    """Return the verdict.

    An effect is named if it matters and its absence has a probability below 5 %. An error that does not matter needs no effect, unless a
    law explains it to the noise. A log is 'unexplained' if the best set leaves an error that matters, more than laws that are off by a
    tenth would leave. In addition, g must matter, or most of a large error be left. Equations that explain the log to its noise without
    a law or g leave the sensor's errors only.

    Args:
        found: The posterior.
        best: The fit of its likeliest set.
        base: The fit of the record's own law.
    """
    smallest = SMALL * base.fit.measured_rms
    nothing = next((s for s in found.sets if not set(s.families) - {"rest"}), None)
    doubted = nothing is not None and nothing.probability * ODDS > sum(s.probability for s in found.sets)
    immaterial = base.beyond < smallest and not best.reaches_noise
    likeliest = nothing if nothing is not None and (doubted or immaterial) else found.sets[0]
    doubtful = {"rest"} if found.inclusion.get("rest", 0.0) < 1 - 1 / ODDS else set[str]()
    named = tuple(f for f in likeliest.families if matters(f, found.sizes.get(f)) and f not in doubtful)
    effects = tuple(e for e, f in zip(likeliest.effects, likeliest.families, strict=True) if f in named)
    left = best.beyond if set(named) - {"rest"} else base.beyond
    incomplete = not best.reaches_noise and left > max(TENTH * base.beyond, smallest)
    status: Status = "missing" if named else "none-missing"
    mostly = left > max(MOSTLY * base.beyond, LARGE * base.fit.measured_rms)
    nameless = not found.nameless <= SMALL  # nan by the slow flow, which has no g
    if incomplete and (nameless or (mostly and (named or not found.exact))):
        status = "unexplained"
    same = [s for s in found.sets if immaterial or _named(s, found.sizes) - doubtful == set(named)]
    alike = (
        s for s in found.sets if s not in same and s.effects and s.probability * ODDS > likeliest.probability
    )
    return Verdict(
        status=status, effects=effects, families=named, confidence=min(sum(s.probability for s in same), 1.0),
        indistinguishable_from=tuple(dict.fromkeys(s.effects for s in alike)),
        hints=_hints(found.inclusion, found.sizes, named, found.sets),
    )  # fmt: skip


def _named(found: Found, sizes: Mapping[str, Size]) -> set[str]:
    """Return the families of a set without those known not to matter."""
    return {f for f in found.families if f not in sizes or matters(f, sizes[f])}


def _hints(
    inclusion: Mapping[str, float], sizes: Mapping[str, Size], named: Sequence[str], sets: Sequence[Found]
) -> tuple[Hint, ...]:
    hints: list[Hint] = []
    for family, probability in sorted(inclusion.items(), key=lambda kv: -kv[1]):
        if family in named or probability < 1 / ODDS:
            continue
        effects = next(
            ((e,) for s in sets for e, f in zip(s.effects, s.families, strict=True) if f == family), None
        )
        if effects:
            hints.append(Hint(effects=effects, probability=probability, size=sizes.get(family)))
    return tuple(hints[:3])
