"""Fit the tilt joint to measured releases: nonlinear least squares with CasADi.

A free decay fixes only k/I, d/I and τ/I. The roll inertia is that of the board, and its uncertainty is part of that of every
torque. Residuals of a real log are correlated; the intervals account for that.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.board import Board, require_record
from sysid.decay.plausibility import amplitude_warnings, period_warnings, refuse_period
from sysid.effects import effect
from sysid.fitting import report as fit_report
from sysid.fitting.joint import FitOptions, check_effects, fit_joint
from sysid.fitting.ladder import Rung, ladder, rung_name
from sysid.fitting.record_update import error_of, left_open, require_usable, updated_board
from sysid.fitting.records import signal_of
from sysid.fitting.result import TOLERANCE, JointFit
from sysid.joint.law import JointLaw
from sysid.noise.floor import NoiseFloor
from sysid.noise.whiteness import correlation_length
from sysid.progress import stage
from sysid.quantity import SURE, Quantity
from sysid.recording import Data, Recording, reading_warnings, unpack
from sysid.roll import Release
from sysid.shown import MOST_SHOWN, Shown
from sysid.text import WIDTH, count, quantity_frame

if TYPE_CHECKING:
    import pandas as pd

    from sysid.diagnosis.shapes import Formula

LEARNED = "learned"
"""The effect that is a table."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Fit(Shown):
    """A joint fitted to recordings, and its new record."""

    joint: JointFit
    """Covariance, residuals and starts."""
    before: Board
    """The record that gave the inertia."""
    releases: tuple[Release, ...]
    options: FitOptions
    recordings: tuple[Recording, ...]
    """The logs; empty if only releases were given."""
    warnings: tuple[str, ...]
    """Problems of the logs, of the logs for this board, and of the fit."""
    formula: "Formula | None" = None
    """The formula nearest to a learned torque."""

    @property
    def law(self) -> JointLaw:
        """The fitted law; prints as an equation."""
        return self.joint.law

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """'stiffness', 'damping', 'rest_angle' and 'effect.parameter', with the uncertainty of the inertia."""
        return self.joint.quantities

    @property
    def rmse(self) -> float:
        """Root mean square residual [rad; rad/s if the rate was fitted]."""
        return self.joint.rmse

    @property
    def noise(self) -> NoiseFloor:
        """Sensor noise of the fitted signal [rad or rad/s]."""
        return self.joint.noise

    @property
    def is_rate(self) -> bool:
        """Whether the rate was fitted, not the roll."""
        return self.joint.records[0].is_rate

    @property
    def status(self) -> str:
        """Termination of the search, in words."""
        return self.joint.status

    @cached_property
    def heldout_rmse(self) -> float:
        """Error on a release that the fit did not see; each is left out once [rad or rad/s]."""
        return self.joint.heldout_rmse()

    @cached_property
    def rmse_before(self) -> float:
        """Error of the record before the fit [rad or rad/s]."""
        return error_of(self.before, self.joint)

    @cached_property
    def ladder(self) -> tuple[Rung, ...]:
        """Errors of the linear joint and with each effect added."""
        parts = self.law.structure.parts
        names = [part.name for part in parts]
        known = [name for name in names if effect(name).is_known]
        added = [name for name in names if name not in known]
        with stage(0.0, 0.8):
            simpler = (
                tuple(ladder(self.releases, self.before, [*known, *added[:-1]], self.options))
                if added
                else ()
            )
        with stage(0.8, 1.0):
            return (*simpler, Rung(rung_name(added), self.joint, self.heldout_rmse))

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
            logs: The fitted logs, by their names in the record.

        Raises:
            SysidError: The fit did not converge, or the logs leave a parameter open.
        """
        require_usable(self.joint, self.before)
        return updated_board(self.before, self.joint, logs, heldout=self.heldout_rmse)

    def brief(self) -> str:
        """Return the law, its quantities, and the error over the noise."""
        values = [f"  {name} {quantity}" for name, quantity in self.quantities.items()]
        lines = [
            f"Fit of {self.before.name} to {count(len(self.releases), 'release')}: {self.status}",
            f"  {self.law}",
            *values[:MOST_SHOWN],
            *([f"  and {len(values) - MOST_SHOWN} more"] if len(values) > MOST_SHOWN else []),
            f"  error / noise {self.rmse / self.noise.std:.3g}",
        ]
        return "\n".join(lines)

    def report(self, width: int = WIDTH) -> str:
        """Return the text of `husky-sysid fit`, in tables of at most `width` characters."""
        return fit_report.report(self, width)

    def to_json(self) -> dict[str, Any]:
        """Return the result of `husky-sysid fit --json`."""
        return fit_report.to_json(self)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return one row a quantity: value, std, low and high end of the 95 % interval, unit, how."""
        return quantity_frame(self.quantities)


def _leaning_on_record(
    releases: Sequence[Release], board: Board, effects: Sequence[str], options: FitOptions, joint: JointFit
) -> tuple[FitOptions, JointFit, list[str]]:
    """Return a fit that uses the record's effect parameters as measurements if its logs leave them open, and a warning.

    A log of small swings does not reach an end stop, for example. A fit whose logs contradict the record stays unchanged.
    """
    wanting = {name.split(".")[0] for name in left_open(joint) if "." in name}
    known = [
        name
        for name, quantity in board.quantities.items()
        if name.split(".")[0] in wanting and name in joint.quantities and 0 < quantity.std < math.inf
    ]
    if not known:
        return options, joint, []
    richer = replace(options, priors=tuple(dict.fromkeys((*options.priors, *known))))
    told = fit_joint(releases, board, effects, richer)
    noise = max(2 * joint.minimum.normal.cost / max(1, joint.problem.samples), 1.0)
    worse = 2 * (told.minimum.normal.cost - joint.minimum.normal.cost) / noise
    if left_open(told) or worse > SURE**2 * max(correlation_length(joint.residuals), 1.0):
        return options, joint, []
    return richer, told, [
        f"these logs leave {', '.join(known)} open: the record's values count as measurements. A log like those of the record "
        "would fix them; --plain fits without the effects of the record"
    ]  # fmt: skip


def _misfit(joint: JointFit) -> list[str]:
    """Return a warning if the fitted law leaves a residual: its intervals are then too narrow."""
    if joint.excess <= TOLERANCE:
        return []
    return [
        f"the residual is {joint.rmse / joint.noise.std:.3g} times the noise ({100 * joint.excess:.2g} % of the motion beyond it, "
        f"{100 * TOLERANCE:.2g} % allowed). The numbers are a compromise, and their intervals too narrow. An effect is missing, or "
        "a hand or a motor moved the joint (--input fits a driven one)"
    ]


def fit(
    data: Data,
    board: Board,
    effects: str | Sequence[str] = (),
    *,
    plain: bool = False,
    fixed: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Sequence[str] = (),
    any_period: bool = False,
) -> Fit:
    """Fit stiffness, damping, rest angle and effects to recordings.

    The roll inertia is that of the record: a free decay alone fixes only k/I, d/I and torque/I.

    Args:
        data: Free decays of one board: a recording, several, or releases.
        board: The record.
        effects: Effect, or effects, to add to those of the record.
        plain: Drop the effects of the record.
        fixed: Parameters held at a value, by 'stiffness', 'damping', 'rest_angle' or 'effect.parameter'.
        bounds: Lowest and highest value of parameters, by the same names.
        priors: Parameters whose value and standard deviation in the record count as a measurement, by the same names.
        any_period: Accept a natural period above 100 s or below 1 ms. Without it, such a period is a wrong unit of time.

    Raises:
        SysidError: A free decay cannot identify an effect, the search does not converge, or the period is impossible.
    """
    recordings, releases, weak = unpack(data)
    require_record(board)
    effects = (effects,) if isinstance(effects, str) else effects
    check_effects(effects, [part.name for part in board.effects])
    kept = tuple(part.name for part in board.effects if not plain or effect(part.name).is_known)
    options = FitOptions(fixed=fixed or {}, bounds=bounds or {}, priors=tuple(priors), **signal_of(releases))
    warnings = [*reading_warnings(recordings), *weak, *amplitude_warnings(releases, board)]
    every = tuple(sorted(dict.fromkeys((*kept, *effects)), key=LEARNED.__eq__))  # tables hold the rest
    formula, leant = None, list[str]()
    if LEARNED in every:
        from sysid.diagnosis.learned_torque import learn

        joint, formula = learn(releases, board, every, options)
    else:
        joint = fit_joint(releases, board, every, options)
        options, joint, leant = _leaning_on_record(releases, board, every, options, joint)
    named, frequency = ", ".join(dict.fromkeys(release.log for release in releases)), joint.law.frequency
    if not any_period:
        refuse_period(frequency, board, log=named)
    warnings += [*period_warnings(frequency, board, log=named), *joint.warnings, *leant, *_misfit(joint)]
    return Fit(
        joint=joint, before=board, releases=tuple(releases), options=options, recordings=recordings, warnings=tuple(warnings),
        formula=formula,
    )  # fmt: skip
