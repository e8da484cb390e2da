"""Fit one joint to releases: the search, then removal of parameters that the data do not need, then outliers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.board import Board
from sysid.effects import catalogue, drives, effect
from sysid.effects._base import Scales, TorqueEffect
from sysid.errors import SysidError, did_you_mean
from sysid.fitting.problem import Problem, starts_unknown
from sysid.fitting.records import Bias, Record, make_records
from sysid.fitting.result import JointFit, summarise
from sysid.fitting.search import lengthened, scales_of, search, starting_points
from sysid.joint.structure import Structure, structure_of
from sysid.least_squares import Minimum
from sysid.noise.floor import NoiseFloor, noise_floor
from sysid.noise.whiteness import correlation_length
from sysid.quantity import Z95
from sysid.roll import Array, Release


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOptions:
    """Options of a fit."""

    bias: Bias = "shared"
    """One sensor zero for all releases, or one each (for integrated gyros)."""
    use_rate: bool = False
    """Fit the measured rate instead of the roll."""
    fixed: Mapping[str, float] = field(default_factory=dict[str, float])
    """Parameters held at a value, by 'stiffness', 'damping', 'rest_angle' or 'effect.parameter'."""
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    """Lowest and highest value of parameters, by the same names, in their units."""
    priors: tuple[str, ...] = ()
    """Parameters of which the record's value and standard deviation count as a measurement, by the same names."""
    bounds_friction: bool = True
    """Whether a friction without an upper limit in the data gets a least value, which takes a search of its own."""
    steps_per_period: int = 60
    """Of the integrator, in the final fit: RK4 then loses 82/n⁴ = 6e-6 rad of phase a period of a linear joint."""


def check_effects(names: Sequence[str], known: Sequence[str] = ()) -> None:
    """Accept effects that a free decay can say something about beside those that the record has.

    Raises:
        SysidError: Unknown, or not identifiable from free decays; the message says why.
    """
    for name in names:
        if name not in catalogue() and name in drives():
            alike = "".join(
                f" A passive joint has '{n}'." for n, p in catalogue().items() if name in p.also_called
            )
            raise SysidError(
                f"'{name}' acts between a motor and its joint, so a free decay cannot show it.{alike} Give --input for a driven log."
            )
        part = effect(name)
        beside = {*names, *known} & set(part.identifiable_with)
        if not (part.identifiable_from_decay or beside or name in known):
            raise SysidError(
                f"'{name}' cannot be fitted to a free decay: only k/I, d/I and torque/I show in it, so another "
                f"stiffness and damping do the same. {part.experiment_on()}"
            )
        alike = [other for other in names if other == name or other in part.same_as]
        if len(alike) > 1:
            raise SysidError(
                f"{' and '.join(alike)} cannot be told apart in a free decay: all of them move it by a constant. "
                "Fit one of them."
            )


def check_parameters(names: Sequence[str], options: FitOptions, board: Board) -> None:
    """Accept held and bounded parameters of a joint with some effects.

    Raises:
        SysidError: A parameter that the joint does not have, bounds without room, or nothing left that pulls back.
    """
    structure = structure_of(names)
    known = structure.parameters[1:]
    for name in (*options.fixed, *options.bounds):
        if name not in known:
            raise SysidError(
                f"the joint has no parameter '{name}'.{did_you_mean(name, known)} It has {', '.join(known)}."
            )
    for name, (low, high) in options.bounds.items():
        if not low < high:
            raise SysidError(f"the bounds of {name} are {low:g} to {high:g}; expected the lower one first.")
        if name in options.fixed:
            raise SysidError(f"{name} is held and bounded at once; give one of both.")
    if options.fixed.get("stiffness", 1.0) <= 0 and not pulls_back(structure, board):
        pulling = [
            name
            for name, part in catalogue().items()
            if isinstance(part, TorqueEffect) and part.adds_stiffness
        ]
        raise SysidError(
            "stiffness is held at 0 and nothing else pulls the deck back. Add the effect that does "
            f"(--effect {' or '.join(pulling)})."
        )


def pulls_back(structure: Structure, board: Board) -> bool:
    """Whether something else than a spring may, or, where that is known, does pull the joint to its rest."""
    values = record_values(board)
    slopes = (
        part.slope(part.of(values), board.rest_angle) for part in structure.torques if part.slope is not None
    )
    return any(part.adds_stiffness for part in structure.torques) or sum(slopes) > 0


def record_values(board: Board) -> dict[str, float]:
    """Return the parameters of the record's effects by 'effect.parameter'."""
    return {name: quantity.value for name, quantity in board.quantities.items() if "." in name}


def held_parameters(structure: Structure, board: Board, options: FitOptions) -> tuple[dict[str, float], Bias]:
    """Return the parameters that a fit holds, by the structure's names, and whose zero the sensor has.

    The user holds some of them. The record holds others: known parameters, the spring of a joint without one, and the rest angle where
    the sensor's zero replaces it. The weight of a joint without a spring has a prior instead (`known_priors`).
    """
    values, fixed, bias = record_values(board), dict(options.fixed), options.bias
    for part in structure.parts:
        table = isinstance(part, TorqueEffect) and part.smoothness is not None
        names = [f"{part.name}.{p.name}" for p in part.parameters if p.held or table]
        if table and not {*names} <= {*values}:
            raise SysidError(
                f"the record has no table of '{part.name}': `fit --effect {part.name}` learns one."
            )
        fixed = {**{name: values[name] for name in names if name not in options.bounds}, **fixed}
    if board.stiffness == 0 and "stiffness" not in options.bounds and pulls_back(structure, board):
        fixed.setdefault("stiffness", 0.0)
    if fixed.get("stiffness") == 0 and not any(part.adds_inertia for part in structure.torques):
        # A fitted inertia absorbs the record's errors.
        uncertain = {
            f"{part.name}.{p.name}" for part in structure.parts for p in part.parameters if p.assumed
        }
        fixed = {n: value for n, value in fixed.items() if n not in uncertain or n in options.fixed}
    zeros = any("rest_angle" in part.same_as for part in structure.parts)
    if fixed.get("stiffness") == 0 and not (zeros or options.use_rate):
        bias = "per-release"  # without a spring no rest angle can stand for the sensor's zero
    if zeros or options.use_rate or bias == "per-release":
        fixed.setdefault("rest_angle", board.rest_angle)
    return fixed, bias


def known_priors(board: Board) -> dict[str, tuple[float, float]]:
    """Return what a record knows from elsewhere, but not exactly: value and standard deviation by 'effect.parameter', in their units.

    Only their ratio to the inertia shows in a decay, so it is that which is known so well.
    """
    return {
        f"{part.name}.{p.name}": (q.value, q.std or abs(q.value) * p.assumed)
        for part in board.effects for p in effect(part.name).parameters
        if p.assumed and (q := part.parameters[p.name])
    }  # fmt: skip


def prior_in_words(board: Board, name: str, prior: tuple[float, float]) -> str:
    """Return the prior of a parameter, with its source.

    Args:
        prior: Its value and standard deviation, in its unit.
    """
    known = board.quantities[name]
    said = "from the record" if known.std else "assumed, for the record says nothing of it"
    return f"prior of {name}, {said}: {replace(known, value=prior[0], std=prior[1])}"


def priors_of(board: Board, options: FitOptions) -> dict[str, tuple[float, float]]:
    """Return the record's priors of parameters: value and standard deviation, in their units.

    Raises:
        SysidError: It knows nothing of one, or knows it exactly.
    """
    known = board.quantities
    for name in options.priors:
        if name not in known or not 0 < known[name].std < np.inf:
            raise SysidError(
                f"the record of '{board.name}' has no uncertainty of '{name}', so it cannot count as a measurement. Hold it (--fix), "
                "bound it (--bound), or fit it without."
            )
        if name in options.fixed:
            raise SysidError(f"{name} is held and has a prior at once; give one of both.")
    return {name: (known[name].value, known[name].std) for name in options.priors}


@dataclass(frozen=True, slots=True)
class Near:
    """A place near the minimum of a fit."""

    parameters: Mapping[str, float]
    """In their units; the others are as the catalogue starts them."""
    starts: Sequence[tuple[float, float]] | None = None
    """Roll [rad] and rate [rad/s] at each release; None if unknown, so that the place is sought in the first swings."""

    def fitted(
        self, problem: Problem, others: Mapping[str, float], tolerance: float | None = None
    ) -> Minimum:
        """Return the minimum that a search from here reaches.

        Args:
            problem: The least squares.
            others: Parameters that are not known here, in their units.
            tolerance: Relative fall of the cost at which it ends [1]; one that is insignificant, if left out.
        """
        point = problem.start({**others, **self.parameters}, self.starts)
        return problem.fitted(
            lengthened(problem, point) if self.starts is None else point, tolerance=tolerance
        )


def fit_joint(
    releases: Sequence[Release],
    board: Board,
    effects: Sequence[str] = (),
    options: FitOptions | None = None,
    scales: Scales | None = None,
    start: Near | None = None,
) -> JointFit:
    """Fit stiffness, damping, rest angle and the parameters of some effects to releases.

    Args:
        effects: All effects of the joint.
        scales: Sizes of the problem, where another fit of these releases knows them.
        start: A place near the minimum, which then needs no search.

    Raises:
        SysidError: Nothing to fit, an effect that free decays cannot identify, or no convergence.
    """
    options = options or FitOptions()
    check_effects(effects, [part.name for part in board.effects])
    check_parameters(effects, options, board)
    if not releases:
        raise SysidError("no release to fit. Let the deck go and record until it rests.")
    noise = noise_floor(releases, rate=options.use_rate)
    records = make_records(releases, noise.std, rate=options.use_rate)
    scales = scales or scales_of(records, board)
    structure = structure_of(effects)
    fine = options.steps_per_period * (3 if structure.nonsmooth else 1)
    problem = _problem(structure, records, scales, board, options, fine)
    first = starting_points(structure, scales, problem.fixed)
    if start is None:
        minimum, evaluations = search(problem, first)
    else:
        minimum = start.fitted(problem, first[0])
        evaluations = minimum.evaluations
    problem, minimum, more = _plainest(problem, minimum)
    warnings: list[str] = []
    measured = board.stiffness and (board.fit or board.decay)
    if not measured or problem.parameters(minimum.point)["stiffness"] <= 0:
        problem, minimum, warnings = _springless(problem, minimum, board)
    found = finished(problem, minimum, board, options, noise, evaluations + more)
    return replace(found, warnings=(*warnings, *found.warnings))


def _problem(
    structure: Structure,
    records: Sequence[Record],
    scales: Scales,
    board: Board,
    options: FitOptions,
    steps: int,
) -> Problem:
    """Return the least squares of a structure on records, with all that options and the record say of it.

    Args:
        steps: Of the integrator a period.
    """
    fixed, bias = held_parameters(structure, board, options)
    free = {*structure.parameters} - {*fixed, *options.bounds}
    known = {name: prior for name, prior in known_priors(board).items() if name in free}
    return Problem(
        structure, records, scales, bias=bias, fixed=fixed, bounded=options.bounds, steps_per_period=steps,
        priors={**known, **priors_of(board, options)}, free_states=starts_unknown(structure, records),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Trial:
    """A fit from one start on a coarse grid."""

    residuals: tuple[Array, ...]
    """Model minus measurement of each record [rad or rad/s]."""
    end: Near


def trial_fit(fit: JointFit, board: Board, effects: Sequence[str], options: FitOptions, start: Near) -> Trial:
    """Fit the records of another fit with some effects from one start: no search, no uncertainty.

    Args:
        effects: All effects of the joint.
        start: A place near the minimum.

    Raises:
        SysidError: Effects that free decays cannot identify, or a motion without bound.
    """
    check_effects(effects, [part.name for part in board.effects])
    structure, scales = structure_of(effects), fit.problem.scales
    problem = _problem(structure, fit.records, scales, board, options, options.steps_per_period)
    first = starting_points(structure, scales, problem.fixed)[0]
    found = start.fitted(problem, first, 1e-4)
    if not np.isfinite(found.normal.cost):
        raise SysidError("from this start the motion has no bound.")
    end = Near(problem.parameters(found.point), problem.starts(found.point))
    return Trial(tuple(problem.residuals(found.point)), end)


def finished(
    problem: Problem, minimum: Minimum, board: Board, options: FitOptions, noise: NoiseFloor, evaluations: int
) -> JointFit:
    """Return a fit from its minimum: no damper that drives.

    Raises:
        SysidError: The motion has no bound.
    """
    free = {*problem.names} - {*problem.bounded}
    if "damping" in free and problem.parameters(minimum.point)["damping"] <= 0:
        problem, minimum = _held(problem, minimum, "damping", 0.0)  # other effects take all of the loss
    if not np.isfinite(minimum.normal.cost):
        raise SysidError("the fit found no parameters with a bounded motion. Check the unit of the log.")
    found = summarise(problem, minimum, board, noise, evaluations)
    for name in problem.structure.rough if options.bounds_friction and problem.bias == "per-release" else ():
        if name in problem.names and not minimum.at_bound[problem.names.index(name)]:
            found = _bounded_below(found, name)
    return found


def _bounded_below(fit: JointFit, name: str) -> JointFit:
    """Return a fit that states a least value of a friction where the logs set no upper limit.

    A joint that sticks after one half swing shows only that the friction suffices. The zero and the start of each release, which
    are free, make up for more of it.
    """
    problem, minimum, value = fit.problem, fit.minimum, fit.quantities[name].value
    scale = _scatter(problem, minimum)

    def explains(held: float) -> bool:
        other, near = _held(problem, minimum, name, held)
        begun = other.fitted(other.start(problem.parameters(minimum.point)), tolerance=1e-7)
        cost = min(near.normal.cost, begun.normal.cost)
        return 2 * (cost - minimum.normal.cost) < Z95**2 * scale

    if not value > 0 or not explains(2 * value):
        return fit
    low, high = 0.0, value
    while high - low > 0.01 * high:
        middle = (low + high) / 2
        low, high = (low, middle) if explains(middle) else (middle, high)
    open_ended = replace(fit.quantities[name], std=float("inf"), interval=(low, float("inf")))
    said = f"{name} is {open_ended}: after one half swing the joint sticks, so these logs set no upper limit"
    kept = (text for text in fit.warnings if not text.startswith(f"{name} "))
    return replace(fit, quantities={**fit.quantities, name: open_ended}, warnings=(*kept, said))


def options_for(options: FitOptions, effects: Sequence[str], board: Board) -> FitOptions:
    """Return options for a joint with some effects: without other parameters, and without a spring held at 0 if nothing else pulls back."""
    structure = structure_of(effects)
    kept = set(structure.parameters)
    if not pulls_back(structure, board):
        kept -= {"stiffness"} if options.fixed.get("stiffness") == 0 else set()
    return replace(
        options,
        fixed={name: value for name, value in options.fixed.items() if name in kept},
        bounds={name: ends for name, ends in options.bounds.items() if name in kept},
        priors=tuple(name for name in options.priors if name in kept),
    )


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
            simpler, without = _held(problem, minimum, name, parameter.default)
            evaluations += without.evaluations
            price = np.log(problem.samples) * _scatter(problem, minimum)
            if 2 * (without.normal.cost - minimum.normal.cost) < price:
                problem, minimum = simpler, without
    return problem, minimum, evaluations


def _springless(problem: Problem, minimum: Minimum, board: Board) -> tuple[Problem, Minimum, list[str]]:
    """Let gravity take the spring's place where the data do without a spring: a pendulum has none.

    A decay hardly distinguishes the two. A spring that was measured before, or is significant by BIC, is kept. No spring is negative.
    """
    parts = [part for part in problem.structure.torques if part.adds_stiffness]
    added = [f"{part.name}.{part.adds_stiffness}" for part in parts]
    free = {*problem.names} - {*problem.bounded}
    if not (added and {added[0], "stiffness"} <= free):
        return problem, minimum, []
    known = problem.parameters(minimum.point)
    rest_angle = problem.fixed.get("rest_angle", board.rest_angle)
    zeros = "rest_angle" in problem.names and not problem.records[0].is_rate
    simpler = problem.with_(
        fixed={**problem.fixed, "stiffness": 0.0, "rest_angle": rest_angle},
        bias="per-release" if zeros else problem.bias,
    )
    start = simpler.start({**known, added[0]: known[added[0]] + known["stiffness"]})
    without = simpler.fitted(start, tolerance=1e-7)
    # Residuals that follow the motion count once in their correlation length.
    unit = _scatter(problem, minimum) * max(correlation_length(problem.residuals(minimum.point)), 1.0)
    worth = 2 * (without.normal.cost - minimum.normal.cost) / unit
    if not np.isfinite(without.normal.cost) or (known["stiffness"] > 0 and worth > np.log(problem.samples)):
        return problem, minimum, []
    text = (
        f"these logs show no spring beside {parts[0].name}: stiffness is held at 0. If there is one, hold it at its value "
        "(--fix stiffness=VALUE)"
    )
    return simpler, without, [text]


def _held(problem: Problem, minimum: Minimum, name: str, value: float) -> tuple[Problem, Minimum]:
    """Hold a free parameter at a value, and fit the others again from where they are."""
    simpler = problem.with_(fixed={**problem.fixed, name: value})
    start = np.delete(minimum.point, problem.names.index(name))
    return simpler, simpler.fitted(start)


def _scatter(problem: Problem, minimum: Minimum) -> float:
    """Return the variance of the residuals over that of the noise, at least 1."""
    return max(2 * minimum.normal.cost / max(1, problem.samples - len(minimum.point)), 1.0)
