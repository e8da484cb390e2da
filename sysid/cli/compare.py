"""`husky-sysid compare`: the error of the simulation, and its location."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from sysid.cli.console import OUTPUT, Common, Made, Printer, require_share
from sysid.cli.drive_options import DriveArguments
from sysid.cli.log_options import LogArguments, refuse_overwriting_logs, space_of
from sysid.cli.subject import Subject
from sysid.cli.view import logs_or_fitted, read_logs, write_recording
from sysid.files import require_writable, write_figure, write_json


def compare(
    logs: tuple[Path, ...] = (),
    /,
    *,
    subject: Subject = Subject(),
    tolerance: float = 0.02,
    picture: Annotated[bool, Parameter(group=OUTPUT)] = True,
    rerun: Made | None = None,
    drive: DriveArguments = DriveArguments(),
    arguments: LogArguments = LogArguments(),
    common: Common = Common(),
) -> int:
    """Compare the board's simulated decay with measured ones: how far off, and where.

    Each release is simulated from its own start. The error without the sensor noise is located in time, amplitude,
    velocity, side and phase. Writes compare.json and compare.png into reports/BOARD of the workspace.

    Args:
        logs: Logs of one joint; those of its record's fit, if left out.
        tolerance: Largest error beyond the noise, over the RMS motion, of a comparison that passes.
        picture: Draw compare.png.
        rerun: Write a Rerun recording (.rrd) here.
    """
    from reports.evidence import find_logs
    from sysid.cli.bars import working
    from sysid.comparison.compare import compare as compare_recordings
    from sysid.progress import stage

    require_share("--tolerance", tolerance)
    if drive.given:
        from sysid.cli.driven import driven_compare, run_driven

        run = partial(driven_compare, tolerance=tolerance)
        return run_driven("compare", run, logs, subject, drive, arguments, common)
    printer = Printer(common)
    refuse_overwriting_logs(logs, arguments, printer, {"--rerun": rerun})
    record = subject.load(common, printer)
    folder = common.space.outputs(record.name)
    require_writable(folder / "compare.json")
    given, arguments = logs_or_fitted(record, logs, arguments, printer)
    each, setups = subject.logs(given)
    files = find_logs(record, each, common.space)
    material = read_logs(files, arguments, printer, films=rerun is not None, rest=record.rest_angle)
    record, recordings = subject.posed(record, list(material.recordings), setups)
    material = replace(material, recordings=tuple(recordings))
    with working(printer), stage(0.0, 1.0, "comparing"):
        result = compare_recordings(material.recordings, record, tolerance=tolerance)
    printer.warnings(result.warnings, material.recordings)
    content = result.to_json()
    write_json(folder / "compare.json", content)
    written = [folder / "compare.json"]
    if picture:
        from reports.figures.compare import compare_figure

        names = ", ".join(log.name for log in each)
        figure = compare_figure(result, f"{record.name}: simulated against {names}")
        written.append(write_figure(folder / "compare.png", figure))
    if rerun is not None:
        write_recording(rerun, record, files, material, printer, tolerance=tolerance)
        written.append(rerun)
    printer.say(result.report(printer.width))
    verb, why = ("check", "check it in MuJoCo") if result.passed else ("diagnose", "find the missing effect")
    command = space_of(common, arguments).command(verb, *record.options, logs=given)
    printer.say(f"next: {why}: {command}")
    printer.written(*written)
    printer.result(content)
    return 0
