"""Which laws act: three passes of smoothing, regression and evidence.

Each pass smooths the log with the torque of the pass before. It evaluates all laws on that motion. It sums the evidence of every set of
laws over two unknowns: ε, the error of the equations, and τ, the size of a torque g without a name. g is a Gaussian process of angle and
rate with a slow drift of stiffness and damping (O'Hagan and Kennedy, J. R. Stat. Soc. B 63, 2001).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.optimize import lsq_linear

from sysid.diagnosis.evidence import (
    STRENGTH,
    Item,
    Problem,
    Scored,
    Sets,
    items_of,
    joined,
    marginalised,
    search,
    single,
    solve,
)
from sysid.diagnosis.laws import Laws, Shape, Term
from sysid.diagnosis.motion import CLEAR, Motion
from sysid.diagnosis.nuisances import BENDS, bends, nameless, sensor
from sysid.diagnosis.smoother import Contact, Smoothed, Smoother
from sysid.effects._base import Effect, TorqueEffect
from sysid.roll import Array

SHARES = (0.0015, 0.005, 0.015, 0.05, 0.15)
"""ε: torque noise over the local torque, a factor of about 3 apart, from an exact law to one that says little."""
NAMELESS = (0.0, 0.04, 0.15)
"""τ: RMS of g over that of the spring's torque."""
PASSES = 3
"""Passes of smoothing and regression: each starts nearer to the torque."""
BEND = 0.05
"""No law is exact: prior deviation of each of the functions that bend a law, as a share of its strength; all four make a tenth."""
REACH = 12.0
"""Log odds against the best set beyond which a set has no part in the answer."""
SHOWS = 0.02
"""Share of a law's torque beside spring, damper and a constant below which it is only another spring and damper."""
LOUD = 1.25
"""χ² over the number of samples from which the sensor is noisier than stated."""
CONSERVATIVE = 8
"""Degree of a polynomial of the angle that holds the energy which a law only stores."""
STILL = 0.012
"""Rate and way over the widest ones below which a joint stands still, if the noise does not hide more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Size:
    """How much a family does in the motion: value and standard deviation."""

    torque_share: float
    """Peak torque over the spring's."""
    torque_std: float
    energy_share: float
    """Energy that it takes over all that is lost."""
    energy_std: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """The likeliest laws of one set of families."""

    families: tuple[str, ...]
    effects: tuple[str, ...]
    probability: float
    """Of the families."""
    parameters: Mapping[str, float]
    """'stiffness', 'damping' and 'effect.parameter', in their units: where a fit may start."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Posterior:
    """Probabilities of the laws, from a log."""

    motion: Motion
    smoothed: Smoothed
    stiffness: float
    """k of the linear part beside the best set, in the motion's units."""
    damping: float
    loss: float
    """d of a linear joint that loses as much."""
    sets: tuple[Found, ...]
    """Sets of families, the likeliest first."""
    singles: tuple[Found, ...]
    """The likeliest law of each family alone."""
    inclusion: Mapping[str, float]
    """Probability that a family acts."""
    sizes: Mapping[str, Size]
    """Of the families in the best set."""
    share: float
    """ε of the best hypothesis."""
    nameless: float
    """RMS of g beside the laws of the best set, over the spring's torque."""
    named: float
    """RMS of the best set's torque beside spring and damper, over the spring's torque."""
    torque: Array
    """All torque beside spring and damper over I ω₀² A on the smoothed motion, shape (r, n)."""
    g: Array
    """Its part without a name, shape (r, n)."""
    g_std: Array
    """Posterior deviation of g, shape (r, n)."""
    misfit: float
    """χ² over the number of samples."""
    grids: Mapping[str, list[Shape]]
    """Shapes of the laws near the best."""
    by_cycles: bool = False
    """Whether the sets are judged by the slow flow instead of the equations."""

    @property
    def exact(self) -> bool:
        """Whether the equations explain the log to its noise, without any torque noise."""
        return self.share <= SHARES[0] and self.misfit < LOUD and not self.by_cycles


@dataclass(slots=True)
class State:
    """State that one pass hands to the next."""

    stiffness: float
    damping: float
    share: float = 0.05
    torque: Array | None = None
    contact: Contact | None = None
    grids: Mapping[str, list[Shape]] = field(default_factory=dict[str, list[Shape]])
    shares: Sequence[float] = SHARES[1::2]
    louder: bool = False
    """Whether the sensor's noise was raised."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """A joint as its record has it."""

    inertia: float
    """[kg*m^2]."""
    parts: Mapping[str, Effect]
    """Candidate effects by name."""
    known: Sequence[tuple[TorqueEffect, Mapping[str, float]]] = ()
    """Effects of the record with their parameters: in every set, each with a strength of its own."""
    has_zero: bool = True
    """Whether a rest angle beside the record's is an effect; else it is a nuisance."""


def posterior(motion: Motion, subject: Subject, grids: Mapping[str, list[Shape]] | None = None) -> Posterior:
    """Return the posterior of sets of laws.

    Args:
        motion: The log.
        subject: The joint.
        grids: Shapes of the laws to begin with, from an earlier posterior.
    """
    stiffness, damping = linear_joint(motion)
    motion = moving = until_still(motion, stiffness, damping)
    state, envelope = State(stiffness, damping, grids=grids or {}), motion.envelope
    plan = [False] * (PASSES - 1) + [True]
    while True:
        bend = plan.pop(0)
        smoother = Smoother(motion, state.stiffness, state.damping, envelope, state.contact)
        step = Pass(motion, smoother.smooth(state.share, state.torque), subject, state, envelope)
        found = step.run(bend=bend)
        louder = bend and found.misfit > LOUD and not state.louder
        if not plan and not louder:
            return replace(found, loss=damping)
        state = replace(step.next_state(found), louder=louder or state.louder)
        local = (
            maximum_filter1d(np.abs(found.torque), motion.nodes_a_period // 16 + 1, axis=1) / state.stiffness
        )
        envelope = np.maximum(motion.envelope, local)
        if louder:
            scale = _noise_scale(motion, state, envelope)
            moving, plan = replace(moving, variance=moving.variance * scale), [False, True]
        motion = _without_hands(moving, state, envelope)


def lost(torque: Array, angle: Array) -> Array:
    """Return torques [1], shape (n, c), without their part that is a function of the angle, which loses no energy."""
    span = np.polynomial.chebyshev.chebvander(angle / np.abs(angle).max(), CONSERVATIVE)
    return torque - span @ np.linalg.lstsq(span, torque, rcond=None)[0]


def linear_joint(motion: Motion) -> tuple[float, float]:
    """Return k and d of a linear joint from a smoother that believes the log more than the equations."""
    k, d = 1.0, 0.1
    for _ in range(5):
        smoother = Smoother(motion, k, d, motion.envelope)
        smoothed = smoother.smooth(0.3, spread=False)
        columns = np.column_stack(
            [smoother.flat(c) for c in (smoothed.angle, smoothed.rate, *levels(motion))]
        )
        smoother.prepare(columns, np.zeros((smoother.size, 0)))
        gram, _ = smoother.gram(SHARES[-1])
        change = np.linalg.solve(gram[1:, 1:] + np.eye(len(gram) - 1), gram[1:, 0])
        k, d = float(np.clip(k + change[0], 0.02, 5.0)), float(np.clip(d + change[1], 0.002, 12.0))
    return k, d


def levels(motion: Motion) -> list[Array]:
    """Return constant torques, shape (r, n) each [1]: another rest angle, or zero of the sensor."""
    if motion.is_rate:
        return []
    if motion.zero != "drifting":
        return [np.ones_like(motion.reading)]
    rows = len(motion.length)
    return [np.repeat(np.eye(rows)[:, [r]], motion.reading.shape[1], axis=1) for r in range(rows)]


def until_still(motion: Motion, stiffness: float, damping: float) -> Motion:
    """End each release where the joint first stands still for a third of a period: friction holds it with any torque.

    A joint that leaves this place later is moved by a hand.
    """
    smoothed = Smoother(motion, stiffness, damping, motion.envelope).smooth(0.3)
    length, variance, free = motion.length.copy(), motion.variance.copy(), motion.free.copy()
    for row, n in enumerate(length):
        slow = np.maximum(3 * np.sqrt(smoothed.rate_variance[row, :n]), STILL)
        moving, pause = (
            np.append(np.flatnonzero(np.abs(smoothed.rate[row, :n]) > slow), n),
            motion.nodes_a_period // 3,
        )
        gaps = np.flatnonzero(np.diff(moving) > pause)
        end = moving[gaps[0]] if len(gaps) else n
        if motion.nodes_a_period // 2 < end < n:
            length[row], variance[row, end:] = end, np.inf
            there = smoothed.angle[row, end:n]
            noise = np.sqrt(np.median(motion.variance[row, :end]))
            leaves = np.flatnonzero(np.abs(there - np.median(there[:pause])) > CLEAR / 2 * noise)
            free[row, 1] = end + max(int(leaves[0]), pause) if len(leaves) else free[row, 1]
    return replace(motion, length=length, variance=variance, free=free)


def _noise_scale(motion: Motion, state: State, envelope: Array) -> float:
    """Return the variance of the sensor's noise that is the likeliest beside the laws, over the stated one, at least 1.

    Stated noise is that of neighbouring samples; errors that last longer are not in it.
    """
    costs: dict[float, float] = {}
    for scale in (1.0, 1.5, 2.2, 3.3, 5.0):
        louder = replace(motion, variance=motion.variance * scale)
        smoother = Smoother(louder, state.stiffness, state.damping, envelope, state.contact)
        costs[scale] = min(smoother.smooth(share, state.torque, spread=False).cost for share in SHARES)
    return min(costs, key=lambda scale: costs[scale] + 8 * np.log(scale) ** 2)


def _without_hands(motion: Motion, state: State, envelope: Array) -> Motion:
    """Return the motion without what hands touched: ends of releases whose misfit stands out get no weight.

    A free joint's misfit is that of white noise, block by block; a hand's is not.
    """
    smoother = Smoother(motion, state.stiffness, state.damping, envelope, state.contact)
    misfit = smoother.smooth(state.share, state.torque, spread=False).misfit
    size = motion.nodes_a_period // 4
    variance, length, free = motion.variance.copy(), motion.length.copy(), motion.free.copy()

    def block(row: int, begin: int, end: int) -> tuple[float, int]:
        samples = int(np.isfinite(motion.variance[row, begin:end]).sum())
        return float(misfit[row, begin:end].sum()) / max(samples, 1), samples

    usual = float(
        np.median(
            [block(r, j, j + size)[0] for r, n in enumerate(length) for j in range(0, max(n - size, 1), size)]
        )
    )

    def stands_out(row: int, begin: int, end: int) -> bool:
        mean, samples = block(row, begin, end)
        return samples > 1 and mean > usual * (1 + 5 * np.sqrt(2 / samples))

    half = max(size // 2, 1)
    for row, n in enumerate(motion.length):
        for begin in range(max(n - 6 * size, n // 2), n, half):
            if stands_out(row, begin, min(begin + size, n)):
                variance[row, begin:], length[row], free[row, 1] = np.inf, begin, begin
                break
        if stands_out(row, 0, half):
            variance[row, :half], free[row, 0] = np.inf, half
    return replace(motion, variance=variance, length=length, free=free)


@dataclass(frozen=True, slots=True)
class Cell:
    """One hypothesis of the noise, ε and τ, with its regression."""

    share: float
    tau: float
    gram: Array
    """Of the log, all torques, g and the sensor's terms."""
    problem: Problem
    """With g and the sensor's terms marginalised."""
    sets: Sets


def found_sets(
    cells: Sequence[tuple[Problem, Sets]],
    terms: Sequence[Term | None],
    families: Sequence[str],
    sizes: Sequence[Array],
    linear: Mapping[str, tuple[float, float]],
) -> tuple[tuple[Found, ...], tuple[Found, ...], dict[str, float], int, list[int]]:
    """Return sets of families and single families over all hypotheses, inclusion, the best hypothesis, and its best items.

    Args:
        cells: Hypotheses of the noise with the evidence of their sets.
        terms: All terms; None stands for another rest angle.
        families: Names of the families.
        sizes: Strength of each term's columns at which a coefficient is 1, shape (c,) each [1].
        linear: Value of 'stiffness' and 'damping' where their coefficients are 0, and the unit of these.
    """
    logs = np.concatenate([s.log_evidence for _, s in cells])
    masks = np.concatenate([s.families for _, s in cells])
    rows = np.concatenate([s.items for _, s in cells])
    which = np.concatenate([np.full(len(s.log_evidence), i) for i, (_, s) in enumerate(cells)])
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    ranked = sorted(((float(weights[masks == m].sum()), int(m)) for m in np.unique(masks)), reverse=True)
    inclusion = {f: float(weights[masks >> i & 1 == 1].sum()) for i, f in enumerate(families)}

    def best(mask: int) -> tuple[int, list[int]]:
        top = np.flatnonzero(masks == mask)[int(np.argmax(logs[masks == mask]))]
        return int(which[top]), [int(i) for i in rows[top] if i >= 0]

    def found(probability: float, mask: int) -> Found:
        cell, items = best(mask)
        return _found(solve(cells[cell][0], items), terms, sizes, cells[cell][0].base, linear, probability)

    sets = tuple(found(probability, mask) for probability, mask in ranked[:SETS])
    singles = tuple(
        found(probability, mask) for probability, mask in ranked if mask and mask & (mask - 1) == 0
    )
    return sets, singles, inclusion, *best(ranked[0][1])


def _found(
    scored: Scored, terms: Sequence[Term | None], sizes: Sequence[Array], at: int, linear: Mapping[str, tuple[float, float]],
    probability: float,
) -> Found:  # fmt: skip
    """Return a set of terms with their parameters."""
    parameters = {
        name: zero + unit * float(m)
        for (name, (zero, unit)), m in zip(linear.items(), scored.means, strict=False)
    }
    for i in scored.items:
        term, size = terms[i], sizes[i]
        means = scored.means[at : at + len(size)] * size
        at += len(size)
        if term is not None:
            strengths = {
                n: float(m * u) for n, m, u in zip(term.strengths, means, term.unit, strict=True) if n
            }
            scale = float(means[0]) if term.strengths[0] else 1.0
            ratios = {n: v * (scale if n in term.ratios else 1.0) for n, v in term.parameters.items()}
            parameters |= {f"{term.effect}.{n}": v for n, v in {**ratios, **strengths}.items()}
    picked = [terms[i] for i in scored.items]
    families = tuple("rest" if term is None else term.family for term in picked)
    effects = tuple("offset" if term is None else term.effect for term in picked)
    return Found(families=families, effects=effects, probability=probability, parameters=parameters)


class Solved(NamedTuple):
    """Strengths of one hypothesis."""

    strengths: Array
    """Of base, laws, their bends, g, and the sensor, shape (f,)."""
    covariance: Array
    """Shape (f, f)."""
    table: Array
    """Torques of these, but for the sensor, shape (n, t)."""
    misfit: float
    """χ² over the number of samples."""
    named: slice
    """Places of laws and their bends."""
    nameless: slice
    """Places of g."""
    parts: dict[int, slice]
    """Places of each law by the number of its item."""


class Pass:
    """One pass: columns, Gram matrices, evidence."""

    def __init__(
        self, motion: Motion, smoothed: Smoothed, subject: Subject, state: State, envelope: Array
    ) -> None:
        """Evaluate all laws on a smoothed motion."""
        self.motion, self.smoothed, self.state, self.parts = motion, smoothed, state, subject.parts
        inside = self.inside = motion.inside
        self.rest = motion.zero == "known" and not motion.is_rate and subject.has_zero
        self.laws = Laws(motion, subject.inertia, state.stiffness, state.damping)
        known = self.laws.recorded(smoothed, subject.known)
        base = [smoothed.angle, smoothed.rate, *([] if self.rest else levels(motion)), *known]
        self.base = np.column_stack([c[inside] for c in base])
        self.wide = np.array([state.stiffness, 2 * state.damping, *[1.0] * (len(base) - 2)])
        self.linear = float(np.sqrt(np.mean((state.stiffness * smoothed.angle[inside]) ** 2)))
        plain = np.column_stack([self.base[:, :2], np.ones(len(self.base))])
        frame = self.frame = np.linalg.qr(plain)[0]
        self.terms: list[Term | None] = []
        columns: list[Array] = []
        for term in self.laws.terms(smoothed, subject.parts, state.grids):
            seen = term.columns[inside]
            if np.linalg.norm(seen - frame @ (frame.T @ seen)) > SHOWS * np.linalg.norm(seen):
                self.terms.append(term)
                columns.append(seen)
        if self.rest:
            self.terms.append(None)
            columns.append(np.ones((len(self.base), 1)))
        self.sizes = [self.linear / np.sqrt(np.mean(c**2, axis=0)) for c in columns]
        self.columns = np.column_stack([c * s for c, s in zip(columns, self.sizes, strict=True)])
        self.families = sorted({self._family(term) for term in self.terms})
        self.items = items_of(self.terms, self.families, 1 + self.base.shape[1])
        self.g = nameless(motion, smoothed, self.linear, state.damping)
        self.sensed, self.loose = sensor(motion, smoothed)
        self.smoother = Smoother(motion, state.stiffness, state.damping, envelope, state.contact)

    @staticmethod
    def _family(term: Term | None) -> str:
        return "rest" if term is None else term.family

    def run(self, *, bend: bool) -> Posterior:
        """Return the posterior; `bend` lets laws be off by a share of themselves."""
        cells = self._cells(self.columns, self.items, self.state.shares)
        if bend:
            columns, items, sets = self._bent(cells)
            cells = self._cells(columns, items, self.state.shares, sets)
        return self._summary(cells)

    def _cells(
        self,
        columns: Array,
        items: Sequence[Item],
        shares: Sequence[float],
        sets: Sequence[tuple[int, ...]] = (),
    ) -> list["Cell"]:
        """Return the evidence of all hypotheses of the noise: of some sets with bends, or of a search."""
        torques = np.column_stack([self.base, columns, self.g])
        named, bend = 1 + self.base.shape[1] + columns.shape[1], BEND if sets else 0.0
        self.columns, self.items = columns, list(items)
        cells: list[Cell] = []
        self.smoother.prepare(torques, self.sensed)
        for share in shares:
            whole, spread = self.smoother.gram(share)
            own, extra = marginalised(whole, torques.shape[1] + 1, self.loose)
            for tau in NAMELESS:
                reduced, more = own[:named, :named], 0.0
                if tau:
                    reduced, more = marginalised(own, named, np.full(self.g.shape[1], tau))
                prior = -np.log(2.0) if tau == 0 else -np.log(2.0 * (len(NAMELESS) - 1))
                constant = float(-0.5 * spread - 0.5 * reduced[0, 0] + extra + more + prior)
                problem = Problem(reduced, self.wide, items, self.state.damping, bend)
                found = (
                    joined([single(problem, solve(problem, s)) for s in sets]) if sets else search(problem)
                )
                found = replace(found, log_evidence=found.log_evidence + constant)
                cells.append(Cell(share, tau, whole, problem, found))
        return cells

    def _bent(self, cells: Sequence["Cell"]) -> tuple[Array, list[Item], list[tuple[int, ...]]]:
        """Return columns and items of the best sets of each set of families, with those of how each law may be off."""
        rows: set[tuple[int, ...]] = set()
        for cell in cells:
            order = np.argsort(-cell.sets.log_evidence)
            firsts = order[np.unique(cell.sets.families[order], return_index=True)[1]]
            rows |= {tuple(int(i) for i in cell.sets.items[f] if i >= 0) for f in firsts}
        kept = sorted({i for row in rows for i in row})
        shapes, first = bends(self.motion, self.smoothed), 1 + self.base.shape[1]
        parts = [self.columns[:, [c - first for c in self.items[i].columns]] for i in kept]
        at, bent = first, first + sum(p.shape[1] for p in parts)
        items: list[Item] = []
        for i, part in zip(kept, parts, strict=True):
            n = part.shape[1]
            own, loose = tuple(range(at, at + n)), tuple(range(bent, bent + n * BENDS))
            items.append(replace(self.items[i], columns=own, bends=loose))
            at, bent = at + n, bent + n * BENDS
        extra = [part[:, [c]] * shapes for part in parts for c in range(part.shape[1])]
        self.terms, self.sizes = [self.terms[i] for i in kept], [self.sizes[i] for i in kept]
        new = {i: k for k, i in enumerate(kept)}
        return np.column_stack([*parts, *extra]), items, sorted(tuple(new[i] for i in row) for row in rows)

    def _summary(self, cells: Sequence["Cell"]) -> Posterior:
        """Return sets, inclusion, sizes and torques from all evidence."""
        sets, singles, inclusion, which, self.chosen = found_sets(
            [(c.problem, c.sets) for c in cells], self.terms, self.families, self.sizes, self._linear()
        )
        self.cell, self.cells = cells[which], cells
        return self._torques(sets, singles, inclusion)

    def _linear(self) -> dict[str, tuple[float, float]]:
        """Return stiffness and damping of the smoother, and their units."""
        w, inertia = self.motion.frequency, self.laws.scales.inertia
        units = {"stiffness": inertia * w * w, "damping": inertia * w}
        return {name: (getattr(self.state, name) * unit, unit) for name, unit in units.items()}

    def _torques(
        self, sets: tuple[Found, ...], singles: tuple[Found, ...], inclusion: Mapping[str, float]
    ) -> Posterior:
        """Return the posterior, with the torques of the best hypothesis."""
        one, base = self._solved(), self.base.shape[1]
        c, table, named, nameless = one.strengths, one.table, one.named, one.nameless
        k, d = self.state.stiffness + float(c[0]), self.state.damping + float(c[1])
        laws, g = table[:, named] @ c[named], table[:, nameless] @ c[nameless]
        self.strengths = {i: c[part] * self.sizes[i] for i, part in one.parts.items()}
        alone = table[:, base : max((part.stop for part in one.parts.values()), default=base)]
        known = np.linalg.qr(np.column_stack([self.base, alone]))[0]
        g_beside, laws_beside = g - known @ (known.T @ g), laws - self.frame @ (self.frame.T @ laws)
        spread = np.einsum(
            "ij,jk,ik->i", table[:, nameless], one.covariance[nameless, nameless], table[:, nameless]
        )
        grid = self.smoother.grid
        return Posterior(
            motion=self.motion, smoothed=self.smoothed, stiffness=k, damping=d, loss=self.state.damping, sets=sets, singles=singles,
            inclusion=inclusion, sizes=self._sizes(one, laws, k, d), share=self.cell.share,
            nameless=float(np.sqrt(np.mean(g_beside**2)) / self.linear), named=float(np.sqrt(np.mean(laws_beside**2)) / self.linear),
            torque=grid(laws + g + self.base @ c[:base]), g=grid(g), g_std=grid(np.sqrt(np.maximum(spread, 0.0))),
            misfit=one.misfit, grids=self.state.grids,
        )  # fmt: skip

    def _solved(self) -> "Solved":
        """Return all strengths of the best hypothesis within their signs: of laws, g and the sensor together."""
        base, gram, tau = self.base.shape[1], self.cell.gram, self.cell.tau
        at = [c for i in self.chosen for c in self.items[i].columns]
        loose = [c for i in self.chosen for c in self.items[i].bends]
        first = 1 + base + self.columns.shape[1]
        last = first + self.g.shape[1]
        of_g = range(first, last) if tau else range(0)
        free = np.array([*range(1, 1 + base), *at, *loose, *of_g, *range(last, len(gram))], dtype=np.intp)
        means = solve(self.cell.problem, self.chosen).means[base:]
        bend = BEND * np.repeat(np.abs(means), BENDS) if loose else []
        prior = np.r_[self.wide, [STRENGTH] * len(at), np.maximum(bend, 1e-9), [tau] * len(of_g), self.loose]
        inner, right = gram[np.ix_(free, free)] + np.diag(prior**-2.0), gram[free, 0]
        root, low = np.linalg.cholesky(inner), np.full(len(free), -np.inf)
        low[base : base + len(at)] = [0.0 if s else -np.inf for i in self.chosen for s in self.items[i].signs]
        low[1] = 1e-3 - self.state.damping
        bounds = low, np.full(len(free), np.inf)
        c = lsq_linear(root.T, np.linalg.solve(root, right), bounds, method="bvls").x
        chi = gram[0, 0] - 2 * c @ right + c @ gram[np.ix_(free, free)] @ c
        samples = int(np.isfinite(self.motion.variance[self.inside]).sum())
        end, use = base + len(at) + len(loose), free[free < last]
        table, places = (
            np.column_stack([self.base, self.columns, self.g])[:, use - 1],
            np.cumsum([base] + [len(self.items[i].columns) for i in self.chosen]),
        )
        return Solved(
            strengths=c, covariance=np.asarray(np.linalg.inv(inner), dtype=np.float64), table=table, misfit=float(chi / max(samples, 1)),
            named=slice(base, end), nameless=slice(end, len(use)),
            parts={i: slice(int(a), int(b)) for i, a, b in zip(self.chosen, places[:-1], places[1:], strict=True)},
        )  # fmt: skip

    def _sizes(self, one: "Solved", laws: Array, k: float, d: float) -> dict[str, Size]:
        """Return torque and energy of each family, beside a spring k and a damper d; `laws` is the torque of all families, shape (n,)."""
        x, v = self.base[:, :2].T
        loss, peak = float(np.sum((d * v + lost(laws[:, None], x)[:, 0]) * v)), float(k * np.abs(x).max())
        sizes: dict[str, Size] = {}
        for i, part in one.parts.items():
            columns, c, own = one.table[:, part], one.strengths[part], one.covariance[part, part]
            torque, work = columns @ c, lost(columns, x).T @ v
            where = columns[int(np.abs(torque).argmax())]
            sizes[self._family(self.terms[i])] = Size(
                torque_share=float(np.abs(where @ c) / peak),
                torque_std=float(np.sqrt(max(where @ own @ where, 0.0)) / peak),
                energy_share=float(work @ c / (loss or 1e-12)),
                energy_std=float(np.sqrt(max(work @ own @ work, 0.0)) / abs(loss or 1e-12)),
            )
        return sizes

    def next_state(self, found: Posterior) -> State:
        """Return what the next pass starts from: torque, finer grids near the best sets, and a stop as part of the dynamics."""
        contact = None
        for i in self.chosen:
            term = self.terms[i]
            if term is not None and term.family == "stop" and self.strengths[i][0] > 0:
                contact = self._contact(term, self.strengths[i])
        at = SHARES.index(self.cell.share)
        near = SHARES[max(at - 2, 0) : at + 2]
        state = self.state
        return State(
            state.stiffness,
            state.damping,
            max(self.cell.share, SHARES[0] * 2),
            found.torque,
            contact,
            self._finer(),
            near,
        )

    def _contact(self, term: Term, strengths: Array) -> Contact:
        """Return a stop as an added stiffness and damping."""
        x, v = self.smoothed.angle, self.smoothed.rate
        torque, acts = term.columns @ strengths, np.abs(term.columns[..., 0]) > 0
        table = np.column_stack([x[acts], v[acts], np.sign(x[acts])])
        k, d, _ = np.maximum(np.linalg.lstsq(table, torque[acts], rcond=None)[0], 0.0)
        return Contact(acts, float(k), float(d), k * x + d * v)

    def _finer(self) -> dict[str, list[Shape]]:
        """Return the best shapes of each law, and around the best one of those in reach a finer grid."""
        best: dict[str, dict[Shape, float]] = {}
        logs = np.concatenate([c.sets.log_evidence for c in self.cells])
        rows = np.concatenate([c.sets.items for c in self.cells])
        for r in np.argsort(-logs):
            for i in rows[r]:
                term = self.terms[i] if i >= 0 else None
                if term is not None and len(best.get(term.effect, ())) < KEPT:
                    best.setdefault(term.effect, {}).setdefault(term.shape, float(logs[r]))
        grids: dict[str, list[Shape]] = {}
        for name, shapes in best.items():
            first, value = next(iter(shapes.items()))
            near = first.finer() if value > logs.max() - REACH and first.values else [first]
            grids[name] = [*near, *(s for s in shapes if s is not first)]
        return grids


SETS = 8
"""Sets of families that are kept."""
KEPT = 3
"""Shapes of a law that the next pass keeps."""
