"""Evidence for sets of laws: closed form, from Gram matrices.

The log is r = Σ c φ + white noise after whitening. Strengths are c ~ N(0, λ²); some cannot be negative. A set of laws has the Gram
matrix G and the projections b. With A = G + Λ⁻² and μ = A⁻¹ b:

    ln p(r | set) = ½ b'μ - ½ ln|A| - ln|Λ| + Σ ln 2 Φ(±μ/σ) + const.

Source: MacKay, Information Theory, Inference, and Learning Algorithms, 2003, chapter 28. The last sum is the share of the posterior that
keeps the signs, with independent marginals. Occam's factor is ln|A|: nothing else penalises a richer set.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular
from scipy.special import log_ndtr

from sysid.diagnosis.laws import Term
from sysid.roll import Array

DEPTH = 3
"""Families of a set at most."""
BREADTH = 8
"""Sets of families from which larger sets grow, and sets of effects that are fitted in full."""
STRENGTH = 0.4
"""Prior deviation of a law's torque over the spring's, both RMS over the motion."""
MOST_DEVIATIONS = 3.5
"""A strength within so many prior deviations is possible."""
ODDS = 20.0
"""Odds at which one set beats another: 95 %."""
COMMON, OFTEN, SELDOM = ("friction", "drag", "hardening", "rest"), 0.15, 0.05
"""Families that most joints may have, their prior probability, and that of any other."""


def log_odds(family: str) -> float:
    """Return the prior log odds that a family acts."""
    chance = OFTEN if family in COMMON else SELDOM
    return float(np.log(chance / (1 - chance)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Item:
    """A term as one or two columns of the Gram matrix."""

    family: int
    """Number of its family."""
    columns: tuple[int, ...]
    signs: tuple[int, ...]
    """1 for a strength that cannot be negative, else 0."""
    log_prior: float
    """Log odds of its family, and of its share in them."""
    bends: tuple[int, ...] = ()
    """Columns of functions that the law may be off by."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """A set of items under one hypothesis of the noise."""

    items: tuple[int, ...]
    log_evidence: float
    """With its prior, up to a constant of the hypothesis."""
    likelihood: float
    """The same without the priors of set and signs."""
    means: Array
    """Posterior means of base and strengths, shape (c,)."""
    covariance: Array
    """Shape (c, c)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sets:
    """Sets of items and their evidence."""

    items: npt.NDArray[np.intp]
    """Items of each set in ascending order, -1 where it has fewer, shape (s, DEPTH)."""
    families: npt.NDArray[np.intp]
    """Families of each set as bits, shape (s,)."""
    log_evidence: Array
    """Shape (s,)."""


class Problem:
    """One hypothesis of the noise, with the nuisances marginalised."""

    def __init__(
        self, gram: Array, wide: Array, items: Sequence[Item], damping: float, bend: float = 0.0
    ) -> None:
        """Take the regression of the log on the columns of all items.

        Args:
            gram: Column 0 is the log, the next ones are in every set, first angle and rate, then those of the items.
            wide: Prior deviations of the strengths of the columns that are in every set.
            items: All items.
            damping: d that the smoother has: the total may not be negative.
            bend: Prior deviation of each bend, as a share of the strength.
        """
        self.gram = np.pad(
            gram, ((0, 1), (0, 1))
        )  # the last column is empty: the second one of items with one
        self.wide, self.base = wide, len(wide)
        self.items, self.damping, self.bend = items, damping, bend
        self.pairs = np.array([(*item.columns, -1)[:2] for item in items])
        self.signs = np.array([(*item.signs, 0)[:2] for item in items])
        self.loose = np.where(self.pairs < 0, 1.0, STRENGTH)
        self.family = np.array([item.family for item in items], dtype=np.intp)
        self.priors = np.array([item.log_prior for item in items])


def families_of(terms: Sequence[Term]) -> list[str]:
    """Return the names of all families, by their numbers."""
    return sorted({term.family for term in terms})


def items_of(terms: Sequence[Term], first: int) -> list[Item]:
    """Return terms as items whose columns follow each other from `first` on.

    The prior of a family is shared by its laws, then by their shapes.
    """
    families, laws = families_of(terms), {(term.family, term.effect) for term in terms}
    count = Counter(family for family, _ in laws)
    items: list[Item] = []
    for term in terms:
        columns = tuple(range(first, first := first + len(term.signs)))
        prior = log_odds(term.family) + float(np.log(term.shape.share / count[term.family]))
        number = families.index(term.family)
        items.append(Item(family=number, columns=columns, signs=term.signs, log_prior=prior))
    return items


def marginalised(gram: Array, keep: int, deviations: Array) -> tuple[Array, float]:
    """Return a Gram matrix without its last columns, whose strengths have zero mean and these prior deviations [1].

    Returns:
        The first `keep` rows and columns, shape (keep, keep), and the log of the factor that all evidences get.
    """
    if len(gram) == keep:
        return gram, 0.0
    lower = np.linalg.cholesky(gram[keep:, keep:] + np.diag(deviations**-2.0))
    half = solve_triangular(lower, gram[keep:, :keep], lower=True)
    return gram[:keep, :keep] - half.T @ half, -float(np.log(np.diag(lower)).sum() + np.log(deviations).sum())


def solve(problem: Problem, items: Sequence[int]) -> Scored:
    """Return the evidence of one set of items."""
    base, picked = problem.base, [problem.items[i] for i in items]
    columns = np.array([*range(1, 1 + base), *(c for item in picked for c in item.columns)])
    wide = np.r_[problem.wide, [STRENGTH] * (len(columns) - base)]
    signs = np.array([0] * base + [s for item in picked for s in item.signs])
    likelihood, mean, covariance = closed(problem.gram, columns, wide)
    if problem.bend and items:
        bends = [c for item in picked for c in item.bends]
        each = [len(item.bends) // len(item.columns) for item in picked for _ in item.columns]
        loose = np.maximum(problem.bend * np.repeat(np.abs(mean[base:]), each), 1e-9)
        likelihood, mean, covariance = closed(
            problem.gram, np.r_[columns, bends].astype(np.intp), np.r_[wide, loose]
        )
        mean, covariance = mean[: len(columns)], covariance[: len(columns), : len(columns)]
    possible = float(_possible(problem, mean, np.diag(covariance), wide, signs))
    prior = sum(item.log_prior for item in picked)
    return Scored(
        items=tuple(items),
        log_evidence=likelihood + possible + prior,
        likelihood=likelihood,
        means=mean,
        covariance=covariance,
    )


def closed(gram: Array, columns: npt.NDArray[np.intp], wide: Array) -> tuple[float, Array, Array]:
    """Return the log marginal likelihood [1], posterior means [1], shape (c,), and covariance, shape (c, c), of one set of columns."""
    inner = gram[np.ix_(columns, columns)] + np.diag(wide**-2.0)
    covariance = np.asarray(np.linalg.inv(inner), dtype=np.float64)
    right = gram[columns, 0]
    mean = covariance @ right
    return (
        float(0.5 * right @ mean - 0.5 * np.linalg.slogdet(inner)[1] - np.log(wide).sum()),
        mean,
        covariance,
    )


def _possible(problem: Problem, mean: Array, variance: Array, wide: Array, signs: Array) -> Array:
    """Return the log probability that strengths have their signs and are not absurd, and that the joint loses energy.

    All but the problem have the base first and the strengths below, and may have a second axis for as many sets.
    """
    deviation = np.sqrt(np.maximum(variance, 1e-300))
    damped = log_ndtr((problem.damping + mean[1]) / deviation[1])
    mean, deviation, wide, signs = (a[problem.base :] for a in (mean, deviation, wide, signs))
    held = np.where(signs != 0, np.log(2) + log_ndtr(mean / deviation), 0.0)
    within = log_ndtr((MOST_DEVIATIONS * wide - np.abs(mean)) / deviation)
    return held.sum(axis=0) + within.sum(axis=0) + damped


def grow(problem: Problem, parent: Scored) -> Sets:
    """Return the evidence of a set with each item added whose family it has not: a Schur complement each."""
    gram, own = problem.gram, list(parent.items)
    picked = np.flatnonzero(~np.isin(problem.family, problem.family[own]))
    inside = [*range(1, 1 + problem.base), *(c for i in own for c in problem.items[i].columns)]
    count = len(picked)
    across = gram[inside]
    moves = parent.covariance @ across
    right = gram[0] - parent.means @ across
    first, second = problem.pairs[picked].T
    loose = problem.loose[picked].T
    a = gram[first, first] - (across[:, first] * moves[:, first]).sum(axis=0) + loose[0] ** -2.0
    b = gram[second, second] - (across[:, second] * moves[:, second]).sum(axis=0) + loose[1] ** -2.0
    c = gram[first, second] - (across[:, first] * moves[:, second]).sum(axis=0)
    determinant = np.maximum(a * b - c * c, 1e-300)
    va, vb, vc = b / determinant, a / determinant, -c / determinant
    ma, mb = va * right[first] + vc * right[second], vc * right[first] + vb * right[second]
    gain = (
        0.5 * (right[first] * ma + right[second] * mb) - 0.5 * np.log(determinant) - np.log(loose).sum(axis=0)
    )
    wa, wb = moves[:, first], moves[:, second]
    mean = np.concatenate([parent.means[:, None] - wa * ma - wb * mb, [ma, mb]])
    variance = np.diag(parent.covariance)[:, None] + wa * wa * va + 2 * wa * wb * vc + wb * wb * vb
    strengths = len(inside) - problem.base
    most = np.where(problem.pairs[picked].T < 0, np.inf, loose)  # an empty column is always possible
    wide = np.concatenate(
        [np.repeat(problem.wide[:, None], count, axis=1), np.full((strengths, count), STRENGTH), most]
    )
    signs = np.concatenate(
        [
            np.zeros((problem.base, 1)),
            np.array([[s] for i in own for s in problem.items[i].signs]).reshape(-1, 1),
        ]
    )
    signs = np.concatenate([np.repeat(signs, count, axis=1), problem.signs[picked].T])
    possible = _possible(problem, mean, np.concatenate([variance, [va, vb]]), wide, signs)
    prior = problem.priors[own].sum() + problem.priors[picked]
    items = np.full((count, DEPTH), -1, dtype=np.intp)
    items[:, : len(own)], items[:, -1] = own, picked
    return Sets(
        items=np.sort(items, axis=1), families=_bits(problem.family[own]) | (1 << problem.family[picked]),
        log_evidence=parent.likelihood + gain + possible + prior,
    )  # fmt: skip


def _bits(families: npt.NDArray[np.intp]) -> int:
    return int(np.bitwise_or.reduce(1 << families)) if len(families) else 0


def search(problem: Problem) -> Sets:
    """Return the evidence of the empty set, and of sets grown from the best of each set of families."""
    nothing = solve(problem, ())
    layer = grow(problem, nothing)
    found = [single(problem, nothing), layer]
    for _ in range(1, DEPTH):
        order = np.argsort(-layer.log_evidence)
        tops = order[np.sort(np.unique(layer.families[order], return_index=True)[1])[:BREADTH]]
        layer = joined([grow(problem, solve(problem, [i for i in layer.items[t] if i >= 0])) for t in tops])
        found.append(layer)
    return joined(found)


def single(problem: Problem, scored: Scored) -> Sets:
    """Return one set of items as sets."""
    items = np.full((1, DEPTH), -1, dtype=np.intp)
    if scored.items:
        items[0, -len(scored.items) :] = sorted(scored.items)
    bits = _bits(problem.family[list(scored.items)])
    return Sets(items=items, families=np.array([bits]), log_evidence=np.array([scored.log_evidence]))


def joined(parts: Sequence[Sets]) -> Sets:
    """Return some sets together, each once."""
    items = np.concatenate([p.items for p in parts])
    _, kept = np.unique(items, axis=0, return_index=True)
    families, log = (
        np.concatenate([getattr(p, name) for p in parts]) for name in ("families", "log_evidence")
    )
    return Sets(items=items[kept], families=families[kept], log_evidence=log[kept])
