"""`husky-sysid report`: everything known of a board in one HTML file."""

import shlex
import sys
from datetime import date
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from sysid.cli.console import OUTPUT, Common, Printer
from sysid.cli.log_options import LogArguments, refuse_overwriting_logs
from sysid.cli.subject import Subject
from sysid.cli.view import no_logs, read_logs
from sysid.errors import SysidError
from sysid.files import atomic_path, write_atomically

_NO_ARGUMENTS = LogArguments()
_NO_COMMON = Common()
_NO_SUBJECT = Subject()


def report(
    *logs: Path,
    subject: Subject = _NO_SUBJECT,
    output: Annotated[Path | None, Parameter(name=("--output", "-o"), group=OUTPUT)] = None,
    one_page: Annotated[bool, Parameter(name="--one-page", negative="", group=OUTPUT)] = False,
    tolerance: float = 0.02,
    arguments: LogArguments = _NO_ARGUMENTS,
    common: Common = _NO_COMMON,
) -> int:
    """Write one HTML file with everything known of a board.

    The file needs no network. It shows the logs that the record was fitted to, found again by their
    recorded path, or those given.

    Args:
        logs: Logs of the board; those that its record was fitted to, if left out.
        subject: Whose joint it is.
        output: File to write; reports/BOARD/report.html of the workspace if left out.
        one_page: Also write it on one page, as PDF and PNG beside the file.
        tolerance: Error beyond the noise, over the RMS motion, at which the comparison passes.
        arguments: How the logs are read.
        common: Options of every command.
    """
    from reports.evidence import find_logs, gather, last_diagnosis
    from reports.page.board import Provenance, board_report
    from sysid.cli.bars import working
    from sysid.progress import stage

    printer = Printer(common)
    space = common.space
    record = subject.load(common, printer)
    files = find_logs(record, logs, space)
    if not files:
        raise SysidError(no_logs(record))
    refuse_overwriting_logs(
        [file.found for file in files if file.found], arguments, printer, {"--output": output}
    )
    for file in files:
        if file.found is None:
            printer.warn(f"{file.path}: {file.state}")
    material = read_logs(files, arguments, printer)
    provenance = Provenance(
        command=shlex.join(["husky-sysid", *sys.argv[1:]]),
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
            raise SysidError(no_logs(record))
        from reports.page.sheet import board_sheet

        sheet = board_sheet(evidence, files, provenance, diagnosis)
        for target in (path.with_suffix(".pdf"), path.with_suffix(".png")):
            with atomic_path(target) as temporary:
                sheet.savefig(temporary, dpi=150)
            printer.say(f"written: {target}")
    printer.result(
        {"board": record.name, "report": str(path), "logs": [file.path for file in files if file.found]}
    )
    return 0


def _shown(record: Path, root: Path) -> str:
    """Return a board record's path as seen from the workspace."""
    if record.is_relative_to(root):
        return str(record.relative_to(root))
    return f"{record.name}, as shipped with the tool"
