"""`husky-sysid diagnose`: the missing effect of a model."""

from functools import partial
from pathlib import Path

from sysid.cli.console import Common, FitTexts, Printer
from sysid.cli.drive_options import DriveArguments
from sysid.cli.log_options import LogArguments, load_recordings, space_of
from sysid.cli.parameter_options import parse_fixed
from sysid.cli.subject import Subject
from sysid.cli.view import logs_or_fitted
from sysid.files import require_writable, write_figure, write_json


def diagnose(
    logs: tuple[Path, ...] = (),
    /,
    *,
    subject: Subject = Subject(),
    fix: FitTexts = (),
    drive: DriveArguments = DriveArguments(),
    arguments: LogArguments = LogArguments(),
    common: Common = Common(),
) -> int:
    """Name the missing physical effects, or report that the model is complete.

    Writes diagnose.json, for the report, and diagnose.png into reports/BOARD of the workspace.

    Args:
        logs: Logs of one joint, with several releases in all; those of its record's fit, if left out.
        fix: Hold a parameter in every model, as NAME=VALUE in SI units; stiffness=0 for a pendulum with gravity in its
            record. Repeat it for several.
    """
    if drive.given:
        from sysid.cli.driven import driven_diagnose, run_driven

        run = partial(driven_diagnose, fix=fix)
        return run_driven("diagnose", run, logs, subject, drive, arguments, common)
    from reports.figures.story import story_figure
    from reports.story import for_report, story_of_diagnosis
    from sysid.cli.bars import told_bar
    from sysid.diagnosis.diagnose import diagnose as search
    from sysid.diagnosis.report import headline
    from sysid.fitting.joint import prior_in_words

    printer = Printer(common)
    record = subject.load(common, printer)
    folder = common.space.outputs(record.name)
    require_writable(folder / "diagnose.json")
    found, arguments = logs_or_fitted(record, logs, arguments, printer)
    each, setups = subject.logs(found)
    record, recordings = subject.posed(
        record, load_recordings(each, arguments, printer, rest=record.rest_angle), setups
    )
    with told_bar(printer) as progress:
        result = search(recordings, record, fixed=parse_fixed(fix), progress=progress)
    for name, prior in result.baseline.fit.problem.priors.items():
        printer.note(prior_in_words(record, name, prior))
    printer.warnings(result.warnings, recordings)
    printer.say(result.report(printer.width, space_of(common, arguments), found))
    content = result.to_json()
    write_json(folder / "diagnose.json", {**content, **for_report(result, record)})
    picture = story_figure(story_of_diagnosis(result, record), f"{record.name}: {headline(result)}")
    write_figure(folder / "diagnose.png", picture, dpi=110)
    printer.written(folder / "diagnose.json", folder / "diagnose.png")
    printer.result(content)
    return 0
