"""`husky-sysid compare`: the error of the simulation, and its location."""

from functools import partial
from pathlib import Path

from sysid.cli.console import Drawn, Made, Printer, Tolerance
from sysid.cli.measurement import DriveMeasurement, read_logs
from sysid.cli.view import write_recording
from sysid.files import require_writable, write_figure, write_json


def compare(
    logs: tuple[Path, ...] = (),
    /,
    *,
    measurement: DriveMeasurement = DriveMeasurement(),
    tolerance: Tolerance = 0.02,
    picture: Drawn = True,
    rerun: Made | None = None,
) -> None:
    """Compare the joint's simulated decay with measured ones: how far off, and where.

    Args:
        logs: Logs of one joint; those of its record's fit, if left out.
        rerun: Write a Rerun recording (.rrd) here.
    """
    from sysid.cli.bars import working
    from sysid.comparison.compare import compare as compare_recordings

    if measurement.drive.given:
        from sysid.cli.driven import driven_replay, run_driven

        run_driven("compare", partial(driven_replay, tolerance=tolerance, gate=False), logs, measurement)
        return
    printer = Printer(measurement.common)
    record = measurement.load(printer)
    folder = measurement.space.outputs(record.name)
    require_writable(folder / "compare.json")
    found = read_logs(measurement, logs, printer, record=record, outputs={"--rerun": rerun})
    with working(printer, "comparing"):
        result = compare_recordings(found.recordings, found.record, tolerance=tolerance)
    printer.warnings(result.warnings, found.recordings)
    content = result.to_json()
    write_json(folder / "compare.json", content)
    written = [folder / "compare.json"]
    if picture:
        from reports.figures.compare import compare_figure

        names = ", ".join(recording.path.name for recording in found.recordings)
        figure = compare_figure(result, f"{record.name}: simulated against {names}")
        written.append(write_figure(folder / "compare.png", figure))
    if rerun is not None:
        write_recording(rerun, found, result)
        written.append(rerun)
    printer.say(result.report(printer.width))
    why, verb = ("check it in MuJoCo", "check") if result.passed else ("find the missing effect", "diagnose")
    printer.say(found.next_step(why, verb))
    printer.result(content, *written)
