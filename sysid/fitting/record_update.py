"""Writes a fitted joint into the board record: values, deviations, provenance, and a history line."""

import datetime
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from sysid.board import Board, BoardEffect
from sysid.effects import effect, origin
from sysid.errors import SysidError
from sysid.files import sha256
from sysid.fitting.covariance import table_values
from sysid.fitting.cross_validation import rms
from sysid.fitting.initial_state import fit_initial_states
from sysid.fitting.problem import ZERO_TABLE_WEIGHT
from sysid.fitting.result import JointFit
from sysid.joint.law import JointLaw
from sysid.quantity import Quantity, slide_unit


def require_usable(fit: JointFit, board: Board) -> None:
    """Accept a fit that may be recorded.

    Raises:
        SysidError: It did not converge, a parameter ended at its bound, or the data leave one open.
    """
    if fit.minimum.status != "converged":
        raise SysidError(
            f"the fit did not converge ({fit.status}); the record is unchanged. Try other effects ("
            "diagnose), or fewer."
        )
    if fit.problem.smoothing and min(fit.problem.smoothing) >= ZERO_TABLE_WEIGHT:
        raise SysidError(
            "these logs show no torque beyond what the record holds: nothing was learned, and the record is unchanged. "
            "Ask diagnose what the logs do show."
        )
    names = list(fit.quantities)
    for name in _at_bound(fit):
        value = fit.quantities[name]
        vanished = "." in name and abs(value.value) < 1e-12
        alone = sum(other.startswith(name.split(".")[0] + ".") for other in names) == 1
        cause = (
            "these logs show no such effect" if vanished and alone
            else "these logs can do without it; a simpler effect says as much" if vanished
            else "the logs do not fix it, or the effect is the wrong one"
        )  # fmt: skip
        raise SysidError(
            f"{name} ended at its bound ({value.value:.4g} {value.unit}): {cause}; the record is unchanged. "
            "Ask diagnose what the logs do show."
        )
    for name in ("stiffness", "damping"):
        if name in fit.quantities and fit.quantities[name].value <= 0:
            raise SysidError(
                f"{name} came out as {fit.quantities[name].value:.4g}; a passive joint has more than 0. The record is "
                f"unchanged. Ask diagnose what the logs do show, or hold it (--fix {name}=0)."
            )
    for name in _unfixed(fit):
        part = name.split(".")[0]
        advice = "Record more releases, to both sides." if part == name else board.experiment(part)
        raise SysidError(
            f"{name} is {fit.quantities[name]}: these logs do not fix it; the record is unchanged. {advice}"
        )


def left_open(fit: JointFit) -> list[str]:
    """Return the parameters for which a fit may not be recorded: at their bounds, or not fixed by the data."""
    return [*_at_bound(fit), *_unfixed(fit)]


def _at_bound(fit: JointFit) -> list[str]:
    ends = zip(fit.quantities, fit.minimum.at_bound, strict=False)
    return [name for name, at_bound in ends if at_bound and name not in fit.problem.bounded]


def _unfixed(fit: JointFit) -> list[str]:
    known = {*table_values(fit.problem.structure), "rest_angle"}
    return [n for n, q in fit.quantities.items() if n not in known and q.std > 3 * max(abs(q.value), 1e-9)]


def updated_board(board: Board, fit: JointFit, logs: Mapping[str, Path], *, heldout: float) -> Board:
    """Return the board with a fit in it: no check has passed it yet.

    Logs go by the names that the record shall give them; `heldout` is the RMSE on releases that were left out [rad].
    """
    day = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    kept = {**board.tilt}
    for name in ("stiffness", "damping", "rest_angle"):
        if name in fit.quantities:
            kept[name] = replace(fit.quantities[name], method="")
        elif name in fit.problem.fixed:
            kept[name] = Quantity(
                fit.problem.fixed[name],
                kept[name].std if fit.problem.fixed[name] == kept[name].value else 0.0,
                kept[name].unit,
            )
    unit = slide_unit if board.slides else str
    effects = tuple(
        BoardEffect(name, _parameters(fit, name, values, unit), origin(name))
        for name, values in fit.law.effects
    )
    names = [name for name, _ in fit.law.effects]
    line: dict[str, Any] = {
        "date": day, "effects": names, "rmse_before": error_of(board, fit), "rmse": fit.rmse,
        "heldout_rmse": heldout, "noise_floor": fit.noise.std,
    }  # fmt: skip
    return replace(
        board,
        tilt=kept,
        effects=effects,
        fit={
            "logs": [{"path": name, "sha256": sha256(log)} for name, log in logs.items()],
            # The law is continuous; this is the step at which the fit integrated it.
            "integrator": "RK4",
            "timestep": fit.problem.step,
            "signal": "rate" if fit.records[0].is_rate else "roll",
            "releases": len(fit.records),
            "rmse": fit.rmse,
            "heldout_rmse": heldout,
            "noise_floor": fit.noise.std,
            "unit": "rad/s" if fit.records[0].is_rate else "rad",
            "version": version("husky-sysid"),
            "date": day,
        },
        last_check={},
        history=(*board.history, line),
    )


def _parameters(
    fit: JointFit, name: str, values: Sequence[float], unit: Callable[[str], str]
) -> Mapping[str, Quantity]:
    quantities: dict[str, Quantity] = {}
    for parameter, value in zip(effect(name).parameters, values, strict=True):
        known = fit.quantities.get(f"{name}.{parameter.name}")
        if known is not None and parameter.held and f"{name}.{parameter.name}" in fit.problem.priors:
            # A decay knows its ratio to the inertia, with which it was recorded; of itself no more than was known.
            known = replace(known, std=fit.problem.priors[f"{name}.{parameter.name}"][1])
        quantities[parameter.name] = (
            Quantity(value, 0.0, unit(parameter.unit)) if known is None else replace(known, method="")
        )
    return quantities


def error_of(board: Board, fit: JointFit) -> float:
    """Return the RMSE of the record as it stands on the fitted releases, roll and rate at release free."""
    return rms(fit_initial_states(JointLaw.from_board(board), fit.records, bias=fit.problem.bias)[0])
