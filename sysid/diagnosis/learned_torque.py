"""A learned torque: tables of angle and rate as columns of the regression that weighs laws.

    τ = f(x) + g(v) + h(x, v),   values of the tables ~ N(0, (Σ w F)⁻¹)

Each F is the roughness of one part of the tables (`sysid.effects.learned`). Its weight w has the largest evidence (MacKay, Neural
Computation 4, 1992); a part without evidence is zero. The regression on the smoothed motion is linear, so that it needs no start.
A fit by output error follows from there, and its normal equations choose the weights again.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from sysid.board import Board
from sysid.diagnosis.evidence import STRENGTH, closed, marginalised
from sysid.diagnosis.laws import Laws
from sysid.diagnosis.motion import Motion, motion_of
from sysid.diagnosis.nuisances import sensor
from sysid.diagnosis.posterior import PASSES, SHARES, levels, linear_joint
from sysid.diagnosis.shapes import SHAPES, Formula, Shape
from sysid.diagnosis.smoother import Smoothed, Smoother
from sysid.effects.learned import EFFECT, SUPPORT, basis, smoothness
from sysid.errors import SysidError
from sysid.fitting.cross_validation import rms
from sysid.fitting.joint import FitOptions, finished, fit_joint, options_for
from sysid.fitting.problem import ZERO_TABLE_WEIGHT, Problem
from sysid.fitting.records import measured_rest
from sysid.fitting.result import JointFit
from sysid.joint.structure import structure_of
from sysid.least_squares import Minimum
from sysid.roll import Array, Release

NAME = EFFECT.name
WEIGHTS = tuple(10.0**e for e in range(6, -3, -1))
"""Weights of roughness, for values in units of a tenth of the spring's torque: from straight to free."""
DRIFTS = (1.0, 0.1, 0.01, 1e-6)
"""Prior deviations of a drift that are tried, over those of a law: by decades from as strong as a law, and none."""


@dataclass(frozen=True, slots=True)
class Chosen:
    """The tables as a linear regression finds them."""

    weights: tuple[float, ...]
    """Of each part."""
    log_evidence: float
    """Above that of no table."""
    log_likelihood: float
    """The same without what the prior costs."""
    values: Array
    """Posterior mean in the coordinates of the prior, shape (q,)."""

    @property
    def is_nothing(self) -> bool:
        """Whether no part has evidence."""
        return min(self.weights) >= ZERO_TABLE_WEIGHT


def choose(inner: Array, right: Array) -> Chosen:
    """Choose the weights of all parts, one after another, until none changes.

    Args:
        inner: Information on the coordinates of the prior [1], shape (q, q).
        right: Its product with their estimate [1], shape (q,).
    """
    known = smoothness()

    def regressed(weights: Sequence[float]) -> Chosen:
        each = np.array(weights)[known.part]
        kept = np.flatnonzero(each < ZERO_TABLE_WEIGHT)
        precision = known.weighted(weights)[kept]
        lower = np.linalg.cholesky(inner[np.ix_(kept, kept)] + np.diag(precision))
        half = solve_triangular(lower, right[kept], lower=True, check_finite=False)
        likelihood = 0.5 * float(half @ half)
        occam = 0.5 * float(np.log(precision).sum()) - float(np.log(np.diag(lower)).sum())
        values = np.zeros(len(right))
        values[kept] = solve_triangular(lower, half, lower=True, trans=1, check_finite=False)
        # A part acts or not with even odds; each weight of an acting one is as likely.
        acting = sum(w < ZERO_TABLE_WEIGHT for w in weights)
        return Chosen(tuple(weights), likelihood + occam - acting * np.log(len(WEIGHTS)), likelihood, values)

    best = regressed([ZERO_TABLE_WEIGHT] * (int(known.part[-1]) + 1))
    while True:
        before = best
        for part in range(len(best.weights)):
            tried = [
                (*best.weights[:part], w, *best.weights[part + 1 :]) for w in (ZERO_TABLE_WEIGHT, *WEIGHTS)
            ]
            best = max((best, *map(regressed, tried)), key=lambda one: one.log_evidence)
        if best.weights == before.weights:
            return best


class Pass:
    """One pass: the smoothed motion, and the columns that are in every hypothesis."""

    def __init__(
        self, motion: Motion, smoother: Smoother, smoothed: Smoothed, laws: Laws, known: Sequence[Array]
    ) -> None:
        """Take a smoothed motion, and the torques of effects beside the tables, shape (r, n) each."""
        self.motion, self.smoother, self.laws = motion, smoother, laws
        inside = motion.inside
        self.x, self.v = smoothed.angle[inside], smoothed.rate[inside]
        self.base = np.column_stack([self.x, self.v, *(k[inside] for k in (*levels(motion), *known))])
        self.wide = np.ones(self.base.shape[1])
        self.sensed, self.loose = sensor(motion, smoothed)
        a, w = motion.amplitude, motion.frequency
        self.angle, self.rate = a * self.x, a * w * self.v
        ends = (self.angle.min(), self.angle.max(), self.rate.min(), self.rate.max())
        self.support: dict[str, float] = dict(zip(SUPPORT, map(float, ends), strict=True))

    def scaled(self, torque: Array) -> Array:
        """Return a torque [1], shape (n,), with the size of the spring's: at a strength of 1."""
        return torque * np.linalg.norm(self.x) / np.linalg.norm(torque)

    @cached_property
    def table(self) -> Array:
        """Opposing torque of each coordinate of the tables at one tenth of the spring's torque [1], shape (n, q)."""
        size = 0.1 * self.laws.scales.torque / self.laws.unit
        return -size * basis(self.angle, self.rate, self.support) @ smoothness().space

    def prepare(self, columns: Array) -> None:
        """Take the columns of the next Gram matrices: opposing torques [1], shape (n, c)."""
        self.columns = columns
        self.smoother.prepare(np.column_stack([columns, self.base]), self.sensed)

    def gram(self, share: float) -> tuple[Array, float]:
        """Return the Gram matrix of log and columns without all else [1], shape (1 + c, 1 + c), and the log evidence of no column."""
        whole, spread = self.smoother.gram(share)
        gram, factor = marginalised(whole, 1 + self.columns.shape[1], np.r_[self.wide, self.loose])
        return gram, factor - 0.5 * spread - 0.5 * float(gram[0, 0])

    def beside(self, share: float, strengths: Array) -> tuple[Array, Array]:
        """Return the strengths of the base beside those of the columns [1], shape (b,), and the whole torque [1], shape (r, n)."""
        gram, n = self.smoother.gram(share)[0], 1 + len(strengths)
        inner, right = gram[n:, n:], gram[n:, 0] - gram[n:, 1:n] @ strengths
        solved = np.linalg.solve(inner + np.diag(np.r_[self.wide, self.loose] ** -2.0), right)
        found = np.asarray(solved[: len(self.wide)], dtype=np.float64)
        return found, self.smoother.grid(self.columns @ strengths + self.base @ found)


@dataclass(frozen=True, slots=True, kw_only=True)
class Regressed:
    """The learned torque as the regression finds it."""

    chosen: Chosen
    end: Pass
    """The last pass."""
    share: float
    """ε of the likeliest hypothesis."""
    stiffness: float
    """Of the joint beside the tables [N*m/rad]."""
    damping: float
    """[N*m*s/rad]."""
    log_evidence: float
    """Of the likeliest hypothesis."""


def regress(motion: Motion, plain: JointFit) -> Regressed:
    """Return the torque that the motion shows beside the laws of a fit.

    Args:
        motion: The log.
        plain: Fit of the joint without tables; its effects act with their fitted parameters.
    """
    k, d = linear_joint(motion)
    law, parameters = plain.law, plain.problem.parameters(plain.minimum.point)
    laws = Laws(motion, law.inertia, k, d)
    laws.scales = replace(plain.problem.scales, duration=laws.scales.duration)
    known = [
        (part, {p: parameters[f"{part.name}.{p}"] for p in part.parameter_names})
        for part in law.structure.torques if part.changing is None and part.modifies is None
    ]  # fmt: skip
    unit = law.inertia * motion.frequency

    def regressed(share: float, torque: Array | None, envelope: Array) -> tuple[Regressed, Array]:
        smoother = Smoother(motion, k, d, envelope)
        smoothed = smoother.smooth(share, torque)
        here = Pass(motion, smoother, smoothed, laws, laws.recorded(smoothed, known))
        here.prepare(here.table)
        likeliest: list[tuple[float, float, Chosen]] = []
        for one in SHARES:
            gram, constant = here.gram(one)
            chosen = choose(gram[1:, 1:], gram[1:, 0])
            likeliest.append((constant + chosen.log_evidence, one, chosen))
        log_evidence, share, chosen = max(likeliest, key=lambda one: one[0])
        found, torque = here.beside(share, chosen.values)
        return Regressed(
            chosen=chosen, end=here, share=share, stiffness=(k + found[0]) * unit * motion.frequency, damping=(d + found[1]) * unit,
            log_evidence=log_evidence,
        ), torque  # fmt: skip

    last, torque = regressed(SHARES[-2], None, motion.envelope)
    for _ in range(PASSES - 1):
        last, torque = regressed(last.share, torque, motion.local(torque, k))
    return last


def changes_with_time(found: Regressed) -> bool:
    """Return whether a spring and a damper that drift are likelier than the tables: as cubics within a release, and between releases."""
    end, inside = found.end, found.end.motion.inside
    row, node = np.nonzero(inside)
    within, between = node / inside.shape[1], row / len(inside)
    drifts = [within, within**2, within**3, *([between] if len(inside) > 1 else [])]
    end.prepare(np.column_stack([end.scaled(drift * swing) for drift in drifts for swing in (end.x, end.v)]))
    columns, sizes = np.arange(1, 1 + 2 * len(drifts)), list(itertools.product(DRIFTS, repeat=2))
    priors = [np.tile(STRENGTH * np.array(size), len(drifts)) for size in sizes]
    each = (end.gram(share) for share in SHARES)
    best = max(constant + closed(g, columns, prior)[0] for g, constant in each for prior in priors)
    best -= np.log(len(sizes))
    return best > found.log_evidence


@dataclass(frozen=True, slots=True)
class Term:
    """One shape at one width [rad]."""

    shape: Shape
    width: float
    column: Array
    """Its opposing torque at a strength of 1, shape (n,)."""
    size: float
    """Its coefficient there."""


def _terms(end: Pass, each: Sequence[tuple[Shape, float]]) -> list[Term]:
    """Return shapes as columns; a shape that is zero along the motion is left out."""
    terms: list[Term] = []
    for shape, width in each:
        torque = -shape.torque(end.angle, end.rate, width) / end.laws.unit
        if np.abs(torque).max() > 0:
            column = end.scaled(torque)
            terms.append(Term(shape, width, column, float(np.linalg.norm(column) / np.linalg.norm(torque))))
    return terms


def _nearest(end: Pass, share: float, terms: Sequence[Term]) -> tuple[float, float, list[tuple[Term, float]]]:
    """Return log evidence and log likelihood of the likeliest term, alone or with another one, and their strengths."""
    end.prepare(np.column_stack([term.column for term in terms]))
    gram, _ = end.gram(share)
    names = [term.shape.name for term in terms]

    def weighed(*picked: int) -> tuple[float, tuple[int, ...], Array]:
        log, strengths, _ = closed(gram, np.array(picked) + 1, np.full(len(picked), STRENGTH))
        return log - sum(np.log(len(SHAPES) * names.count(names[i])) for i in picked), picked, strengths

    def evidence(one: tuple[float, tuple[int, ...], Array]) -> float:
        return one[0]

    first = max((weighed(i) for i in range(len(terms))), key=evidence)
    pairs = (weighed(*first[1], j) for j, name in enumerate(names) if name != names[first[1][0]])
    log, picked, strengths = max((first, *pairs), key=evidence)
    likelihood = 0.5 * float(gram[0, np.array(picked) + 1] @ strengths)
    return log, likelihood, [(terms[i], float(c)) for i, c in zip(picked, strengths, strict=True)]


def formula_of(found: Regressed, *, slides: bool = False) -> Formula | None:
    """Return the formula nearest to the tables, None if nothing was learned.

    All shapes, and the best with any other, are weighed in the place of the tables; then the best widths are refined.
    """
    if found.chosen.is_nothing:
        return None
    end, reach = found.end, float(np.abs(found.end.angle).max())
    each = [(shape, w * reach) for shape in SHAPES for w in shape.widths or (0.0,)]
    ratio = 1.2
    evidence, likelihood, picked = _nearest(end, found.share, _terms(end, each))
    for _ in range(PASSES - 1):
        steps = np.geomspace(1 / ratio, ratio, 9)
        each = [(t.shape, t.width * f) for t, _ in picked for f in (steps if t.shape.widths else (1.0,))]
        evidence, likelihood, picked = _nearest(end, found.share, _terms(end, each))
        ratio **= 0.3
    plain = np.column_stack([end.x, end.v])
    peaks: list[float] = []
    for term, strength in picked:
        torque = strength * term.column * end.laws.unit
        torque = torque - plain @ np.linalg.lstsq(plain, torque, rcond=None)[0]
        peaks.append(float(np.abs(torque).max()))
    return Formula(
        shapes=tuple(term.shape for term, _ in picked), coefficients=tuple(c * term.size for term, c in picked),
        widths=tuple(term.width for term, _ in picked), peaks=tuple(peaks),
        share=min(likelihood / found.chosen.log_likelihood, 1.0), good=bool(evidence > found.chosen.log_evidence), slides=slides,
    )  # fmt: skip


def learn(
    releases: Sequence[Release], board: Board, effects: Sequence[str], options: FitOptions
) -> tuple[JointFit, Formula | None]:
    """Fit a joint with a learned torque to releases.

    Args:
        releases: Free decays.
        board: The record.
        effects: All effects of the joint, the learned one among them.
        options: Options of the fit.

    Raises:
        SysidError: As `fit_joint`, and for a parameter with a prior.
    """
    if options.priors:
        raise SysidError(
            f"a learned torque and a prior of {', '.join(options.priors)}: fit the one without the other."
        )
    others = [name for name in effects if name != NAME]
    plain = fit_joint(releases, board, others, options_for(options, others, board))
    rest = measured_rest(plain.problem.records)
    motion = motion_of(releases, rest, plain.noise.std, rate=options.use_rate)
    found = regress(motion, plain)
    problem, start = _problem(found, plain, effects, options, rest)
    problem, minimum = _by_output_error(problem, start, found.chosen.weights)
    fit = finished(problem, minimum, board, options, plain.noise, plain.evaluations + minimum.evaluations)
    formula = formula_of(found, slides=board.slides)
    return replace(fit, warnings=(*fit.warnings, *_left(fit, found))), formula


def _problem(
    found: Regressed, plain: JointFit, effects: Sequence[str], options: FitOptions, rest: float
) -> tuple[Problem, Array]:
    """Return the fit by output error with the tables, and its start, shape (p,): all but the tables is fitted beside them."""
    records, chosen = plain.problem.records, found.chosen
    support = dict(found.end.support)
    if not records[0].is_rate:  # the start of a release has no weight in the regression
        rolls = np.concatenate([record.release.roll for record in records]) - rest
        support["tilt_low"] = min(support["tilt_low"], float(rolls.min()))
        support["tilt_high"] = max(support["tilt_high"], float(rolls.max()))
    edges = {f"{NAME}.{name}": value for name, value in support.items()}
    problem = plain.problem.with_(
        structure=structure_of(effects), fixed={**plain.problem.fixed, **edges, **options.fixed},
        bounded=dict(options.bounds), smoothing=chosen.weights,
    )  # fmt: skip
    values = 0.1 * plain.problem.scales.torque * smoothness().space @ chosen.values
    tables = {f"{NAME}.{name}": float(v) for name, v in zip(smoothness().names, values, strict=True)}
    known = {**plain.problem.parameters(plain.minimum.point), "rest_angle": rest}
    if len(effects) == 1:  # else other effects may hold a part of it
        known |= {"stiffness": found.stiffness, "damping": max(found.damping, 0.0)}
    held = problem.with_(fixed={**problem.fixed, **tables}, smoothing=())
    near = held.fitted(held.start(known), 30)
    start = problem.start({**tables, **held.parameters(near.point)})
    return problem, np.r_[start[: len(problem.names)], near.point[len(held.names) :]]


def _by_output_error(problem: Problem, start: Array, weights: tuple[float, ...]) -> tuple[Problem, Minimum]:
    """Fit tables by output error, and choose their weights again at each minimum."""
    minimum, evaluations = problem.fitted(start, 30), 0
    for _ in range(PASSES):
        if min(weights) >= ZERO_TABLE_WEIGHT:
            break
        inner, right, excess = _information(problem, minimum)
        again = choose(inner, right).weights
        evaluations += minimum.evaluations
        smoothing = tuple(min(excess * w, ZERO_TABLE_WEIGHT) for w in again)
        problem = problem.with_(smoothing=smoothing)
        minimum = problem.fitted(minimum.point, 30)
        if again == weights:
            break
        weights = again
    return problem, replace(minimum, evaluations=minimum.evaluations + evaluations)


def _information(problem: Problem, minimum: Minimum) -> tuple[Array, Array, float]:
    """Return the arguments of `choose` from normal equations, and the variance of the residuals over that of the sensor, 1 or more."""
    excess = max(rms(problem.residuals(minimum.point)) / problem.records[0].std, 1.0) ** 2
    names, point = list(problem.names), minimum.point
    normal = problem.with_(smoothing=()).normal(point)
    # As rows of a regression, from which what the other unknowns explain is taken: a difference of matrices would lose digits.
    values, vectors = np.linalg.eigh(normal.hessian / excess)
    fixed = values > 1e-13 * values[-1]
    rows = np.sqrt(values[fixed])[:, None] * vectors[:, fixed].T
    log = rows @ point - vectors[:, fixed].T @ normal.gradient / excess / np.sqrt(values[fixed])
    mine = np.array([names.index(f"{NAME}.{name}") for name in smoothness().names])
    other = np.linalg.qr(np.delete(rows, mine, axis=1))[0]
    columns = rows[:, mine] @ smoothness().space
    columns = columns - other @ (other.T @ columns)
    return columns.T @ columns, columns.T @ log, excess


def _left(fit: JointFit, found: Regressed) -> list[str]:
    """Warn of a residual beyond any torque of angle and rate."""
    if changes_with_time(found):
        return [
            "the missing torque changes with time rather than with angle and rate (warming, loosening): a spring and a damper that drift are "
            "likelier. Compare early releases with late ones"
        ]
    if fit.rmse <= fit.noise.highest:
        return []
    return [
        f"a torque of angle and rate leaves {fit.rmse / fit.noise.std:.2f} times the noise. The rest changes with time (warming, loosening, another push), "
        "remembers the path, or is sensor noise. Compare early releases with late ones"
    ]


def learned_torque(
    fit: JointFit, tilt: Array, rate: Array, *, with_joint: bool = False
) -> tuple[Array, Array]:
    """Return the learned torque of a fit at tilts [rad] from rest and rates [rad/s], and its deviation [N*m], shape (n,) each.

    Args:
        fit: A fit with tables.
        with_joint: Add spring and damper. The tables have no linear part, so that alone they depend on how it was told apart.
    """
    law, names = fit.law, list(fit.quantities)
    rows = np.zeros((len(names), len(tilt)))
    columns = basis(tilt, rate, EFFECT.named(dict(law.effects)[NAME])).T
    for name, row in zip(smoothness().names, columns, strict=True):
        rows[names.index(f"{NAME}.{name}")] = row
    for name, slope in (("stiffness", -tilt), ("damping", -rate)):
        if with_joint and name in fit.quantities:
            rows[names.index(name)] = slope
    values = np.array([quantity.value for quantity in fit.quantities.values()])
    variance = np.einsum("in,ij,jn->n", rows, fit.covariance, rows)
    return values @ rows, np.sqrt(np.maximum(variance, 0.0))
