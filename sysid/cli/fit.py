"""`husky-sysid fit`: fit the tilt joint to logs, and save it in its record."""

import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from sysid.board import Board
from sysid.cli.console import FIT, Common, FitFlag, FitTexts, Output, Printer
from sysid.cli.drive_options import DriveArguments
from sysid.cli.fit_intervals import show_intervals
from sysid.cli.log_options import LogArguments, load_recordings, space_of
from sysid.cli.parameter_options import SHORT, parse_bounds, parse_fixed
from sysid.cli.subject import Subject
from sysid.errors import SysidError
from sysid.files import (
    refuse_other_kind,
    refuse_overwriting,
    require_writable,
    write_atomically,
    write_figure,
)

if TYPE_CHECKING:
    from sim.compensation.step import Compensation
    from sysid.fit_mjcf import Fit


def fit(
    logs: list[Path],
    /,
    *,
    subject: Subject = Subject(),
    effect: FitTexts = (),
    fix: FitTexts = (),
    bound: FitTexts = (),
    prior: FitTexts = (),
    plain: FitFlag = False,
    in_scene: FitFlag = False,
    profile: FitFlag = False,
    bootstrap: Annotated[int, Parameter(group=FIT)] = 0,
    any_period: FitFlag = False,
    output: Output | None = None,
    drive: DriveArguments = DriveArguments(),
    arguments: LogArguments = LogArguments(),
    common: Common = Common(),
) -> int:
    """Fit stiffness, damping and effects to logs, and save the board.

    The roll inertia is that of the record: a free decay alone fixes only k/I, d/I and torque/I.

    Args:
        logs: Logs of one board.
        effect: Effect to add to those of the record; repeat it for several.
        fix: Hold a parameter, as NAME=VALUE in SI units: stiffness, damping, rest, or EFFECT.PARAMETER; repeat it for
            several.
        bound: Keep a parameter within NAME=LOW:HIGH.
        prior: Use the record's value and standard deviation of a parameter as a prior; repeat it for several.
        plain: Drop the effects of the record.
        in_scene: Compensate the training scene too, so that it decays like the board. It has implicitfast at 5 ms,
            wheels on the ground, and equality coupling.
        profile: Compute profile-likelihood intervals too; they may be asymmetric.
        bootstrap: Number of logs to resample from the residuals (block bootstrap) and to fit; 400 is a good number.
        output: The patched copy of a model; MODEL_JOINT.xml beside it if left out. A board has none.
        any_period: Accept a natural period above 100 s or below 1 ms. Without it, such a period is a wrong unit of time.
    """
    if drive.given:
        from sysid.cli.driven import driven_fit, run_driven

        run = partial(
            driven_fit,
            effects=effect,
            fix=fix,
            bound=bound,
            plain=plain,
            output=output,
            motion=drive.next_motion,
        )
        return run_driven("fit", run, logs, subject, drive, arguments, common)
    from sysid.cli.bars import working
    from sysid.fit_mjcf import fit as fit_recordings
    from sysid.fitting.joint import check_effects, prior_in_words
    from sysid.fitting.result import TOLERANCE
    from sysid.progress import stage

    printer = Printer(common)
    record = subject.load(common, printer)
    copy = _copy_of(record, output, common)
    require_writable(common.space.boards / f"{record.name}.toml")
    effect = (*effect, *(name for name in common.own_effects() if name not in effect))
    check_effects(effect, [part.name for part in record.effects])
    fixed, bounds = parse_fixed(fix), parse_bounds(bound)
    if bootstrap:
        from sysid.fitting.bootstrap import require_enough

        require_enough(bootstrap)
    logs, setups = subject.logs(logs)
    record, recordings = subject.posed(
        record, load_recordings(logs, arguments, printer, rest=record.rest_angle), setups
    )
    with working(printer), stage(0.0, 1.0, "fitting"):
        result = fit_recordings(
            recordings,
            record,
            effect,
            plain=plain,
            fixed=fixed,
            bounds=bounds,
            priors=[SHORT.get(name, name) for name in prior],
            any_period=any_period,
        )
    for name, known in result.joint.problem.priors.items():
        printer.note(prior_in_words(record, name, known))
    printer.warnings(result.warnings, recordings)
    if copy is not None:
        from sim.model.soft_friction import soft_friction_warning

        printer.warnings(soft_friction_warning(result.joint, slides=record.slides))
    if result.joint.nonsmooth and not profile:
        printer.note(
            "With friction or stops the intervals may be asymmetric; --profile computes them exactly."
        )
    scene: Compensation | None = None
    with working(printer):
        with stage(0.0, 0.3, "held-out error"):
            new = result.updated_board({common.space.named(log): log for log in logs})
        if read := space_of(common, arguments).reading:
            new = replace(new, fit={**new.fit, "reading": shlex.join(read)})
        if in_scene:
            from sim.compensation.scene import compensate_in_scene

            with stage(0.3, 0.6, "in the scene"):
                scene = compensate_in_scene(new)
            new = replace(new, fit={**new.fit, "in_scene": scene.entry()})
        with stage(0.6, 1.0, "simpler models"):
            text = result.report(printer.width)
    printer.say(text)
    intervals = show_intervals(result.joint, record, common, printer, profile=profile, draws=bootstrap)
    for line in scene.lines() if scene else ():
        printer.say(line)
    missing = result.joint.excess > TOLERANCE
    verb, why = ("diagnose", "find the missing effect") if missing else ("check", "check it in MuJoCo")
    command = space_of(common, arguments).command(verb, *record.options, logs=logs)
    printer.say(f"next: {why}: {command}")
    written = [_draw(common, result)]
    if result.joint.problem.smoothing:
        written.append(_draw_learned(common, result))
    if result.formula is not None and result.formula.good and not result.formula.effects:
        written.append(_offer(common, result, printer))
    unwritten: SysidError | None = None
    if copy is not None:
        new, copies, unwritten = _patched(new, copy, printer)
        written += copies
    # The record is saved last: a failure before leaves it unchanged.
    written.insert(0, subject.save(new, record, common))
    printer.written(*written)
    content = {**result.to_json(), **intervals}
    printer.result({**content, "in_scene": scene.entry()} if scene else content)
    if unwritten is not None:
        raise unwritten
    return 0


def _offer(common: Common, result: "Fit", printer: Printer) -> Path:
    """Write the learned formula as an effect of its own."""
    assert result.formula is not None
    name, source = result.formula.own_effect()
    path = common.space.outputs(result.before.name) / f"{name.replace('-', '_')}.py"
    write_atomically(path, source)
    printer.say(f"the formula as an effect of its own: --plain --effect-file {path}")
    return path


def _copy_of(record: Board, output: Path | None, common: Common) -> Path | None:
    """Return the path of the patched copy of a record's model, None without a model.

    Raises:
        SysidError: The joint's text cannot be patched, or the copy cannot be written.
    """
    if not record.model:
        if output is not None:
            refuse_other_kind(output, ".xml")
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

    Raises:
        SysidError: A fitted number is not physical, or MuJoCo has no element for an effect.
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


def _draw_learned(common: Common, result: "Fit") -> Path:
    from reports.figures.learned import learned_figure

    title = f"{result.before.name}: {result.formula.text if result.formula else 'no torque was learned'}"
    figure = learned_figure(result.joint, result.formula, title, slides=result.before.slides)
    return write_figure(common.space.outputs(result.before.name) / "learned.png", figure)


def _draw(common: Common, result: "Fit") -> Path:
    from reports.figures.ladder import fit_steps, ladder_figure

    name = result.before.name
    noise = (result.noise.lowest / result.noise.std, result.noise.highest / result.noise.std)
    figure = ladder_figure(
        fit_steps(result), noise, f"{name}: errors of the models", len(result.joint.records)
    )
    return write_figure(common.space.outputs(name) / "ladder.png", figure)
