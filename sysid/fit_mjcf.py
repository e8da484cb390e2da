"""Fit the tilt joint to measured releases: nonlinear least squares with CasADi.

A free decay fixes only k/I, d/I and τ/I. The roll inertia is taken from the board, and its uncertainty
goes into every torque. Residuals of a real log are correlated; the intervals account for that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.board import Board
from sysid.effects import effect
from sysid.errors import HuskyError
from sysid.fitting.problem import Problem
from sysid.fitting.records import Bias, make_records
from sysid.fitting.result import JointFit, summarise
from sysid.fitting.search import scales_of, search
from sysid.joint.structure import structure_of
from sysid.least_squares import Minimum, minimise
from sysid.noise.floor import noise_floor
from sysid.roll import Release


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
    structure = structure_of(effects)
    fixed = dict(options.fixed)
    if any(effect(name).role == "shift" or name == "sensor-bias" for name in effects):
        fixed.setdefault("rest_angle", board.rest_angle)
    if options.use_rate or options.bias == "per-release":
        fixed.setdefault("rest_angle", board.rest_angle)
    fine = options.steps_per_period * (3 if structure.nonsmooth else 1)
    problem, minimum, evaluations = search(
        structure, records, scales, bias=options.bias, fixed=fixed, steps_per_period=fine
    )
    problem, minimum, more = _plainest(problem, minimum)
    evaluations += more
    if options.robust:
        problem, minimum = _robust(problem, minimum)
    if not np.isfinite(minimum.normal.cost):
        raise HuskyError("the fit found no parameters with a bounded motion. Check the unit of the log.")
    return summarise(problem, minimum, board, noise, evaluations)


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
            simpler = problem.with_(fixed={**problem.fixed, name: parameter.default})
            start = np.delete(minimum.point, problem.names.index(name))
            without = minimise(simpler.normal, start, *simpler.bounds())
            evaluations += without.evaluations
            noise = 2 * minimum.normal.cost / max(1, problem.samples - len(minimum.point))
            if 2 * (without.normal.cost - minimum.normal.cost) < np.log(problem.samples) * max(noise, 1.0):
                problem, minimum = simpler, without
    return problem, minimum, evaluations


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
