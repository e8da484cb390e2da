"""Fit the tilt joint to measured releases: nonlinear least squares with CasADi.

A free decay fixes only k/I, d/I and τ/I. The roll inertia is taken from the board, and its uncertainty
goes into every torque. Residuals of a real log are correlated; the intervals account for that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.board import Board
from sysid.effects import effect
from sysid.errors import HuskyError
from sysid.fitting.covariance import doubts, parameter_quantities, total_covariance
from sysid.fitting.cross_validation import held_out, pooled
from sysid.fitting.pendulum import hanging, hanging_start
from sysid.fitting.problem import Bias, Problem, Record, make_records
from sysid.fitting.search import scales_of, search
from sysid.joint import JointLaw
from sysid.joint.equations import structure_of
from sysid.least_squares import Minimum, minimise
from sysid.noise.floor import NoiseFloor, noise_floor
from sysid.quantity import Quantity
from sysid.roll import Array, Release


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
    def kinked(self) -> bool:
        """Whether the cost has kinks, which an interval from the Jacobian does not see."""
        structure = self.law.structure
        return structure.turns or structure.kinked

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
    records = make_records(releases, noise.std, rate=options.use_rate, settled=True)
    scales = scales_of(records, board)
    fixed = dict(options.fixed)
    zero = options.bias == "shared" and not options.use_rate
    if fixed.get("stiffness") == 0:
        if "gravity" not in effects:
            raise HuskyError(
                "stiffness=0 leaves nothing that pulls back. Add --effect gravity, or free the stiffness."
            )
        effects, fixed = hanging(effects, fixed, zero=zero)
    structure = structure_of(effects)
    if any(effect(name).role == "shift" or name == "sensor-bias" for name in effects):
        fixed.setdefault("rest_angle", board.rest_angle)
    if options.use_rate or options.bias == "own":
        fixed.setdefault("rest_angle", board.rest_angle)
    fine = options.steps_per_period * (3 if structure.kinked else 1)
    problem, minimum, evaluations = search(
        structure, records, scales, bias=options.bias, fixed=fixed, steps_per_period=fine
    )
    problem, minimum, more = _plainest(problem, minimum)
    evaluations += more
    if "gravity" in effects and "stiffness" in problem.names:
        problem, minimum = _without_spring(problem, minimum, zero=zero)
    if "damping" in problem.names and problem.parameters(minimum.point)["damping"] < 0:
        problem, minimum = _without_damper(problem, minimum)
    if options.robust:
        problem, minimum = _robust(problem, minimum)
    if not np.isfinite(minimum.normal.cost):
        raise HuskyError("the fit found no parameters with a bounded motion. Check the unit of the log.")
    return summarise(problem, minimum, board, noise, evaluations)


def heldout_rmse(fit: JointFit) -> float:
    """Return the error on releases that were left out, one after another [rad or rad/s].

    With one release it is that of each third of it, predicted from the others.
    """
    return pooled(held_out(fit.problem, fit.minimum))


def _plainest(problem: Problem, minimum: Minimum) -> tuple[Problem, Minimum, int]:
    """Leave parameters that an effect can do without at their default where the data do not ask for more.

    A stop may brake, but one that need not is told by two numbers, and MuJoCo can hold it. The price of a
    parameter is BIC's.
    """
    evaluations = 0
    for part in problem.structure.parts:
        for parameter in part.parameters:
            name = f"{part.name}.{parameter.name}"
            if parameter.default is None or name not in problem.names:
                continue
            simpler = Problem(
                problem.structure, problem.records, problem.scales, bias=problem.bias,
                fixed={**problem.fixed, name: parameter.default}, free_states=problem.free_states,
                steps_per_period=problem.steps_per_period,
            )  # fmt: skip
            start = np.delete(minimum.point, problem.names.index(name))
            without = minimise(simpler.normal, start, *simpler.bounds())
            evaluations += without.evaluations
            noise = 2 * minimum.normal.cost / max(1, problem.samples - len(minimum.point))
            if 2 * (without.normal.cost - minimum.normal.cost) < np.log(problem.samples) * max(noise, 1.0):
                problem, minimum = simpler, without
    return problem, minimum, evaluations


def _without_spring(problem: Problem, minimum: Minimum, *, zero: bool) -> tuple[Problem, Minimum]:
    """Let gravity take the spring's place where the spring is not needed, or came out pushing."""
    effects, fixed = hanging(problem.structure.effects, problem.fixed, zero=zero)
    hung = replace(problem, structure=structure_of(effects), fixed=fixed)
    found = problem.parameters(minimum.point)
    start = hung.start(hanging_start(found))
    _copy_motion(problem, minimum, hung, start)
    without = minimise(hung.normal, start, *hung.bounds())
    noise = max(2 * minimum.normal.cost / max(1, problem.samples - len(minimum.point)), 1.0)
    needed = 2 * (without.normal.cost - minimum.normal.cost) > np.log(problem.samples) * noise
    return (problem, minimum) if needed and found["stiffness"] > 0 else (hung, without)


def _without_damper(problem: Problem, minimum: Minimum) -> tuple[Problem, Minimum]:
    """Hold the damper at zero where it came out driving: other effects take all of the loss."""
    plain = replace(problem, fixed={**problem.fixed, "damping": 0.0})
    start = np.delete(minimum.point, problem.names.index("damping"))
    return plain, minimise(plain.normal, start, *plain.bounds())


def _copy_motion(problem: Problem, minimum: Minimum, other: Problem, start: Array) -> None:
    """Copy each release's own unknowns from one problem's minimum into the start of another, in place."""
    start[len(other.names) :] = minimum.point[len(problem.names) :]


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
        warnings=tuple(doubts(problem, minimum, quantities, covariance)),
        problem=problem,
        minimum=minimum,
    )  # fmt: skip


def strength(problem: Problem, minimum: Minimum, effects: Sequence[str]) -> dict[str, float]:
    """Return the peak torque of effects over the peak torque of the joint, along the fitted motion."""
    from sysid.joint.torques import torque_shares

    law = JointLaw.from_vector(problem.structure, problem.vector_of(problem.parameters(minimum.point)))
    own, shared = problem.own, len(problem.names)
    begins = (minimum.point * problem.sizes())[shared:]
    starts = [(begins[i * own], begins[i * own + 1]) for i in range(len(problem.records))]
    times = [record.time for record in problem.records]
    return torque_shares(law, times, starts, effects)
