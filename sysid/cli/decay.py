"""`husky-sysid decay`: stiffness and damping of a joint from its log."""

from pathlib import Path

from sysid.cli.console import Drawn, Printer
from sysid.cli.log_options import load_roll, recording_of, refuse_overwriting_logs
from sysid.cli.measurement import Measurement
from sysid.files import require_writable, write_figure, write_json
from sysid.recording import refuse_duplicates


def decay(
    logs: list[Path],
    /,
    *,
    measurement: Measurement = Measurement(),
    picture: Drawn = True,
) -> None:
    """Identify a joint from its free decays.

    Args:
        logs: CSV, Parquet, MCAP, phone exports (zip or folder) or videos of one joint.
        measurement: Joint and reading of its logs. The record gives the inertia; without it there is no stiffness and no
            damping, and only the file of --json is written.
    """
    from sysid.free_decay import fit_decay

    common, reading = measurement.common, measurement.reading
    printer = Printer(common)
    refuse_overwriting_logs(logs, reading, printer)
    record = measurement.subject.find(common, printer)
    folder = None if record is None else common.space.outputs(record.name)
    if folder is not None:
        require_writable(folder / "decay.json")
    refuse_duplicates(logs)
    rest = record.rest_angle if record else 0.0
    recordings = [recording_of(load_roll(log, reading, printer), reading, printer, rest=rest) for log in logs]
    result = fit_decay(recordings, board=record)
    printer.warnings(result.warnings, recordings)
    printer.say(result.report(printer.width))
    why, verb = (
        ("compare the model with it", "compare") if result.linear else ("find the missing effect", "diagnose")
    )
    if result.linear and (record is None or record.is_unmeasured):
        why, verb = "save it in a record", "fit"
    options = ("--board", "NAME") if record is None else record.options
    made = " (`new NAME` writes the record for it)" if record is None else ""
    printer.say(f"next: {why}: {measurement.space.command(verb, *options, logs=logs)}{made}")
    written: list[Path] = []
    if folder is not None:
        written.append(folder / "decay.json")
        write_json(written[0], result.to_json())
    if folder is not None and picture:
        from reports.figures.decay import decay_figure

        names = ", ".join(recording.path.name for recording in recordings)
        rolls = [recording.roll for recording in recordings]
        figure = decay_figure(rolls, result, f"{result.board}: free decay in {names}")
        written.append(write_figure(folder / "decay.png", figure))
    printer.result(result.to_json(), *written)
