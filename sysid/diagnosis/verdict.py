"""From the posterior to a verdict: which effects are named, how sure that is, and whether something has no name."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from sysid.diagnosis.evidence import DEPTH
from sysid.diagnosis.posterior import Found, Posterior, Size

TORQUE, ENERGY, REST = 0.01, 0.03, 0.03
"""An effect matters from this share of the spring's peak torque, or of the energy lost; another rest angle from `REST` of the torque."""
ODDS = 20.0
"""Sets that the best one beats by less are look-alikes: 95 %."""
NAMELESS = 0.03
"""g matters from this share of the spring's torque, both RMS."""
BESIDE = 0.25
"""g matters from this share of the named torque."""
MOSTLY = 0.5
"""Share of the squared error beyond the noise from which a fit explains most of it."""

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
        return size.torque_share > REST
    return size.torque_share > TORQUE or abs(size.energy_share) > ENERGY


def decide(found: Posterior, *, left: float, explained: float, exact: bool = False) -> Verdict:
    """Return the verdict.

    Args:
        found: The posterior.
        left: Square of the linear joint's error beyond the noise over that of the motion.
        explained: Share by which the best fit lowers it.
        exact: Whether the best fit reaches the noise.
    """
    best = found.sets[0]
    nothing = next((s for s in found.sets if not set(s.families) - {"rest"}), None)
    doubted = nothing is not None and nothing.probability * ODDS > sum(s.probability for s in found.sets)
    if nothing is not None and doubted and (explained < MOSTLY or left * explained < NAMELESS**2):
        best = nothing  # an effect is named where its absence is unlikely, at 95 %, or where it explains most of an error that matters
    doubtful = {"rest"} if found.inclusion.get("rest", 0.0) < 1 - 1 / ODDS else set[str]()
    named = tuple(f for f in best.families if matters(f, found.sizes.get(f)) and f not in doubtful)
    effects = tuple(e for e, f in zip(best.effects, best.families, strict=True) if f in named)
    strange = found.nameless > NAMELESS and found.nameless > BESIDE * found.named
    strange |= not named or (explained < MOSTLY and not found.by_cycles)
    status: Status = "missing" if named else "none-missing"
    many = len(set(named) - {"rest"}) >= DEPTH and not exact and not found.by_cycles
    if many or (strange and left * (1 - explained) > NAMELESS**2):
        status = "unexplained"  # as many laws as were tried together, and still not all of it
    same = [s for s in found.sets if _named(s, found.sizes) - doubtful == set(named)]
    confidence = min(sum(s.probability for s in same), 1.0)
    alike = tuple(
        dict.fromkeys(
            s.effects
            for s in found.sets
            if s not in same and s.effects and s.probability * ODDS > best.probability
        )
    )
    return Verdict(
        status=status, effects=effects, families=named, confidence=confidence,
        indistinguishable_from=alike,
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
