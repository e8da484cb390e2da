"""Fit the tilt joint to measured releases: nonlinear least squares with CasADi.

A free decay fixes only k/I, d/I and τ/I. The roll inertia is taken from the board, and its uncertainty
goes into every torque. Residuals of a real log are correlated; the intervals account for that.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.board import Board
from sysid.decay.plausibility import amplitude_warnings, period_warnings, refuse_period
from sysid.effects import effect
from sysid.errors import HuskyError
from sysid.fitting import report as fit_report
from sysid.fitting.problem import Problem
from sysid.fitting.record_update import error_of, require_usable, updated_board
from sysid.fitting.records import Bias, Signal, make_records, signal_of
from sysid.fitting.result import JointFit, summarise
from sysid.fitting.search import scales_of, search
from sysid.joint.law import JointLaw
from sysid.joint.structure import structure_of
from sysid.least_squares import Minimum, minimise
from sysid.noise.floor import NoiseFloor, noise_floor
from sysid.quantity import Quantity
from sysid.recording import Data, Recording, reading_warnings, unpack
from sysid.roll import Array, Release
from sysid.text import WIDTH, quantity_frame

if TYPE_CHECKING:
    import pandas as pd


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


PLAIN = "spring and damper"
"""The simplest model."""


@dataclass(frozen=True, slots=True)
class Rung:
    """One model of a ladder, from the linear joint up."""

    label: str
    """The effect that it adds."""
    fit: JointFit
    heldout_rmse: float
    """On releases that were left out [rad or rad/s]; NaN where that was not asked for."""

    @property
    def rmse(self) -> float:
        """On the releases that were fitted [rad or rad/s]."""
        return self.fit.rmse

    @property
    def simulated(self) -> tuple[Array, ...]:
        """Each fitted release as the model has it [rad or rad/s], shapes (n,)."""
        pairs = zip(self.fit.records, self.fit.residuals, strict=True)
        return tuple(record.signal + residual for record, residual in pairs)


def ladder(
    releases: Sequence[Release],
    board: Board,
    effects: Sequence[str],
    options: FitOptions,
    *,
    heldout: bool = True,
) -> Iterator[Rung]:
    """Fit the linear joint, then the joint with one effect more each time.

    Args:
        releases: Free decays of one board.
        board: Gives the roll inertia.
        effects: In the order in which they are added.
        options: How.
        heldout: Also predict releases that are left out.

    Raises:
        SysidError: A model cannot be fitted; those before it have been returned.
    """
    for count in range(len(effects) + 1):
        fitted = fit_joint(releases, board, effects[:count], options)
        yield _rung(effects[:count], fitted, fitted.heldout_rmse() if heldout else math.nan)


def _rung(effects: Sequence[str], fitted: JointFit, heldout: float) -> Rung:
    return Rung(f"+ {effects[-1]}" if effects else PLAIN, fitted, heldout)


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A joint fitted to recordings, and the record that it makes."""

    joint: JointFit
    """Covariance, residuals and starts."""
    before: Board
    """The record that gave the inertia."""
    releases: tuple[Release, ...]
    options: FitOptions
    recordings: tuple[Recording, ...]
    """The logs, where they were given whole."""
    warnings: tuple[str, ...]
    """What is wrong with the logs, odd about them for this board, or doubtful about the fit."""

    @property
    def law(self) -> JointLaw:
        """The fitted law; prints as an equation."""
        return self.joint.law

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """'stiffness', 'damping', 'rest_angle' and 'effect.parameter', the inertia's uncertainty included."""
        return self.joint.quantities

    @property
    def rmse(self) -> float:
        """Root mean square residual [rad; rad/s where the rate was fitted]."""
        return self.joint.rmse

    @property
    def noise(self) -> NoiseFloor:
        """Sensor noise of what was fitted [rad or rad/s]."""
        return self.joint.noise

    @property
    def is_rate(self) -> bool:
        """Whether the rate was fitted, not the roll."""
        return self.joint.records[0].is_rate

    @property
    def status(self) -> str:
        """How the search ended, in words."""
        return self.joint.status

    @cached_property
    def heldout_rmse(self) -> float:
        """Error on releases that were left out, one after another [rad or rad/s]."""
        return self.joint.heldout_rmse()

    @cached_property
    def rmse_before(self) -> float:
        """Error of the record as it stood [rad or rad/s]."""
        return error_of(self.before, self.joint)

    @cached_property
    def ladder(self) -> tuple[Rung, ...]:
        """Errors from the linear joint up, one effect more each time."""
        names = tuple(name for name, _ in self.law.effects)
        top = _rung(names, self.joint, self.heldout_rmse)
        return (*(ladder(self.releases, self.before, names[:-1], self.options) if names else ()), top)

    @cached_property
    def board(self) -> Board:
        """The record with the fit in it.

        Raises:
            SysidError: The fit did not converge, or the logs leave a parameter open.
        """
        files = (recording.path for recording in self.recordings)
        return self.updated_board({str(file): file for file in files if file.exists()})

    def updated_board(self, logs: Mapping[str, Path]) -> Board:
        """Return the record with the fit in it.

        Args:
            logs: The files that were fitted, by the names that the record shall give them.

        Raises:
            SysidError: The fit did not converge, or the logs leave a parameter open.
        """
        require_usable(self.joint)
        return updated_board(self.before, self.joint, logs, heldout=self.heldout_rmse)

    def report(self, width: int = WIDTH) -> str:
        """Return what `husky-sysid fit` prints, in tables of at most `width` characters."""
        return fit_report.report(self, width)

    def to_json(self) -> dict[str, Any]:
        """Return what `husky-sysid fit --json` writes."""
        return fit_report.to_json(self)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return one row a quantity: value, std, low and high end of the 95 % interval, unit, how."""
        return quantity_frame(self.quantities)


def fit(
    data: Data,
    board: Board,
    effects: Sequence[str] = (),
    *,
    plain: bool = False,
    robust: bool = False,
    fixed: Mapping[str, float] | None = None,
    signal: Signal = "auto",
    any_period: bool = False,
) -> Fit:
    """Fit stiffness, damping, rest angle and effects to recordings.

    The roll inertia is taken from the record: a free decay alone fixes only k/I, d/I and torque/I.

    Args:
        data: Free decays of one board: a recording, several, or releases.
        board: The record.
        effects: Effects to add to those of the record.
        plain: Drop the effects that the record has.
        robust: Let outliers of the sensor count less.
        fixed: Parameters held at a value, by 'stiffness', 'damping', 'rest_angle' or 'effect.parameter'.
        signal: What is fitted.
        any_period: Accept a natural period above 100 s or below 1 ms, else taken for a wrong unit of time.

    Raises:
        SysidError: An effect that free decays cannot identify, no convergence, or a period that nothing has.
    """
    recordings, releases = unpack(data)
    check_effects(effects)
    kept = () if plain else tuple(part.name for part in board.effects)
    options = FitOptions(robust=robust, fixed=fixed or {}, **signal_of(releases, signal))
    odd = amplitude_warnings(releases, board)
    joint = fit_joint(releases, board, tuple(dict.fromkeys((*kept, *effects))), options)
    named, frequency = ", ".join(dict.fromkeys(release.log for release in releases)), joint.law.frequency
    if not any_period:
        refuse_period(frequency, board, log=named)
    return Fit(
        joint=joint,
        before=board,
        releases=tuple(releases),
        options=options,
        recordings=recordings,
        warnings=(
            *reading_warnings(recordings),
            *odd,
            *period_warnings(frequency, board, log=named),
            *joint.warnings,
        ),
    )
