"""`husky-sysid view`: a joint beside its logs, in Rerun."""

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.cli.console import Output, Printer
from sysid.cli.measurement import MeasuredLogs, Measurement, read_logs

if TYPE_CHECKING:
    from reports.evidence import Evidence


def view(
    *logs: Path,
    measurement: Measurement = Measurement(),
    output: Output | None = None,
) -> None:
    """Show logs and model of a joint in Rerun.

    Args:
        logs: Logs of the joint; those of its record's fit, if left out.
        output: Write the recording here, and do not open it.
    """
    printer = Printer(measurement.common)
    found = read_logs(measurement, logs, printer, outputs={"--output": output}, films=True)
    path = output or found.space.outputs(found.record.name) / "view.rrd"
    evidence = write_recording(path, found, printer)
    printer.result(
        {"board": found.record.name, "recording": str(path), "rmse_rad": evidence.comparison.rmse}, path
    )
    if output is None:
        # Its own process, so that the window stays when this command has ended.
        subprocess.Popen(
            [sys.executable, "-m", "rerun", str(path)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )


def write_recording(
    path: Path, found: MeasuredLogs, printer: Printer, *, tolerance: float = 0.02
) -> "Evidence":
    """Compare a joint with its logs and write the recording of it."""
    from reports.evidence import gather
    from reports.page.summary import board_summary
    from reports.rerun.decay import comparison_recording
    from reports.rerun.stream import need_rerun
    from sysid.cli.bars import working

    need_rerun()
    with working(printer):
        evidence = gather(
            found.record, found.recordings, files=found.files, tolerance=tolerance, heldout=False
        )
    films = [
        found.films[recording.roll.log].aligned(recording.releases[0].start)
        for recording in found.recordings
        if recording.roll.log in found.films
    ]
    comparison_recording(path, evidence, board_summary(evidence), films)
    return evidence
