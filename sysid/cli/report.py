"""`husky-sysid report`: all results of a board in one HTML file."""

import shlex
import sys
from datetime import date
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from sysid.cli.console import OUTPUT, Common, Output, Printer
from sysid.cli.log_options import LogArguments, as_fitted, space_of
from sysid.cli.subject import Subject
from sysid.cli.view import logs_of, no_logs, read_logs
from sysid.errors import SysidError
from sysid.files import refuse_other_kind, write_atomically, write_figure


def report(
    *logs: Path,
    subject: Subject = Subject(),
    output: Output | None = None,
    one_page: Annotated[bool, Parameter(negative="", group=OUTPUT)] = False,
    tolerance: float = 0.02,
    arguments: LogArguments = LogArguments(),
    common: Common = Common(),
) -> int:
    """Write one HTML file with all results of a board.

    The file needs no network.

    Args:
        logs: Logs of the board; those of its record's fit, by their recorded paths, if left out.
        output: File to write; reports/BOARD/report.html of the workspace if left out.
        one_page: Write one page as PDF and PNG too.
        tolerance: Largest error beyond the noise, over the RMS motion, of a comparison that passes.
    """
    from reports.evidence import gather, last_diagnosis
    from reports.page.board import Provenance, board_report
    from sysid.cli.bars import working
    from sysid.progress import stage

    printer = Printer(common)
    record = subject.load(common, printer)
    arguments = as_fitted(record, logs, arguments, printer)
    space = space_of(common, arguments)
    files = logs_of(record, logs, arguments, printer, output)
    if output is not None:
        refuse_other_kind(output, ".html", ".htm")
    material = read_logs(files, arguments, printer, rest=record.rest_angle)
    provenance = Provenance(
        command=shlex.join(["husky-sysid", *sys.argv[1:]]),
        space=space,
        made=date.today().isoformat(),
        record=str(subject.model) if subject.model else _shown(space.board_path(record.name), space.root),
    )
    diagnosis = last_diagnosis(record, space)
    evidence = None
    with working(printer):
        if material.recordings:
            with stage(0.0, 0.6):
                evidence = gather(
                    record,
                    material.recordings,
                    files=files,
                    tolerance=tolerance,
                    stood=space.first(record.name),
                )
        with stage(0.6, 1.0, "drawing"):
            page = board_report(record, evidence, files, provenance, diagnosis)
    path = output or space.outputs(record.name) / "report.html"
    write_atomically(path, page)
    printer.say(f"written: {path} ({len(page.encode()) / 1e6:.2f} MB)")
    if one_page:
        if evidence is None:
            raise SysidError(no_logs(record, space))
        from reports.page.sheet import board_sheet

        sheet = board_sheet(evidence, files, provenance, diagnosis)
        for target in (path.with_suffix(".pdf"), path.with_suffix(".png")):
            printer.say(f"written: {write_figure(target, sheet, dpi=150)}")
    printer.result(
        {"board": record.name, "report": str(path), "logs": [file.path for file in files if file.found]}
    )
    return 0


def _shown(record: Path, root: Path) -> str:
    """Return a board record's path as seen from the workspace."""
    if record.is_relative_to(root):
        return str(record.relative_to(root))
    return f"{record.name}, as shipped with the tool"
