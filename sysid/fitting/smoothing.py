"""Fit of tabulated torques, with smoothness chosen by hold-out error.

The roughness of each table counts in the sum of squares as a measurement would. Its weight is the one with which other motion
is predicted best, found from the normal equations of each release alone: near a fit everything is linear, and leaving a
release out is algebra. A table that gains nothing stays zero.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.effects._base import Effect, Scales, TorqueEffect
from sysid.fitting.cross_validation import rms
from sysid.fitting.problem import Problem
from sysid.fitting.records import Bias, Record, measured_rest
from sysid.fitting.search import first_swings, search, starting_points
from sysid.joint.law import JointLaw
from sysid.joint.structure import LINEAR, Structure, structure_of
from sysid.joint.trajectory import simulate
from sysid.least_squares import Minimum, minimise
from sysid.noise.whiteness import correlation_length
from sysid.roll import Array

ZERO_TABLE_WEIGHT = 1e12
"""Weight of a table that is zero."""
_WEIGHTS = (ZERO_TABLE_WEIGHT, *(10.0**e for e in (6, 5, 4, 3, 2, 1, 0, -1, -2)))
"""Weights that are tried, from flat to free, for values in units of a tenth of the spring's torque."""
_PERIODS = (*(1.25 * 2.0**n for n in range(6)), np.inf)
"""Numbers of periods [1] of each release that are fitted one after another: in the first swings no model is out of step yet."""
_STRETCHES = 6
"""Of one release alone, each predicted from the others."""
_FIRST = _PERIODS[:2]
"""Those in which a law of tilt and rate must show, if it makes more than"""
NOISE_MULTIPLE = 5.0
"""times the noise."""
MIN_GAIN = 6.0
"""Held-out log-likelihood that a learned torque must gain [nats],"""
MIN_ERROR_SHARE = 0.02
"""share of the squared held-out error that it must take away: steps of a sensor are a function of the angle too, and"""
_GAIN = 1.0
"""log-likelihood that a weight one step lower must gain [nats]."""
_ROUNDS, _LAST_ROUNDS = 5, 3
"""In which weights are chosen again, for each stretch of the motion and for the whole."""
MAX_ERROR_RATIO = 1.01
"""Error over that of the joint without tables from which the search for them has lost its way: they can be zero."""
_COLOURED = 1.5
"""Correlation length of what is left [samples] from which an internal state is tried: noise has one."""
_COARSE = 40
"""Steps a period while weights are sought: RK4 then loses 82/n⁴ = 3e-5 rad of phase a period of a linear joint,"""
_SAMPLES = 40
"""Samples a period of which means are fitted meanwhile: a table of twenty knots has no finer ones."""
_STEPS = 120
"""and where a formula is fitted in the tables' place: 4e-7 rad."""


def learn(
    structure: Structure,
    records: Sequence[Record],
    scales: Scales,
    *,
    bias: Bias,
    fixed: Mapping[str, float],
    bounded: Mapping[str, tuple[float, float]],
    priors: Mapping[str, tuple[float, float]],
    steps_per_period: int,
) -> tuple[Problem, Minimum, int]:
    """Fit a structure with learned torques, from the fit of the same joint without them.

    Args:
        priors: Of parameters of that joint.

    Returns:
        The problem with its weights, its minimum, and how many evaluations it all took.
    """
    plain = structure_of([p.name for p in structure.parts if not is_table(p)])
    own = set(plain.parameters)
    step = float(np.median(np.diff(records[0].time)))
    before, found, evaluations = search(
        plain, records, scales, bias=bias, steps_per_period=_COARSE, average=max(1, int(2 * np.pi / scales.frequency / step / _SAMPLES)),
        priors=priors, fixed={n: v for n, v in fixed.items() if n in own}, bounded={n: e for n, e in bounded.items() if n in own},
    )  # fmt: skip
    known = before.parameters(found.point)
    if (
        "rest_angle" in before.names
    ):  # where a lopsided joint rests, not the middle of its swings: the tables are zero there
        known["rest_angle"] = measured_rest(records)
    edges = support_of(before, found, structure, known["rest_angle"])
    problem = before.with_(bounded=dict(bounded), fixed={**before.fixed, **fixed})
    tables = [part for part in structure.torques if part.smoothness]
    remembering = [part.memory for part in tables if part.memory and part.memory not in structure.effects]
    first, reached = with_structure(problem, structure, edges), rms(before.residuals(found.point))
    start = extended(first, known, before, found.point)
    # A search that begins with the first swings may lose its way where the joint without tables was in step already.
    for horizons in (_PERIODS, _PERIODS[-1:], ()):
        problem, found, more = _learned(first, start, horizons)
        evaluations += more
        if rms(problem.residuals(found.point)) < MAX_ERROR_RATIO * reached:
            break
    if (
        remembering
        and not _in_vain(problem, found.normal.cost)
        and correlation_length(problem.residuals(found.point)) > _COLOURED
    ):
        richer, there, more = _remembering(problem, found, (*structure.effects, *remembering))
        evaluations += more
        if richer is not problem and gain(problem, found, richer, there) > MIN_GAIN:
            problem, found = richer, there
    fine = problem.with_(steps_per_period=steps_per_period, average=1)
    minimum = fine.fitted(found.point, 30)
    return fine, minimum, evaluations + minimum.evaluations


def with_structure(
    problem: Problem, structure: Structure, fixed: Mapping[str, float] | None = None
) -> Problem:
    """Return a problem with another structure, its tables flat."""
    return problem.with_(
        structure=structure,
        fixed={**problem.fixed, **(fixed or {})},
        free_states=bool(structure.internal_states) and any(r.release.hold <= 0 for r in problem.records),
        smoothing=tuple(
            ZERO_TABLE_WEIGHT
            for part in structure.torques
            if part.smoothness
            for _ in part.smoothness().tables
        ),
    )


def _learned(
    problem: Problem, point: Array, horizons: Sequence[float] = _PERIODS, known: tuple[Problem, Minimum] | None = None
) -> tuple[Problem, Minimum, int]:  # fmt: skip
    """Fit tables from a point on, first swings first, with weights that are chosen again as the fit comes nearer.

    Where that predicts worse than what is known already, beyond doubt, it has lost its way, and what is known is returned.
    """
    evaluations, cost, period = 0, 0.0, 2 * np.pi / problem.scales.frequency
    horizons = [p for p in horizons if p * period < problem.scales.duration or not np.isfinite(p)]
    for periods in horizons:
        here = problem.with_(records=[first_swings(r, problem.scales, periods) for r in problem.records])
        low, high = here.bounds()
        if "rest_angle" in here.names and np.isfinite(
            periods
        ):  # few swings tell a rest angle from a bend nowhere
            at = here.names.index("rest_angle")
            low[at] = high[at] = point[at]
        seen = {here.smoothing}
        for _ in range(_ROUNDS if np.isfinite(periods) else _LAST_ROUNDS):
            found = minimise(
                here.normal, point, low, high, iterations=15, tolerance=here.unnoticed, abandons=True
            )
            point, cost, evaluations = found.point, found.normal.cost, evaluations + found.evaluations
            if known is not None and gain(*known, here, found) < -MIN_GAIN:
                return *known, evaluations
            weights = chosen_weights(here, point)
            if weights in seen:  # as they are, or they go round in a circle
                break
            seen.add(weights)
            here = here.with_(smoothing=weights)
        problem = problem.with_(smoothing=here.smoothing)
        if periods in _FIRST and _in_vain(here, cost):
            break
    return problem, problem.fitted(point, 10), evaluations


def _in_vain(problem: Problem, cost: float) -> bool:
    """Return whether tables stay flat where there is much to explain: nothing that tilt and rate decide."""
    return set(problem.smoothing) == {ZERO_TABLE_WEIGHT} and 2 * cost > NOISE_MULTIPLE**2 * problem.samples


def fit_instead(
    problem: Problem, point: Array, part: TorqueEffect, start: Mapping[str, float], held: Mapping[str, float]
) -> tuple[Problem, Minimum]:
    """Fit an effect in the place of a problem's tables, first swings first.

    Args:
        problem: With tables.
        point: Its minimum, in units of the unknowns' sizes, shape (p,).
        part: No effect of the catalogue.
        start: Parameters to begin with, in their units.
        held: Parameters of the effect that are held.
    """
    kept = tuple(p.name for p in problem.structure.parts if not is_table(p))
    known = {n: value for n, value in problem.fixed.items() if n.split(".")[0] in (*kept, *LINEAR)}
    structure = Structure(kept, (part,))
    simpler = problem.with_(
        structure=structure, smoothing=(), bounded={}, fixed={**known, **held}, steps_per_period=_STEPS,
        free_states=problem.free_states and bool(structure_of(kept).internal_states),
    )  # fmt: skip
    point = extended(simpler, start, problem, point)
    for periods in (2.5, 6.0):
        short = simpler.with_(records=[first_swings(r, problem.scales, periods) for r in problem.records])
        point = short.fitted(point, 20, 1e-5).point
    return simpler, simpler.fitted(point, 20, 1e-7)


def directions(problem: Problem, minimum: Minimum) -> float:
    """Return how many directions a fit takes out of the data: a table as many as its smoothness leaves it, tr H⁻¹(H - prior)."""
    hessian, shared = minimum.normal.hessian, len(problem.names)
    data = hessian.copy()
    data[:shared, :shared] -= problem.prior
    scale = 1 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    whole = np.outer(scale, scale)
    return float(np.trace(np.linalg.pinv(hessian * whole, hermitian=True) @ (data * whole)))


def _remembering(problem: Problem, found: Minimum, effects: Sequence[str]) -> tuple[Problem, Minimum, int]:
    """Fit the same tables beside an internal state, from where that promises most; where it promises nothing, return what was there."""
    structure = structure_of(effects)
    richer = with_structure(problem, structure)
    known = problem.parameters(found.point)
    starts = [
        extended(richer, {**start, **known}, problem, found.point)
        for start in starting_points(structure, problem.scales)
    ]
    weights = (*problem.smoothing, *richer.smoothing[len(problem.smoothing) :])
    near = [
        (linear, *_chosen(linear, weights)) for linear in (_Linearised(richer, start) for start in starts)
    ]
    linear, chosen, _ = max(near, key=lambda item: item[2])
    before = _Linearised(problem, found.point).missed(problem.smoothing)
    if linear.nats(before / linear.missed(chosen)) < MIN_GAIN:
        return problem, found, len(starts)
    return _learned(richer.with_(smoothing=weights), linear.point, _PERIODS[-1:], (problem, found))


def gain(problem: Problem, found: Minimum, richer: Problem, there: Minimum) -> float:
    """Return by how much a richer problem predicts better what is left out: a difference of log-likelihoods [nats]."""
    one, other = _Linearised(problem, found.point), _Linearised(richer, there.point)
    before, after = one.missed(problem.smoothing), other.missed(richer.smoothing)
    return other.nats(before / after)


def chosen_weights(problem: Problem, point: Array) -> tuple[float, ...]:
    """Return the weight of each table with which motion that is left out is predicted best; all flat if none is clearly better.

    The point is near the problem's minimum, in units of the unknowns' sizes, shape (p,).
    """
    linear = _Linearised(problem, point)
    flat = (ZERO_TABLE_WEIGHT,) * len(problem.smoothing)
    weights, best = _chosen(linear, flat)
    enough = linear.missed(weights) < (1 - MIN_ERROR_SHARE) * linear.missed(flat)
    return weights if enough and best > linear.score(flat) + MIN_GAIN else flat


def _chosen(linear: "_Linearised", weights: tuple[float, ...]) -> tuple[tuple[float, ...], float]:
    """Choose the weights of tables one after another, each as flat as those that predict as well; and the score."""
    best = linear.score(weights)
    for _ in range(3):
        before = weights
        for table in range(len(weights)):
            tried = [(*weights[:table], weight, *weights[table + 1 :]) for weight in _WEIGHTS]
            scores = [best if w == weights else linear.score(w) for w in tried]
            first = next(i for i, score in enumerate(scores) if score >= max(scores) - _GAIN)
            weights, best = tried[first], scores[first]
        if weights == before:
            break
    return weights, best


class _Linearised:
    """The residuals of a problem near a point, as parts that are predicted from one another."""

    def __init__(self, problem: Problem, point: Array) -> None:
        self.problem, self.point, self.shared = problem, point, len(problem.names)
        rows = problem.linearise(point)
        sizes = problem.sizes()
        stds = [record.std / np.sqrt(problem.average) for record in problem.records]
        parts: list[tuple[Array, Array]] = []
        for (residual, jacobian), std, (where, _) in zip(rows, stds, problem.places, strict=True):
            parts.append((residual / std, jacobian * sizes[where] / std))
        self.start = point[: self.shared] - problem.centre
        if len(parts) == 1:  # its start is known to all stretches
            residual, jacobian = parts[0]
            length = max(1, len(residual) // (4 * _STRETCHES))
            fold = np.arange(len(residual)) // length % _STRETCHES
            parts = [(residual[fold == f], jacobian[fold == f]) for f in range(_STRETCHES)]
        else:
            parts = [_without_start(r, j, self.shared) for r, j in parts]
        self.squares = [float(r @ r) for r, _ in parts]
        self.gradients = np.array([j.T @ r for r, j in parts])
        self.hessians = np.array([j.T @ j for _, j in parts])
        self.other_gradients = self.gradients.sum(0) - self.gradients
        self.other_hessians = self.hessians.sum(0) - self.hessians
        self.samples = sum(len(r) for r, _ in parts)
        whole = self.gradients.sum(0)[None], self.hessians.sum(0)[None]
        (step,) = self._steps(*whole, (1.0,) * len(problem.smoothing))
        self.memory = max(correlation_length([r + j @ step for r, j in parts]), 1.0)

    def score(self, weights: tuple[float, ...]) -> float:
        """Return the log-likelihood of each part as the others predict it [nats]."""
        return self.nats(1.0 / self.missed(weights))

    def nats(self, ratio: float) -> float:
        """Return by how much a log-likelihood rises where the squares that are missed fall by a ratio [nats]."""
        return 0.5 * self.samples / self.memory * float(np.log(ratio))

    def missed(self, weights: tuple[float, ...]) -> float:
        """Return the sum of squares that is missed of each part by what the others say [1]; inf where the motion ran away."""
        steps = self._steps(self.other_gradients, self.other_hessians, weights)
        total = 0.0
        for c, g, h, step in zip(self.squares, self.gradients, self.hessians, steps, strict=True):
            total += c + 2 * float(g @ step) + float(step @ h @ step)
        return max(total, 1e-300) if np.isfinite(total) else float("inf")

    def _steps(self, gradients: Array, hessians: Array, weights: tuple[float, ...]) -> Array:
        """Return where minima are, each of some parts and the prior, from the point, shape (n, p); of shapes (n, p) and (n, p, p)."""
        prior, shared = self.problem.prior_of(weights), self.shared
        pulls, matrices = gradients.copy(), hessians.copy()
        pulls[:, :shared] += prior @ self.start
        matrices[:, :shared, :shared] += prior
        diagonals = np.einsum("nii->ni", matrices)
        scales = 1 / np.sqrt(np.maximum(diagonals, 1e-12 * diagonals.max(axis=1, keepdims=True)))
        matrices *= scales[:, :, None] * scales[:, None, :]
        diagonals += 1e-12
        return -scales * np.linalg.solve(matrices, (scales * pulls)[:, :, None])[:, :, 0]


def _without_start(residual: Array, jacobian: Array, shared: int) -> tuple[Array, Array]:
    """Take out of a release what its own start could explain."""
    basis, _ = np.linalg.qr(jacobian[:, shared:])
    inner = jacobian[:, :shared]
    return residual - basis @ (basis.T @ residual), inner - basis @ (basis.T @ inner)


def is_table(part: Effect) -> bool:
    """Return whether an effect is a table that is learned."""
    return isinstance(part, TorqueEffect) and part.smoothness is not None


def support_of(
    problem: Problem, minimum: Minimum, structure: Structure, rest_angle: float
) -> dict[str, float]:
    """Return where tables have data, counted from the rest angle: parameters by the structure's names [rad or rad/s]."""
    law = JointLaw.from_vector(problem.structure, problem.vector_of(problem.parameters(minimum.point)))
    ends: list[tuple[float, ...]] = []
    for record, start in zip(problem.records, problem.starts(minimum.point), strict=True):
        path = simulate(law.of_joint(), np.r_[0.0, record.time], *start)
        tilt = (record.release.roll if not record.is_rate else path.roll) - rest_angle
        ends.append((float(tilt.min()), float(tilt.max()), float(path.rate.min()), float(path.rate.max())))
    low, high = np.min(ends, axis=0), np.max(ends, axis=0)
    found = (low[0], high[1], low[2], high[3])
    return {
        f"{part.name}.{name}": float(value)
        for part in structure.torques
        for name, value in zip(part.support, found, strict=False)
    }


def extended(problem: Problem, known: Mapping[str, float], before: Problem, point: Array) -> Array:
    """Return the unknowns of a problem with tables, in units of their sizes, shape (q,): parameters that are not known zero.

    Starts are as another problem had them at its point, likewise, shape (p,).
    """
    start = problem.start({**dict.fromkeys(problem.names, 0.0), **known})
    for index in range(len(problem.records)):
        here = len(problem.names) + index * problem.n_local
        there = len(before.names) + index * before.n_local
        start[here : here + 2] = point[there : there + 2]
        if problem.bias == "per-release":
            start[here + problem.n_local - 1] = point[there + before.n_local - 1]
    return start
