"""Which laws act: three passes of smoothing, regression and evidence.

Each pass smooths the log with the torque of the pass before. It evaluates all laws on that motion. It sums the evidence of every set of
laws over two unknowns: ε, the error of the equations, and τ, the size of a torque g without a name. g is a Gaussian process of angle and
rate with a slow drift of stiffness and damping (O'Hagan and Kennedy, J. R. Stat. Soc. B 63, 2001).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.optimize import lsq_linear

from sysid.diagnosis.evidence import (
    BREADTH,
    STRENGTH,
    Problem,
    Sets,
    families_of,
    items_of,
    joined,
    log_odds,
    marginalised,
    search,
    single,
    solve,
)
from sysid.diagnosis.laws import SHOWS, Laws, Shape, Term
from sysid.diagnosis.motion import CLEAR, QUIET, Motion
from sysid.diagnosis.nuisances import BEND, BENDS, HATS, bends, hand, nameless, sensor
from sysid.diagnosis.smoother import Smoothed, Smoother
from sysid.effects._base import Effect, TorqueEffect
from sysid.roll import Array

SHARES = tuple(float(share) for share in np.geomspace(0.0015, 0.15, 5))
"""ε: torque noise over the local torque, from an exact law to one that says little, half a decade apart."""
NAMELESS = (0.0, 0.04, 0.15)
"""τ: RMS of g over that of the spring's torque."""
PASSES = 3
"""Passes of smoothing and regression: each starts nearer to the torque."""
LOUD = 1.25
"""χ² over the number of samples up to which a motion is explained to its noise."""
KEPT = 3
"""Shapes of a law that the next pass keeps."""


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
    damping: float
    """d of the linear part beside the best set, in the motion's units."""
    loss: float
    """d of a linear joint that loses as much."""
    sets: tuple[Found, ...]
    """Sets of families, the likeliest first."""
    singles: tuple[Found, ...]
    """The likeliest law of each family alone."""
    inclusion: Mapping[str, float]
    """Probability that a family acts."""
    share: float
    """ε of the best hypothesis."""
    nameless: float
    """RMS of g beside the laws of the best set, over the spring's torque; nan by the slow flow, which has no g."""
    torque: Array
    """All torque beside spring and damper over I ω₀² A on the smoothed motion, shape (r, n)."""
    misfit: float
    """χ² over the number of samples."""
    by_cycles: bool = False
    """Whether the sets are judged by the slow flow instead of the equations."""
    sizes: Mapping[str, Size] = field(default_factory=dict[str, Size])
    """Of the families in the best set, from its fit."""

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
    grids: Mapping[str, list[Shape]] = field(default_factory=dict[str, list[Shape]])
    shares: Sequence[float] = SHARES[1::2]
    excess: float = 1.0
    """χ² over the number of samples in the pass before, at least 1: errors that last are not in the noise of neighbouring samples."""


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


def posterior(motion: Motion, subject: Subject) -> Posterior:
    """Return the posterior of sets of laws.

    Args:
        motion: The log.
        subject: The joint.
    """
    stiffness, damping = linear_joint(motion)
    motion = moving = until_still(motion, stiffness, damping)
    state, envelope = State(stiffness, damping), motion.envelope
    for left in reversed(range(PASSES)):
        smoother = Smoother(motion, state.stiffness, state.damping, envelope)
        step = Pass(motion, smoother.smooth(state.share, state.torque), subject, state, envelope)
        found = step.run(bend=not left)
        if left:
            state = step.next_state(found)
            envelope = motion.local(found.torque, stiffness)
            motion = _without_hands(moving, state, envelope)
    return replace(found, loss=damping)  # pyright: ignore[reportPossiblyUnboundVariable]


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
        slow = np.maximum(3 * np.sqrt(smoothed.rate_variance[row, :n]), QUIET)
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


def _without_hands(motion: Motion, state: State, envelope: Array) -> Motion:
    """Return the motion without what hands touched: ends of releases whose misfit stands out get no weight.

    A free joint's misfit is that of white noise, block by block; a hand's is not.
    """
    smoother = Smoother(motion, state.stiffness, state.damping, envelope)
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

    for row, n in enumerate(motion.length):
        for begin in range(max(n - 6 * size, n // 2), n, max(size // 2, 1)):
            if stands_out(row, begin, min(begin + size, n)):
                variance[row, begin:], length[row], free[row, 1] = np.inf, begin, begin
                break
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
    cells: Sequence[tuple[Problem, Sets]], terms: Sequence[Term], linear: Mapping[str, tuple[float, float]]
) -> tuple[tuple[Found, ...], tuple[Found, ...], dict[str, float], int, list[int]]:
    """Return sets of families and single families over all hypotheses, inclusion, the best hypothesis, and its best items.

    Args:
        cells: Hypotheses of the noise with the evidence of their sets.
        terms: All terms.
        linear: Value of 'stiffness' and 'damping' where their coefficients are 0, and the unit of these.
    """
    logs, masks, rows = (
        np.concatenate([getattr(s, name) for _, s in cells]) for name in ("log_evidence", "families", "items")
    )
    which = np.repeat(np.arange(len(cells)), [len(s.log_evidence) for _, s in cells])
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    ranked = sorted(((float(weights[masks == m].sum()), int(m)) for m in np.unique(masks)), reverse=True)
    inclusion = {f: float(weights[masks >> i & 1 == 1].sum()) for i, f in enumerate(families_of(terms))}

    def best(mask: int) -> tuple[int, list[int]]:
        top = np.flatnonzero(masks == mask)[int(np.argmax(logs[masks == mask]))]
        return int(which[top]), [int(i) for i in rows[top] if i >= 0]

    def found(probability: float, mask: int) -> Found:
        cell, items = best(mask)
        means, picked = solve(cells[cell][0], items).means, [terms[i] for i in items]
        parameters = {
            n: zero + unit * float(m) for (n, (zero, unit)), m in zip(linear.items(), means, strict=False)
        }
        at = cells[cell][0].base
        for term in picked:
            parameters |= term.fitted(means[at : at + len(term.unit)])
            at += len(term.unit)
        return Found(
            families=tuple(t.family for t in picked), effects=tuple(t.effect for t in picked), probability=probability,
            parameters=parameters,
        )  # fmt: skip

    sets = tuple(found(*one) for one in ranked[:BREADTH])
    singles = tuple(found(chance, mask) for chance, mask in ranked if mask and mask & (mask - 1) == 0)
    return sets, singles, inclusion, *best(ranked[0][1])


def _likeliest(cells: Sequence[Cell]) -> float:
    """Return the log evidence of the best set under the best hypothesis [1]."""
    return max(float(cell.sets.log_evidence.max()) for cell in cells)


class Pass:
    """One pass: columns, Gram matrices, evidence."""

    def __init__(
        self, motion: Motion, smoothed: Smoothed, subject: Subject, state: State, envelope: Array
    ) -> None:
        """Evaluate all laws on a smoothed motion."""
        self.motion, self.smoothed, self.state = motion, smoothed, state
        inside = self.inside = motion.inside
        rest = motion.zero == "known" and not motion.is_rate and subject.has_zero
        laws = Laws(motion, subject.inertia, state.stiffness, state.damping)
        known = laws.recorded(smoothed, subject.known)
        base = [smoothed.angle, smoothed.rate, *([] if rest else levels(motion)), *known]
        self.base = np.column_stack([c[inside] for c in base])
        self.wide = np.array([state.stiffness, 2 * state.damping, *[1.0] * (len(base) - 2)])
        self.linear = float(np.sqrt(np.mean((state.stiffness * smoothed.angle[inside]) ** 2)))
        frame = np.linalg.qr(np.column_stack([self.base[:, :2], np.ones(len(self.base))]))[0]
        self.terms: list[Term] = []
        for term in (*laws.terms(smoothed, subject.parts, state.grids), *([laws.rest()] if rest else [])):
            seen = term.columns[inside]
            beside = np.linalg.norm(seen - frame @ (frame.T @ seen))
            if beside > SHOWS * np.linalg.norm(seen) or term.family == "rest":
                self.terms.append(term.scaled(self.linear / np.sqrt(np.mean(seen**2, axis=0))))
        self.columns = np.column_stack([term.columns[inside] for term in self.terms])
        self.items = items_of(self.terms, 1 + self.base.shape[1])
        self.g = nameless(motion, smoothed, self.linear, state.damping)
        self.hand, self.held = hand(motion), 0
        self.sensed, self.loose = sensor(motion, smoothed)
        self.smoother = Smoother(motion, state.stiffness, state.damping, envelope)
        w = motion.frequency
        units = {"stiffness": subject.inertia * w * w, "damping": subject.inertia * w}
        self.units = {name: (getattr(state, name) * unit, unit) for name, unit in units.items()}

    def run(self, *, bend: bool) -> Posterior:
        """Return the posterior; `bend` lets laws be off by a share of themselves.

        A hand that lets go slowly or pushes is one more cause, with the prior of a seldom one. It acts or not, whatever the laws: for a
        quarter, half or whole of a period. The shortest one that explains the log is taken.
        """
        grams = self._grams()
        cells, prior = self._cells(grams, search, 0.0), log_odds("hand")
        for shorter, self.held in pairwise((0, HATS // 4, HATS // 2, HATS)):
            longer = self._cells(grams, search, 0.0)
            if _likeliest(longer) + prior < _likeliest(cells):
                self.held = shorter
                break
            cells, prior = longer, 0.0
        if bend:
            sets = self._bent(cells)

            def scored(problem: Problem) -> Sets:
                return joined([single(problem, solve(problem, s)) for s in sets])

            cells = self._cells(self._grams(), scored, BEND)
        return self._summary(cells)

    @property
    def _torques(self) -> Array:
        """Columns of all torques: of the base, the laws, g and a hand, shape (n, m) [1]."""
        return np.column_stack([self.base, self.columns, self.g, self.hand])

    def _grams(self) -> list[tuple[float, Array, float]]:
        """Return each ε with the Gram matrix of the log, all torques and the sensor's terms, and the spread of the log."""
        self.smoother.prepare(self._torques, self.sensed)
        return [(share, *self.smoother.gram(share)) for share in self.state.shares]

    def _cells(
        self, grams: Sequence[tuple[float, Array, float]], scored: Callable[[Problem], Sets], bend: float
    ) -> list[Cell]:
        """Return the evidence of all hypotheses of the noise.

        Args:
            grams: ε, Gram matrix and spread of each.
            scored: Gives the sets of a problem.
            bend: Prior deviation of each bend of a law, as a share of its strength.
        """
        named = 1 + self.base.shape[1] + self.columns.shape[1]
        last = named + self.g.shape[1]
        cells: list[Cell] = []
        for share, whole, spread in grams:
            whole = whole / self.state.excess
            own, extra = marginalised(whole, last + self.hand.shape[1], self.loose)
            if acting := self.held * len(self.motion.length):
                own, more = marginalised(own[: last + acting, : last + acting], last, np.ones(acting))
                extra += more
            for tau in NAMELESS:
                reduced, more = own[:named, :named], 0.0
                if tau:
                    reduced, more = marginalised(own[:last, :last], named, np.full(last - named, tau))
                prior = -np.log(2.0 * (len(NAMELESS) - 1 if tau else 1))
                constant = float(extra + more + prior - 0.5 * (spread + reduced[0, 0]))
                problem = Problem(reduced, self.wide, self.items, self.state.damping, bend)
                sets = scored(problem)
                sets = replace(sets, log_evidence=sets.log_evidence + constant)
                cells.append(Cell(share, tau, whole, problem, sets))
        return cells

    def _bent(self, cells: Sequence[Cell]) -> list[tuple[int, ...]]:
        """Keep the laws of the best set of each set of families, add how each may be off, and return these sets."""
        logs, masks, every = (
            np.concatenate([getattr(cell.sets, name) for cell in cells])
            for name in ("log_evidence", "families", "items")
        )
        order = np.argsort(-logs)
        firsts = order[np.unique(masks[order], return_index=True)[1]]
        rows = {tuple(int(i) for i in every[f] if i >= 0) for f in firsts}
        kept = sorted({i for row in rows for i in row})
        self.terms = [self.terms[i] for i in kept]
        columns = np.column_stack([term.columns[self.inside] for term in self.terms])
        shapes = bends(self.motion, self.smoothed)
        self.columns = np.column_stack([columns, *(column[:, None] * shapes for column in columns.T)])
        first = 1 + self.base.shape[1]
        bent = first + columns.shape[1]
        self.items = [
            replace(
                new, log_prior=self.items[i].log_prior,
                bends=tuple(bent + (c - first) * BENDS + b for c in new.columns for b in range(BENDS)),
            )
            for i, new in zip(kept, items_of(self.terms, first), strict=True)
        ]  # fmt: skip
        new = {i: k for k, i in enumerate(kept)}
        return sorted(tuple(new[i] for i in row) for row in rows)

    def _summary(self, cells: Sequence[Cell]) -> Posterior:
        """Return sets and inclusion from all evidence, and the torque of the best hypothesis."""
        sets, singles, inclusion, which, chosen = found_sets(
            [(c.problem, c.sets) for c in cells], self.terms, self.units
        )
        self.share, self.cells = cells[which].share, cells
        own = [c for i in chosen for c in self.items[i].columns]
        c, misfit = self._solved(cells[which], chosen)
        torques, base = self._torques, self.base.shape[1]
        c, named = c[1 : 1 + torques.shape[1]], base + self.columns.shape[1]
        known = np.linalg.qr(torques[:, [*range(base), *(i - 1 for i in own)]])[0]
        g = self.g @ c[named : named + self.g.shape[1]]
        free = self.motion.free.copy()
        if self.held:
            free[:, 0] = self.motion.nodes_a_period * self.held // HATS
        return Posterior(
            motion=replace(self.motion, free=free), damping=self.state.damping + float(c[1]), loss=self.state.damping, sets=sets, singles=singles,
            inclusion=inclusion, share=self.share, nameless=float(np.sqrt(np.mean((g - known @ (known.T @ g)) ** 2)) / self.linear),
            torque=self.smoother.grid(torques @ c), misfit=misfit * self.state.excess,
        )  # fmt: skip

    def _solved(self, cell: Cell, chosen: Sequence[int]) -> tuple[Array, float]:
        """Return the strengths of all columns of a Gram matrix within their signs, and χ² over the number of samples.

        Args:
            cell: Hypothesis of the noise.
            chosen: Items that act.
        """
        base, gram, items = self.base.shape[1], cell.gram, [self.items[i] for i in chosen]
        own, loose = [c for i in items for c in i.columns], [c for i in items for c in i.bends]
        first = 1 + base + self.columns.shape[1]
        last = first + self.g.shape[1]
        of_g = range(first, last) if cell.tau else range(0)
        of_hand = range(last, last + self.held * len(self.motion.length))
        sensed = range(last + self.hand.shape[1], len(gram))
        free = np.array([*range(1, 1 + base), *own, *loose, *of_g, *of_hand, *sensed], dtype=np.intp)
        bend = BEND * np.repeat(np.abs(solve(cell.problem, chosen).means[base:]), BENDS) if loose else []
        prior = np.r_[
            self.wide, [STRENGTH] * len(own), np.maximum(bend, 1e-9), [cell.tau] * len(of_g), [1.0] * len(of_hand),
            self.loose,
        ]  # fmt: skip
        inner, right = gram[np.ix_(free, free)] + np.diag(prior**-2.0), gram[free, 0]
        root, low = np.linalg.cholesky(inner), np.full(len(free), -np.inf)
        low[base : base + len(own)] = [0.0 if s else -np.inf for i in items for s in i.signs]
        low[1] = 1e-3 - self.state.damping
        bounds = low, np.full(len(free), np.inf)
        c = lsq_linear(root.T, np.linalg.solve(root, right), bounds, method="bvls").x
        chi = gram[0, 0] - 2 * c @ right + c @ gram[np.ix_(free, free)] @ c
        strengths = np.zeros(len(gram))
        strengths[free] = c
        return strengths, float(chi / max(int(np.isfinite(self.motion.variance[self.inside]).sum()), 1))

    def next_state(self, found: Posterior) -> State:
        """Return what the next pass starts from: the torque, shapes near the best ones, and hypotheses near the best one."""
        at = SHARES.index(self.share)
        return State(
            self.state.stiffness, self.state.damping, share=max(self.share, SHARES[0] * 2), torque=found.torque, grids=self._finer(found),
            shares=SHARES[max(at - 2, 0) : at + 2], excess=max(found.misfit, 1.0),
        )  # fmt: skip

    def _finer(self, found: Posterior) -> dict[str, list[Shape]]:
        """Return the best shapes of each law, and a finer grid around the best one of those in the likeliest sets."""
        reached = np.full(len(self.terms) + 1, -np.inf)  # the last one: where a set has fewer items
        for cell in self.cells:
            np.maximum.at(reached, cell.sets.items, cell.sets.log_evidence[:, None])
        grids: dict[str, list[Shape]] = {}
        for i in np.argsort(-reached[:-1]):
            shapes = grids.setdefault(self.terms[i].effect, [])
            if np.isfinite(reached[i]) and len(shapes) < KEPT:
                shapes.append(self.terms[i].shape)
        near = {name for one in found.sets for name in one.effects if grids[name][0].values}
        return {
            name: [*(first.finer() if name in near else [first]), *others]
            for name, (first, *others) in grids.items()
        }
