"""`husky-sysid report`: all results of a joint in one HTML file."""

import shlex
import sys
from datetime import date
from pathlib import Path

from sysid.cli.console import Output, Printer, Tolerance
from sysid.cli.measurement import Measurement, read_logs
from sysid.errors import UsageError
from sysid.files import refuse_other_kind, write_atomically


def report(
    *logs: Path,
    measurement: Measurement = Measurement(),
    output: Output | None = None,
    tolerance: Tolerance = 0.02,
) -> None:
    """Write one HTML file with all results of a joint.

    Args:
        logs: Logs of the joint; those of its record's fit, by their recorded paths, if left out.
        output: File to write; reports/BOARD/report.html of the workspace if left out.
    """
    from reports.evidence import gather, last_diagnosis
    from reports.page.board import Provenance, board_report
    from sysid.cli.bars import working
    from sysid.progress import stage

    printer = Printer(measurement.common)
    if output is not None and output.suffix.lower() not in (".html", ".htm") and not output.exists():
        raise UsageError(f"--output {output}: a report is an HTML file; name it .html.")
    found = read_logs(measurement, logs, printer, outputs={"--output": output}, may_be_gone=True)
    if output is not None:
        refuse_other_kind(output, ".html", ".htm")
    record, files, space, model = found.record, found.files, found.space, measurement.subject.model
    source = model or space.board_path(record.name)
    if model is None:
        own = source.is_relative_to(space.root)
        source = source.relative_to(space.root) if own else f"{source.name}, as shipped with the tool"
    provenance = Provenance(
        command=shlex.join(["husky-sysid", *sys.argv[1:]]), space=space, made=date.today().isoformat(), record=str(source),
    )  # fmt: skip
    diagnosis = last_diagnosis(record, space)
    evidence = None
    with working(printer):
        if found.recordings:
            stood = space.first(record.name)
            with stage(0.0, 0.6):
                evidence = gather(record, found.recordings, files=files, tolerance=tolerance, stood=stood)
        with stage(0.6, 1.0, "drawing"):
            page = board_report(record, evidence, files, provenance, diagnosis)
    path = output or space.outputs(record.name) / "report.html"
    write_atomically(path, page)
    shown = [file.path for file in files if file.found]
    printer.result({"board": record.name, "report": path, "logs": shown}, path)
