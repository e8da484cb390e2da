"""Fit the tilt joint to measured releases: nonlinear least squares with CasADi.

A free decay fixes only k/I, d/I and τ/I. The roll inertia is taken from the board, and its uncertainty
goes into every torque. Residuals of a real log are correlated; the intervals account for that.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.board import Board
from sysid.effects import effect
from sysid.effects.base import Scales
from sysid.errors import HuskyError
from sysid.fit_problem import Bias, Problem, Record, make_records
from sysid.joint import JointLaw
from sysid.joint_flow import Structure, structure_of
from sysid.least_squares import Minimum, minimise
from sysid.noise import NoiseFloor, autocorrelation, noise_floor
from sysid.quantity import Quantity
from sysid.roll import Array, Release

UNITS = {"stiffness": "N*m/rad", "damping": "N*m*s/rad", "rest_angle": "rad"}
_KINKED = ("end-stop", "freeplay", "hysteresis")


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions:
    """How a fit is done."""

    bias: Bias = "shared"
    """One sensor zero for all releases, or one each (for integrated gyros)."""
    robust: bool = False
    """Huber's loss, against outliers of the sensor."""
    use_rate: bool = False
    """Fit the measured rate instead of the roll."""
    fixed: Mapping[str, float] = field(default_factory=dict[str, float])
    """Parameters held at a value, by 'stiffness', 'damping', 'rest_angle' or 'effect.parameter'."""
    steps_per_period: int = 60
    """Of the integrator, in the final fit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFit:
    """A fitted joint, with what is known of its uncertainty."""

    law: JointLaw
    quantities: Mapping[str, Quantity]
    """'stiffness', 'damping', 'rest_angle' and 'effect.parameter', with the inertia's uncertainty in them."""
    covariance: Array
    """Of `quantities`, in their order, shape (q, q)."""
    rmse: float
    """Root mean square residual over all samples [rad; rad/s if the rate was fitted]."""
    noise: NoiseFloor
    records: tuple[Record, ...]
    starts: tuple[tuple[float, float], ...]
    """Roll [rad] and rate [rad/s] at each release."""
    residuals: tuple[Array, ...]
    """Model minus measurement of each record."""
    evaluations: int
    warnings: tuple[str, ...] = ()
    problem: Problem = field(repr=False)
    minimum: Minimum = field(repr=False)

    @property
    def correlation(self) -> Array:
        """Correlation of the quantities, shape (q, q)."""
        deviation = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        return self.covariance / np.outer(deviation, deviation)

    @property
    def status(self) -> str:
        """How the search ended, in words."""
        return f"{self.minimum.status} after {self.evaluations} evaluations"

    @property
    def measured_rms(self) -> float:
        """RMS of the measured signal about rest, of all records together."""
        total, count = 0.0, 0
        for record in self.records:
            rest = 0.0 if record.is_rate else self.law.rest_angle
            total += float(np.sum((record.signal - rest) ** 2))
            count += len(record.signal)
        return float(np.sqrt(total / count))

    @property
    def nrmse(self) -> float:
        """RMSE over the RMS of the measurement about rest."""
        return self.rmse / self.measured_rms


def check_effects(names: Sequence[str]) -> None:
    """Accept effects that a free decay can say something about.

    Raises:
        HuskyError: Unknown, or not identifiable from free decays; the message says why.
    """
    for name in names:
        part = effect(name)
        if part.role == "record" or name == "clock":
            raise HuskyError(
                f"'{name}' cannot be fitted to a free decay: only k/I, d/I and torque/I show in it, so another "
                f"stiffness and damping do the same. {part.experiment}"
            )
    shifts = [n for n in names if n in ("offset", "preload", "sensor-bias")]
    if len(shifts) > 1:
        raise HuskyError(
            f"{' and '.join(shifts)} cannot be told apart in a free decay: all of them move it by a constant. "
            "Fit one of them."
        )


def fit_joint(
    releases: Sequence[Release],
    board: Board,
    effects: Sequence[str] = (),
    options: FitOptions | None = None,
) -> JointFit:
    """Fit stiffness, damping, rest angle and the parameters of some effects to releases.

    Args:
        releases: Free decays of one board.
        board: Gives the roll inertia, and a start.
        effects: Names of the catalogue.
        options: How.

    Raises:
        HuskyError: Nothing to fit, an effect that free decays cannot identify, or no convergence.
    """
    options = options or FitOptions()
    check_effects(effects)
    if not releases:
        raise HuskyError("no release to fit. Let the deck go and record until it rests.")
    noise = noise_floor(releases, rate=options.use_rate)
    records = make_records(releases, noise.std, rate=options.use_rate)
    scales = scales_of(records, board)
    structure = structure_of(effects)
    fixed = dict(options.fixed)
    if any(effect(name).role == "shift" or name == "sensor-bias" for name in effects):
        fixed.setdefault("rest_angle", board.rest_angle)
    if options.use_rate or options.bias == "own":
        fixed.setdefault("rest_angle", board.rest_angle)
    fine = options.steps_per_period * (3 if any(name in _KINKED for name in effects) else 1)
    problem, minimum, evaluations = search(
        structure, records, scales, bias=options.bias, fixed=fixed, steps_per_period=fine
    )
    if options.robust:
        problem, minimum = _robust(problem, minimum)
    if not np.isfinite(minimum.normal.cost):
        raise HuskyError("the fit found no parameters with a bounded motion. Check the unit of the log.")
    return summarise(problem, minimum, board, noise, evaluations)


def fit_to_others(
    board: Board, records: Sequence[Record], *, bias: Bias = "shared", law: JointLaw | None = None
) -> list[Array]:
    """Return the residuals of a law that is given, with only roll and rate at each release fitted.

    Args:
        board: Its law is taken, unless `law` is given.
        records: Releases.
        bias: With 'own', the sensor zero of each release is fitted too.
        law: The joint.

    Returns:
        Model minus measurement of each record [rad or rad/s].
    """
    return own_motion(law or JointLaw.from_board(board), records, bias=bias)[0]


def own_motion(
    law: JointLaw, records: Sequence[Record], *, bias: Bias = "shared", steps_per_period: int = 120
) -> tuple[list[Array], list[tuple[float, float]]]:
    """Fit roll and rate at each release to a given law.

    Returns:
        Residuals of each record, and (roll [rad], rate [rad/s]) at each release.
    """
    structure = law.structure
    amplitude = max(max(float(np.ptp(r.release.roll)) for r in records) / 1.6, 1e-4)
    scales = Scales(
        inertia=law.inertia, stiffness=max(law.frequency**2 * law.inertia, 1e-9), damping=max(law.damping, 0.0),
        amplitude=amplitude, duration=max(float(r.time[-1]) for r in records),
    )  # fmt: skip
    parameters = dict(zip(structure.parameters, map(float, law.vector), strict=True))
    del parameters["inertia"]
    free_states = bool(structure.memories) and any(r.release.hold <= 0 for r in records)
    residuals: list[Array] = []
    starts: list[tuple[float, float]] = []
    for record in records:
        problem = Problem(
            structure, [record], scales, bias=bias, fixed=parameters, free_states=free_states,
            steps_per_period=steps_per_period,
        )  # fmt: skip
        found = minimise(problem.normal, problem.start(parameters), *problem.bounds(), iterations=30)
        if not np.isfinite(found.normal.cost):
            raise HuskyError(
                "the record's law moves without bound from the measured release. Refit it (husky-sysid fit)."
            )
        residuals += problem.residuals(found.point)
        own = found.point * problem.sizes()
        starts.append((float(own[0]), float(own[1])))
    return residuals, starts


def heldout_rmse(fit: JointFit) -> float:
    """Return the error on releases that were left out, one after another [rad or rad/s].

    With one release it is the second half of its motion, predicted from the first.
    """
    from sysid.model_search import Model, Searcher

    searcher = Searcher(records=fit.records, scales=fit.problem.scales, bias=fit.problem.bias)
    model = Model(effects=fit.problem.structure.effects, problem=fit.problem, minimum=fit.minimum)
    return searcher.predicted(model).heldout_rmse


def scales_of(records: Sequence[Record], board: Board) -> Scales:
    """Return the sizes of the problem from a linear fit, started from the data and from the board."""
    amplitude = max(float(np.ptp(r.release.roll)) for r in records)
    amplitude = max(amplitude / 1.6, 1e-4)
    duration = max(float(r.time[-1]) for r in records)
    inertia = board.inertia.value
    guesses = [(board.stiffness / inertia, board.damping / inertia)]
    guesses += [guess for record in records if (guess := linear_guess(record)) is not None]
    best: tuple[float, Scales] | None = None
    for square, decay in guesses:
        rough = Scales(
            inertia=inertia, stiffness=inertia * square, damping=inertia * decay,
            amplitude=amplitude, duration=duration,
        )  # fmt: skip
        problem = Problem(Structure(), records, rough, steps_per_period=30)
        start = problem.start(
            {"stiffness": rough.stiffness, "damping": rough.damping, "rest_angle": _rest(records)}
        )
        minimum = minimise(problem.normal, start, *problem.bounds(), iterations=25)
        found = problem.parameters(minimum.point)
        if found["stiffness"] <= 0:
            continue
        if best is None or minimum.normal.cost < best[0]:
            scale = replace(rough, stiffness=found["stiffness"], damping=found["damping"])
            best = minimum.normal.cost, scale
    if best is None:
        raise HuskyError(
            "the releases do not swing about a rest angle, so no stiffness can be found. "
            "Check the column and the sign of the roll."
        )
    return best[1]


def _rest(records: Sequence[Record]) -> float:
    return 0.0 if records[0].is_rate else float(np.median([r.release.rest for r in records]))


def linear_guess(record: Record) -> tuple[float, float] | None:
    """Return (k/I, d/I) of a release by regression on its running integrals, or None if it makes no sense.

    φ(t) = φ₀ + v₀ t + (k/I) x₀ t²/2 - (k/I) ∬φ - (d/I) (∫φ - φ₀ t): linear in its unknowns, and integrals are
    kind to noise. A start only: noise in the regressors biases it a little.
    """
    t, y = record.time, record.signal
    step = np.diff(t, prepend=t[0])
    once = np.cumsum(step * y)
    twice = np.cumsum(step * once)
    if record.is_rate:
        # The same equation, differentiated once.
        table = np.column_stack([np.ones_like(t), t, once, twice])
    else:
        table = np.column_stack([np.ones_like(t), t, t**2, once, twice])
    scale = np.maximum(np.abs(table).max(axis=0), 1e-300)
    solution = np.linalg.lstsq(table / scale, y, rcond=None)[0] / scale
    decay, square = -float(solution[-2]), -float(solution[-1])
    return (square, max(decay, 0.0)) if square > 0 else None


def starting_points(structure: Structure, scales: Scales, *, most: int = 12) -> list[dict[str, float]]:
    """Return the starts from which a structure is searched: all combinations of its parameters' starts."""
    linear = {"stiffness": scales.stiffness, "damping": max(scales.damping, 0.0), "rest_angle": 0.0}
    lists: list[list[tuple[str, float]]] = []
    for part in structure.parts:
        for p in part.parameters:
            lists.append([(f"{part.name}.{p.name}", s * p.size(scales)) for s in p.starts])
    points: list[dict[str, float]] = []
    for choice in itertools.islice(itertools.product(*lists), most):
        point = {**linear, **dict(choice)}
        # What others add to the stiffness or take from it, the spring makes up for.
        if "second-mode.stiffness" in point:
            point["stiffness"] *= 1.0 / (1.0 - linear["stiffness"] / point["second-mode.stiffness"])
        point["stiffness"] -= min(point.get("gravity.moment", 0.0), 0.98 * linear["stiffness"])
        if "coulomb.torque" in point or "stribeck.torque" in point:
            point["damping"] *= 0.6
        points.append(point)
    return points


def search(
    structure: Structure,
    records: Sequence[Record],
    scales: Scales,
    *,
    bias: Bias = "shared",
    fixed: Mapping[str, float] | None = None,
    steps_per_period: int = 60,
    starts: Sequence[Mapping[str, float]] | None = None,
    average: int = 1,
) -> tuple[Problem, Minimum, int]:
    """Find the best parameters of a structure: many short searches on a coarse grid, the best one finely.

    Friction makes the cost rough, because it decides in which half swing the deck stops. So the search
    begins with the first swings only, and the rest follows when the parameters are nearly right.
    Internal states at release follow from the hold before it, or are free where the log does not show it.

    Returns:
        The fine problem, its minimum, and how many evaluations it all took.
    """
    fixed = dict(fixed or {})
    rest = _rest(records)
    free_states = bool(structure.memories) and any(record.release.hold <= 0 for record in records)
    starts = starting_points(structure, scales) if starts is None else starts
    coarse_steps = min(24, steps_per_period)
    coarse = Problem(
        structure, records, scales, bias=bias, fixed=fixed, free_states=free_states,
        steps_per_period=coarse_steps, average=average,
    )  # fmt: skip
    horizons = [1.25, 4.0] if structure.effects else []
    early = [
        replace_records(coarse, [_first_swings(record, scales, periods) for record in records])
        for periods in horizons
    ]
    evaluations = 0
    found: list[tuple[float, Array]] = []
    for start in starts:
        point = coarse.start({**start, "rest_angle": start.get("rest_angle") or rest})
        for problem in early:
            first = minimise(problem.normal, point, *problem.bounds(), iterations=12, tolerance=1e-4)
            evaluations += first.evaluations
            point = first.point
        second = minimise(coarse.normal, point, *coarse.bounds(), iterations=15, tolerance=1e-5)
        evaluations += second.evaluations
        found.append((second.normal.cost, second.point))
    found.sort(key=lambda item: item[0])
    shaken = _shaken(coarse, found[0])
    found.insert(0, shaken)
    fine = Problem(
        structure, records, scales, bias=bias, fixed=fixed, free_states=free_states,
        steps_per_period=steps_per_period,
    )  # fmt: skip
    best: Minimum | None = None
    for cost, point in found[:2]:
        if best is not None and cost > 1.2 * found[0][0]:
            break
        minimum = minimise(fine.normal, point, *fine.bounds(), iterations=60)
        evaluations += minimum.evaluations
        if best is None or minimum.normal.cost < best.normal.cost:
            best = minimum
    assert best is not None
    return fine, best, evaluations


_FRICTION = ("coulomb.torque", "stribeck.torque", "hysteresis.torque")
_SHAKES = (0.6, 0.75, 0.87, 1.15, 1.35, 1.65)


def _shaken(problem: Problem, found: tuple[float, Array]) -> tuple[float, Array]:
    """Walk along the friction out of a false valley: hold it elsewhere, let the rest follow, then free it.

    The cost is rough along the friction, because it decides in which half swing each release stops; a
    descent gets caught, a walk that re-fits everything else does not. At the noise there is nothing to gain.
    """
    names = [problem.names.index(name) for name in _FRICTION if name in problem.names]
    low, high = problem.bounds()
    for index in names:
        for _ in range(4):
            if found[0] < 0.55 * problem.samples:
                return found
            best = found
            for factor in _SHAKES:
                pinned_low, pinned_high = low.copy(), high.copy()
                value = np.clip(found[1][index] * factor, low[index], high[index])
                pinned_low[index] = pinned_high[index] = value
                held = minimise(
                    problem.normal, found[1], pinned_low, pinned_high, iterations=8, tolerance=1e-3
                )
                if held.normal.cost < found[0]:
                    freed = minimise(problem.normal, held.point, low, high, iterations=12, tolerance=1e-4)
                    best = min(best, (freed.normal.cost, freed.point), key=lambda item: item[0])
            if best[0] > 0.98 * found[0]:
                break
            found = best
    return found


def replace_records(problem: Problem, records: Sequence[Record]) -> Problem:
    """Return the same problem on other records."""
    return Problem(
        problem.structure, records, problem.scales, bias=problem.bias, fixed=problem.fixed,
        free_states=problem.free_states, steps_per_period=problem.steps_per_period, average=problem.average,
    )  # fmt: skip


def _first_swings(record: Record, scales: Scales, periods: float) -> Record:
    end = int(np.searchsorted(record.time, periods * 2 * np.pi / scales.frequency))
    end = max(end, min(30, len(record.time)))
    return replace(record, time=record.time[:end], signal=record.signal[:end])


def _robust(problem: Problem, minimum: Minimum) -> tuple[Problem, Minimum]:
    """Refit with Huber's weights (1.345 standard deviations), iterated to a standstill."""
    for _ in range(8):
        residuals = problem.residuals(minimum.point)
        spread = 1.4826 * float(np.median(np.abs(np.concatenate(residuals))))
        weights = [np.minimum(1.0, 1.345 * spread / np.maximum(np.abs(r), 1e-300)) for r in residuals]
        problem.weights = weights
        following = minimise(problem.normal, minimum.point, *problem.bounds())
        done = float(np.max(np.abs(following.point - minimum.point))) < 1e-6
        minimum = following
        if done:
            break
    return problem, minimum


def summarise(
    problem: Problem, minimum: Minimum, board: Board, noise: NoiseFloor, evaluations: int
) -> JointFit:
    """Turn a minimum into quantities with uncertainty."""
    names = problem.names
    residuals = problem.residuals(minimum.point)
    parameters = problem.parameters(minimum.point)
    covariance = total_covariance(problem, minimum, board)
    quantities = parameter_quantities(problem, minimum, board, covariance)
    own = problem.own
    begins = minimum.point[len(names) :] * problem.sizes()[len(names) :]
    vector = problem.vector_of(parameters)
    squares = sum(float(r @ r) for r in residuals)
    return JointFit(
        law=JointLaw.from_vector(problem.structure, vector),
        quantities=quantities,
        covariance=covariance,
        rmse=float(np.sqrt(squares / problem.samples)),
        noise=noise,
        records=tuple(problem.records),
        starts=tuple((float(begins[i * own]), float(begins[i * own + 1])) for i in range(len(problem.records))),
        residuals=tuple(residuals),
        evaluations=evaluations,
        warnings=tuple(_warnings(problem, minimum, quantities, covariance)),
        problem=problem,
        minimum=minimum,
    )  # fmt: skip


def total_covariance(problem: Problem, minimum: Minimum, board: Board) -> Array:
    """Return the covariance of the free parameters with the inertia's uncertainty in it, shape (free, free)."""
    units = {**UNITS, **_effect_units(problem.structure)}
    parameters = problem.parameters(minimum.point)
    by_inertia = np.array(
        [
            parameters[n] / board.inertia.value if units[n][:3] in ("N*m", "kg*") else 0.0
            for n in problem.names
        ]
    )
    own = parameter_covariance(problem, minimum, problem.residuals(minimum.point))
    return own + np.outer(by_inertia, by_inertia) * board.inertia.std**2


def parameter_quantities(
    problem: Problem,
    minimum: Minimum,
    board: Board,
    covariance: Array | None = None,
    *,
    certain: bool = True,
) -> dict[str, Quantity]:
    """Return the free parameters as quantities; `certain=False` leaves the deviations unknown and is quick."""
    units = {**UNITS, **_effect_units(problem.structure)}
    parameters = problem.parameters(minimum.point)
    if certain and covariance is None:
        covariance = total_covariance(problem, minimum, board)
    deviation = (
        np.full(len(problem.names), np.nan)
        if covariance is None
        else np.sqrt(np.maximum(np.diag(covariance), 0))
    )
    return {
        name: Quantity(parameters[name], float(std), units[name], "least squares of the decay")
        for name, std in zip(problem.names, deviation, strict=True)
    }


def strength(problem: Problem, minimum: Minimum, effects: Sequence[str]) -> dict[str, float]:
    """Return the peak torque of effects over the peak torque of the joint, along the fitted motion."""
    from sysid.joint_torque import torque_shares

    law = JointLaw.from_vector(problem.structure, problem.vector_of(problem.parameters(minimum.point)))
    own, shared = problem.own, len(problem.names)
    begins = (minimum.point * problem.sizes())[shared:]
    starts = [(begins[i * own], begins[i * own + 1]) for i in range(len(problem.records))]
    times = [record.time for record in problem.records]
    return torque_shares(law, times, starts, effects)


def fit_each(problem: Problem, minimum: Minimum) -> list[tuple[float, float]]:
    """Fit each record alone and return its stiffness and its sum of squared residuals in units of the noise."""
    shared, own = len(problem.names), problem.own
    rows: list[tuple[float, float]] = []
    for index, record in enumerate(problem.records):
        alone = replace_records(problem, [record])
        start = np.r_[
            minimum.point[:shared], minimum.point[shared + index * own : shared + (index + 1) * own]
        ]
        found = minimise(alone.normal, start, *alone.bounds(), iterations=25)
        rows.append((alone.parameters(found.point)["stiffness"], 2 * found.normal.cost))
    return rows


def _effect_units(structure: Structure) -> dict[str, str]:
    return {f"{part.name}.{p.name}": p.unit for part in structure.parts for p in part.parameters}


def parameter_covariance(problem: Problem, minimum: Minimum, residuals: Sequence[Array]) -> Array:
    """Return the covariance of the free parameters, with residuals that may be correlated.

    The sandwich H⁻¹ (Jᵀ R J) H⁻¹, where R is the covariance of the residuals as their own autocorrelation
    shows it up to the first lag that is within its noise; for white residuals R = σ² 1.

    Returns:
        Covariance, shape (free, free), in the parameters' units.
    """
    shared, own, sizes = len(problem.names), problem.own, problem.sizes()
    n = problem.samples
    dof = max(1, n - len(sizes))
    variance = sum(float(r @ r) for r in residuals) / dof
    rho = autocorrelation(residuals, min(400, max(len(r) for r in residuals) // 4))
    small = np.flatnonzero(np.abs(rho[1:]) < 2.5 / np.sqrt(n))
    lags = int(small[0]) if len(small) else len(rho) - 1
    meat = np.zeros((len(sizes), len(sizes)))
    bread = np.zeros_like(meat)
    for index, (_, jacobian) in enumerate(problem.linearise(minimum.point)):
        where = np.r_[0:shared, shared + index * own : shared + (index + 1) * own]
        j = jacobian * sizes[where]
        square = j.T @ j
        bread[np.ix_(where, where)] += square
        middle = square.copy()
        for lag in range(1, lags + 1):
            cross = j[:-lag].T @ j[lag:]
            middle += rho[lag] * (1 - lag / (lags + 1)) * (cross + cross.T)
        meat[np.ix_(where, where)] += middle
    free = ~minimum.at_bound
    inverse = np.zeros_like(bread)
    inverse[np.ix_(free, free)] = _inverse(bread[np.ix_(free, free)])
    covariance = variance * inverse @ meat @ inverse
    return covariance[:shared, :shared] * np.outer(sizes[:shared], sizes[:shared])


def _inverse(matrix: Array) -> Array:
    diagonal = np.diag(matrix)
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-24 * max(float(diagonal.max(initial=0.0)), 1e-200)))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    # A direction that the data leave open keeps a huge variance instead of none.
    floored = np.maximum(values, 1e-13 * max(float(values[-1]), 1e-300))
    return (vectors / floored) @ vectors.T * np.outer(scale, scale)


def _warnings(
    problem: Problem, minimum: Minimum, quantities: Mapping[str, Quantity], covariance: Array
) -> list[str]:
    """Say what the data do not fix."""
    lines: list[str] = []
    for name, bound in zip(problem.names, minimum.at_bound, strict=False):
        if bound:
            lines.append(f"{name} = {quantities[name].value:.4g} {quantities[name].unit} is at its bound")
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(deviation, deviation)
    names = list(problem.names)
    for i, j in itertools.combinations(range(len(names)), 2):
        if abs(correlation[i, j]) > 0.995:
            lines.append(
                f"{names[i]} and {names[j]} cannot be told apart by these releases (correlation "
                f"{correlation[i, j]:+.4f}): only their combination is fixed"
            )
    for name, quantity in quantities.items():
        if name in ("stiffness", "damping", "rest_angle") or not np.isfinite(quantity.std):
            continue
        if quantity.std > abs(quantity.value) and quantity.value != 0:
            lines.append(f"{name} is not different from zero within its uncertainty ({quantity})")
    return lines
