"""`husky-sysid fit`: fit a joint to logs, and save it in its record."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from sysid.board import Board
from sysid.cli.console import FIT, Common, Fix, Output, Printer, Texts
from sysid.cli.drive_options import DRIVE
from sysid.cli.measurement import DriveMeasurement, MeasuredLogs, read_logs
from sysid.cli.parameter_options import SHORT, parse_bounds, parse_fixed
from sysid.errors import SysidError, UsageError
from sysid.files import (
    refuse_other_kind,
    refuse_overwriting,
    require_writable,
    write_atomically,
    write_figure,
)

if TYPE_CHECKING:
    from sysid.fit_mjcf import Fit
    from sysid.fitting.result import JointFit


@Parameter(name="*", group=FIT)
@dataclass(frozen=True, kw_only=True)
class FitArguments:
    """The model of a fit, and its intervals."""

    effect: Texts = ()
    """Effect to add to those of the record; repeat it for several."""
    fix: Fix = ()
    bound: Texts = ()
    """Keep a parameter within NAME=LOW:HIGH."""
    prior: Texts = ()
    """Use the record's value and standard deviation of a parameter as a prior; repeat it for several."""
    plain: bool = False
    """Drop the effects of the record."""
    profile: bool = False
    """Compute profile-likelihood intervals too; they may be asymmetric."""
    bootstrap: int = 0
    """Number of logs to resample from the residuals (block bootstrap) and to fit; 400 is a good number."""
    any_period: bool = False
    """Accept a natural period above 100 s or below 1 ms. Without it, such a period is a wrong unit of time."""
    next_motion: Annotated[Path | None, Parameter(group=DRIVE)] = None
    """Write the next motion for the robot to this CSV file: the one that narrows the widest interval most."""


def fit(
    logs: list[Path],
    /,
    *,
    measurement: DriveMeasurement = DriveMeasurement(),
    model: FitArguments = FitArguments(),
    output: Output | None = None,
) -> None:
    """Fit stiffness, damping and effects to logs, and save the record.

    Args:
        logs: Logs of one joint.
        output: The patched copy of a model; MODEL_JOINT.xml beside it if left out. A board has none.
    """
    from sysid.fitting.result import TOLERANCE

    if measurement.drive.given:
        from sysid.cli.driven import driven_fit, run_driven

        run_driven("fit", partial(driven_fit, model=model, output=output), logs, measurement)
        return
    common = measurement.common
    printer = Printer(common)
    record = measurement.load(printer)
    copy = _copy_of(record, output, common)
    require_writable(common.space.boards / f"{record.name}.toml")
    found, result = _fitted(logs, record, measurement, model, printer)
    if copy is not None:
        from sim.model.soft_friction import soft_friction_warning

        printer.warnings(soft_friction_warning(result.joint, slides=record.slides))
    new, text = _described(result, found, printer)
    printer.say(text)
    intervals = _intervals(result.joint, found.record, model, printer)
    written = _drawn(common, result, printer)
    unwritten: SysidError | None = None
    if copy is not None:
        new, copies, unwritten = _patched(new, copy, printer)
        written += copies
    if result.joint.excess > TOLERANCE:
        printer.say(found.next_step("find the missing effect", "diagnose"))
    else:
        printer.say(replace(found, record=new).next_step("check it in MuJoCo", "check"))
    # The record is saved last: a failure before leaves it unchanged.
    printer.written(measurement.subject.save(new, found.record, common), *written)
    printer.result({**result.to_json(), **intervals})
    if unwritten is not None:
        raise unwritten


def _fitted(
    logs: Sequence[Path], record: Board, measurement: DriveMeasurement, model: FitArguments, printer: Printer
) -> "tuple[MeasuredLogs, Fit]":
    """Read the logs and fit the joint; print notes and warnings."""
    from sysid.cli.bars import working
    from sysid.fit_mjcf import fit as fit_recordings
    from sysid.fitting.bootstrap import require_enough
    from sysid.fitting.joint import check_effects, prior_in_words

    own = (name for name in measurement.common.own_effects() if name not in model.effect)
    effects = (*model.effect, *own)
    check_effects(effects, [part.name for part in record.effects])
    fixed, bounds = parse_fixed(model.fix), parse_bounds(model.bound)
    if model.bootstrap:
        require_enough(model.bootstrap)
    found = read_logs(measurement, logs, printer, record=record)
    with working(printer, "fitting"):
        result = fit_recordings(
            found.recordings,
            found.record,
            effects,
            plain=model.plain,
            fixed=fixed,
            bounds=bounds,
            priors=[SHORT.get(name, name) for name in model.prior],
            any_period=model.any_period,
        )
    for name, known in result.joint.problem.priors.items():
        printer.note(prior_in_words(found.record, name, known))
    printer.warnings(result.warnings, found.recordings)
    if result.joint.nonsmooth and not model.profile:
        printer.note(
            "With friction or stops the intervals may be asymmetric; --profile computes them exactly."
        )
    return found, result


def _described(result: "Fit", found: MeasuredLogs, printer: Printer) -> tuple[Board, str]:
    """Return the new record, and the report."""
    from sysid.cli.bars import working
    from sysid.progress import stage

    with working(printer):
        with stage(0.0, 0.5, "held-out error"):
            logs = [file.found for file in found.files if file.found]
            new = result.updated_board({found.space.named(log): log for log in logs})
        if read := found.space.reading:
            new = replace(new, fit={**new.fit, "reading": shlex.join(read)})
        with stage(0.5, 1.0, "simpler models"):
            text = result.report(printer.width)
    return new, text


def _intervals(fit: "JointFit", board: Board, model: FitArguments, printer: Printer) -> dict[str, Any]:
    """Compute, print and draw profiles and a bootstrap, if asked for; return their intervals for the JSON."""
    if not model.profile and not model.bootstrap:
        return {}
    from reports.figures.intervals import interval_figure
    from sysid.cli.bars import working
    from sysid.fitting.bootstrap import bootstrap
    from sysid.fitting.intervals import agreements
    from sysid.fitting.profile import profiles
    from sysid.fitting.report import interval_json, interval_report
    from sysid.progress import stage

    half = 0.5 if model.profile and model.bootstrap else float(model.profile)
    with working(printer):
        with stage(0.0, half, "profiles"):
            shapes = list(profiles(fit, board)) if model.profile else []
        with stage(half, 1.0, "bootstrap"):
            again = bootstrap(fit, board, model.bootstrap) if model.bootstrap else None
    verdicts = agreements(fit.quantities, shapes, again)
    printer.say(interval_report(fit, shapes, again, verdicts, printer.width))
    title = f"{board.name}: range of each parameter while the others follow"
    figure = interval_figure(fit.quantities, shapes, again, title)
    printer.written(write_figure(printer.common.space.outputs(board.name) / "intervals.png", figure))
    return interval_json(shapes, again, verdicts)


def _drawn(common: Common, result: "Fit", printer: Printer) -> list[Path]:
    """Write the ladder, and of a learned torque its picture and its formula as an effect."""
    from reports.figures.ladder import ladder_figure

    name, formula = result.before.name, result.formula
    folder = common.space.outputs(name)
    written = [write_figure(folder / "ladder.png", ladder_figure(result, f"{name}: errors of the models"))]
    if result.joint.problem.smoothing:
        from reports.figures.learned import learned_figure

        title = f"{name}: {formula.text if formula else 'no torque was learned'}"
        figure = learned_figure(result.joint, formula, title, slides=result.before.slides)
        written.append(write_figure(folder / "learned.png", figure))
    if formula is not None and formula.good and not formula.effects:
        effect, source = formula.own_effect()
        path = folder / f"{effect.replace('-', '_')}.py"
        write_atomically(path, source)
        printer.say(f"the formula as an effect of its own: --plain --effect-file {path}")
        written.append(path)
    return written


def _copy_of(record: Board, output: Path | None, common: Common) -> Path | None:
    """Return the path of the patched copy of a record's model, None without a model."""
    if not record.model:
        if output is not None:
            raise UsageError(
                f"--output {output}: '{record.name}' has no model to patch. Leave it out; `mjcf` writes the fitted board."
            )
        return None
    from sim.model.patch import copy_path, require_patchable
    from sim.model.setup import Setup

    setup = Setup.of_entry(record.model)
    require_patchable(setup)
    if output is not None:
        refuse_other_kind(output, setup.file.suffix)
    copy = output or copy_path(setup, record.name, common.space.outputs(record.name))
    refuse_overwriting([setup.file], {"--output": copy})
    require_writable(copy)
    return copy


def _patched(record: Board, copy: Path, printer: Printer) -> tuple[Board, list[Path], SysidError | None]:
    """Write the fitted joint into a copy of its model.

    Returns:
        The record with the copy as its model; the written files; an error if the copy does not load.
    """
    from sim.model.patch import patch
    from sim.model.setup import Setup

    made = patch(Setup.of_entry(record.model), record)
    refuse_overwriting(list(made.files), {"--output": copy})
    for line in made.remarks:
        printer.note(line)
    printer.say(made.diff.rstrip())
    try:
        copies = made.save(copy)
    except SysidError as error:
        return record, [], error
    return replace(record, model={**record.model, "file": str(copy)}), copies, None
