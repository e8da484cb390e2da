"""`husky-sysid view`: a joint beside its logs, in Rerun."""

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.cli.console import Output, Printer
from sysid.cli.measurement import MeasuredLogs, Measurement, read_logs

if TYPE_CHECKING:
    from sysid.comparison.compare import Comparison


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
    from sysid.cli.bars import working
    from sysid.comparison.compare import compare

    printer = Printer(measurement.common)
    found = read_logs(measurement, logs, printer, outputs={"--output": output})
    path = output or found.space.outputs(found.record.name) / "view.rrd"
    with working(printer, "comparing"):
        result = compare(found.recordings, found.record)
    write_recording(path, found, result)
    printer.result({"board": found.record.name, "recording": path, "rmse_rad": result.rmse}, path)
    if output is None:
        # Its own process, so that the window stays when this command has ended.
        subprocess.Popen(
            [sys.executable, "-m", "rerun", str(path)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )


def write_recording(path: Path, found: MeasuredLogs, result: "Comparison") -> None:
    """Write the recording of a joint that was compared with its logs."""
    from reports.page.summary import board_summary
    from reports.rerun.decay import comparison_recording

    summary = board_summary(found.record, found.files, result)
    comparison_recording(path, found.record, found.recordings, result, summary)
