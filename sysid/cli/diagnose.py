"""`husky-sysid diagnose`: the missing effect of a model."""

from functools import partial
from pathlib import Path

from sysid.cli.console import Fix, Printer
from sysid.cli.measurement import DriveMeasurement, read_logs
from sysid.cli.parameter_options import parse_fixed
from sysid.files import require_writable, write_figure, write_json


def diagnose(
    logs: tuple[Path, ...] = (),
    /,
    *,
    measurement: DriveMeasurement = DriveMeasurement(),
    fix: Fix = (),
) -> None:
    """Name the missing physical effects, or report that the model is complete.

    Args:
        logs: Logs of one joint, with several releases in all; those of its record's fit, if left out.
    """
    if measurement.drive.given:
        from sysid.cli.driven import driven_diagnose, run_driven

        run_driven("diagnose", partial(driven_diagnose, fix=fix), logs, measurement)
        return
    from reports.figures.story import story_figure
    from reports.story import for_report, story_of_diagnosis
    from sysid.cli.bars import told_bar
    from sysid.diagnosis.diagnose import diagnose as search
    from sysid.diagnosis.report import headline, without_hand
    from sysid.fitting.joint import prior_in_words

    printer, fixed = Printer(measurement.common), parse_fixed(fix)
    record = measurement.load(printer)
    folder = measurement.space.outputs(record.name)
    require_writable(folder / "diagnose.json")
    found = read_logs(measurement, logs, printer, record=record)
    record = found.record
    with told_bar(printer) as progress:
        result = search(found.recordings, record, fixed=fixed, progress=progress)
    for name, prior in result.baseline.fit.problem.priors.items():
        printer.note(prior_in_words(record, name, prior))
    printer.warnings(result.warnings, found.recordings)
    printer.say(result.report(printer.width, found.space, found.paths))
    content = result.to_json()
    if content["verdict"]["status"] == "none-missing":
        why, verb = ("check it in MuJoCo", "check") if record.fit else ("fit stiffness and damping", "fit")
        printer.say(found.next_step(why, verb, *without_hand(result)))
    write_json(folder / "diagnose.json", {**content, **for_report(result, record)})
    picture = story_figure(story_of_diagnosis(result, record), f"{record.name}: {headline(result)}")
    write_figure(folder / "diagnose.png", picture, dpi=110)
    printer.result(content, folder / "diagnose.json", folder / "diagnose.png")
