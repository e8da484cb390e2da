"""`husky-sysid fit`: the tilt joint that decays like the board, saved in its record."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter

from sysid.board import Board
from sysid.cli.console import Common, Printer
from sysid.cli.fit_intervals import show_intervals
from sysid.cli.log_options import LogArguments, load_releases
from sysid.files import atomic_path
from sysid.roll import Release

if TYPE_CHECKING:
    from reports.figures.ladder import Rung
    from sim.compensation.step import Compensation
    from sysid.fit_mjcf import FitOptions
    from sysid.fitting.result import JointFit

_NO_ARGUMENTS = LogArguments()
_NO_COMMON = Common()


def fit(
    logs: list[Path],
    /,
    *,
    board: Annotated[str, Parameter(name=("--board", "-b"))],
    effect: Annotated[tuple[str, ...], Parameter(name="--effect", negative="")] = (),
    plain: bool = False,
    robust: bool = False,
    in_scene: Annotated[bool, Parameter(name="--in-scene", negative="")] = False,
    profile: Annotated[bool, Parameter(name="--profile", negative="")] = False,
    bootstrap: int = 0,
    any_period: Annotated[bool, Parameter(name="--any-period", negative="")] = False,
    arguments: LogArguments = _NO_ARGUMENTS,
    common: Common = _NO_COMMON,
) -> int:
    """Fit stiffness, damping and effects to logs, and save the board.

    The roll inertia is taken from the record: a free decay alone fixes only k/I, d/I and torque/I.

    Args:
        logs: Logs of one board.
        board: Name of the board.
        effect: Effect to add to those of the record; repeat it for several.
        plain: Drop the effects that the record has.
        robust: Let outliers of the sensor count less.
        in_scene: Also find what must be written into the training scene (implicitfast at 5 ms, wheels on the
            ground, equality coupling) so that the scene as a whole decays like the board.
        profile: Also walk along each parameter while the others follow: intervals that need not be symmetric.
        bootstrap: Also fit so many logs drawn from the residuals, block by block, as a check of the
            intervals; 400 is a good number.
        any_period: Save a natural period above 100 s or below 1 ms too, which else is taken for a wrong unit of time.
        arguments: How the logs are read.
        common: Options of every command.
    """
    from sysid.decay.plausibility import amplitude_warnings, period_warnings, refuse_period
    from sysid.fit_mjcf import FitOptions, check_effects, fit_joint
    from sysid.fitting.record_update import require_usable, updated_board
    from sysid.fitting.records import signal_of

    printer = Printer(common)
    record = common.space.load_board(board)
    check_effects(effect)
    if bootstrap:
        from sysid.fitting.bootstrap import require_enough

        require_enough(bootstrap)
    kept = () if plain else tuple(part.name for part in record.effects)
    names = tuple(dict.fromkeys((*kept, *effect)))
    releases = load_releases(logs, arguments, printer)
    options = FitOptions(robust=robust, **signal_of(releases))
    odd = amplitude_warnings(releases, record)
    result = fit_joint(releases, record, names, options)
    named, frequency = ", ".join(str(log) for log in logs), result.law.frequency
    if not any_period:
        refuse_period(frequency, record, log=named)
    for warning in (*odd, *period_warnings(frequency, record, log=named), *result.warnings):
        printer.warn(warning)
    if result.nonsmooth and not profile:
        printer.note(
            "the intervals take the cost for smooth, but dry friction and stops put kinks into it: add --profile to "
            "walk along the cost itself"
        )
    require_usable(result)
    heldout = result.heldout_rmse()
    new = updated_board(record, result, {common.space.named(log): log for log in logs}, heldout=heldout)
    rungs = _ladder(releases, record, names, options, result, heldout)
    scene: Compensation | None = None
    if in_scene:
        from sim.compensation.scene import compensate_in_scene

        scene = compensate_in_scene(new)
        new = replace(new, fit={**new.fit, "in_scene": scene.entry()})
    _print(printer, record, new, result, rungs)
    intervals = show_intervals(result, record, common, printer, profile=profile, draws=bootstrap)
    for line in scene.lines() if scene else ():
        printer.say(line)
    picture = _draw(common, new, rungs, result)
    # Last: what fails or is broken off before leaves the record as it was.
    path = common.space.save_board(new, since=record)
    printer.say(f"written: {path}, {picture}")
    content = {**_to_json(new, result, heldout, rungs), **intervals}
    printer.result({**content, "in_scene": scene.entry()} if scene else content)
    return 0


def _ladder(
    releases: list[Release],
    board: Board,
    names: tuple[str, ...],
    options: "FitOptions",
    result: "JointFit",
    heldout: float,
) -> "list[Rung]":
    """Return the errors from the linear joint up, one effect more on each rung."""
    from reports.figures.ladder import Rung
    from sysid.fit_mjcf import fit_joint

    rungs: list[Rung] = []
    for count in range(len(names)):
        step = fit_joint(releases, board, names[:count], options)
        label = f"+ {names[count - 1]}" if count else "spring and\ndamper"
        rungs.append(Rung(label, step.rmse, step.heldout_rmse()))
    label = f"+ {names[-1]}" if names else "spring and\ndamper"
    return [*rungs, Rung(label, result.rmse, heldout)]


def _draw(common: Common, board: Board, rungs: "list[Rung]", result: "JointFit") -> Path:
    from reports.figures.ladder import ladder_figure

    path = common.space.outputs(board.name) / "ladder.png"
    unit = "rad/s" if result.records[0].is_rate else "rad"
    with atomic_path(path) as temporary:
        figure = ladder_figure(rungs, result.noise.std, f"{board.name}: what each effect takes away", unit)
        figure.savefig(temporary, dpi=140)
    return path


def _print(printer: Printer, old: Board, new: Board, result: "JointFit", rungs: "list[Rung]") -> None:
    scale, unit = (1.0, "rad/s") if result.records[0].is_rate else (float(np.degrees(1.0)), "°")
    printer.say(
        f"{new.name} · {len(result.records)} release(s) · {result.status} · noise floor "
        f"{scale * result.noise.std:.3g}{unit} ({result.noise.how})"
    )
    before: dict[str, Any] = {**{n: q for n, q in old.tilt.items() if n != "range"}}
    before.update({f"{p.name}.{n}": q for p in old.effects for n, q in p.parameters.items()})
    rows = [(name, str(before.get(name, "-")), str(quantity)) for name, quantity in result.quantities.items()]
    printer.table(("quantity", "before", "after ± 95 %"), rows)
    printer.table(
        ("model", "error", "held out", "error / noise"),
        [
            (
                rung.label.replace("\n", " "),
                f"{scale * rung.rmse:.4g}{unit}",
                f"{scale * rung.heldout:.4g}{unit}",
                f"{rung.rmse / result.noise.std:.3f}",
            )
            for rung in rungs
        ],
    )
    printer.say(f"record as it stood: error {scale * new.history[-1]['rmse_before']:.4g}{unit}")


def _to_json(board: Board, result: "JointFit", heldout: float, rungs: "list[Rung]") -> dict[str, Any]:
    is_rate = result.records[0].is_rate
    # An error of a measured rate, as the amplitude of a swing at the joint's frequency that has that rate.
    per = 1.0 / result.law.frequency if is_rate else 1.0
    return {
        "board": board.name,
        "effects": [name for name, _ in result.law.effects],
        "inertia": board.inertia.to_json(),
        "parameters": {name: quantity.to_json() for name, quantity in result.quantities.items()},
        "correlation": {
            "names": list(result.quantities),
            "matrix": np.nan_to_num(result.correlation).tolist(),
        },
        "rmse_rad": per * result.rmse,
        "nrmse": result.nrmse,
        "heldout_rmse_rad": per * heldout,
        "noise_floor_rad": per * result.noise.std,
        "signal": "rate" if is_rate else "roll",
        "rmse_before_rad": per * board.history[-1]["rmse_before"],
        "ladder": [
            {
                "model": r.label.replace("\n", " "),
                "rmse_rad": per * r.rmse,
                "heldout_rmse_rad": per * r.heldout,
            }
            for r in rungs
        ],
        "status": result.status,
        "warnings": list(result.warnings),
    }
