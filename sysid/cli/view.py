"""`husky-sysid view`: a board beside its logs, in Rerun."""

import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.board import Board
from sysid.cli.console import Common, Output, Printer
from sysid.cli.log_options import (
    LogArguments,
    as_fitted,
    load_roll,
    reading,
    recording_of,
    refuse_overwriting_logs,
    say_notes,
    space_of,
)
from sysid.cli.subject import Subject
from sysid.errors import SysidError
from sysid.recording import Recording, refuse_duplicates
from sysid.video.options import is_film
from sysid.workspace import Workspace

if TYPE_CHECKING:
    from reports.evidence import Evidence, LogFile
    from reports.rerun.film_frames import FilmFrames


def view(
    *logs: Path,
    subject: Subject = Subject(),
    output: Output | None = None,
    arguments: LogArguments = LogArguments(),
    common: Common = Common(),
) -> int:
    """Show logs and model of a board in Rerun.

    Writes reports/BOARD/view.rrd of the workspace and opens it; with --output it is only written.

    Args:
        logs: Logs of the board; those of its record's fit, if left out.
        output: Write the recording here, and do not open it.
    """
    printer = Printer(common)
    record = subject.load(common, printer)
    arguments = as_fitted(record, logs, arguments, printer)
    files = logs_of(record, logs, arguments, printer, output)
    if not any(file.found for file in files):
        raise SysidError(no_logs(record, space_of(common, arguments)))
    path = output or common.space.outputs(record.name) / "view.rrd"
    material = read_logs(files, arguments, printer, films=True, rest=record.rest_angle)
    evidence = write_recording(path, record, files, material, printer)
    printer.say(f"written: {path}")
    printer.result({"board": record.name, "recording": str(path), "rmse_rad": evidence.comparison.rmse})
    if output is None:
        # Its own process, so that the window stays when this command has ended.
        subprocess.Popen(
            [sys.executable, "-m", "rerun", str(path)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    return 0


def logs_of(
    board: Board, logs: Sequence[Path], arguments: LogArguments, printer: Printer, output: Path | None
) -> "list[LogFile]":
    """Return the logs given, else those that a board was fitted to; say which of these are not there any more.

    Raises:
        SysidError: No log is known, or the output would overwrite one.
    """
    from reports.evidence import find_logs

    files = find_logs(board, logs, printer.common.space)
    if not files:
        raise SysidError(no_logs(board, space_of(printer.common, arguments)))
    found = [file.found for file in files if file.found]
    refuse_overwriting_logs(found, arguments, printer, {"--output": output})
    for file in files:
        if file.found is None:
            printer.warn(f"{file.path}: {file.state}")
    return files


def logs_or_fitted(
    record: Board, logs: Sequence[Path], arguments: LogArguments, printer: Printer
) -> tuple[list[Path], LogArguments]:
    """Return the logs given and how they are read, else those that a record was fitted to, read as they were then.

    Raises:
        SysidError: Neither is there.
    """
    if logs:
        return list(logs), arguments
    arguments = as_fitted(record, logs, arguments, printer)
    found = [file.found for file in logs_of(record, (), arguments, printer, None) if file.found]
    if not found:
        raise SysidError(no_logs(record, space_of(printer.common, arguments)))
    printer.note(f"logs of the fit: {', '.join(map(str, found))}")
    return found, arguments


def no_logs(board: Board, space: Workspace) -> str:
    """Return why there is nothing to look at, and what to do."""
    if not board.fit.get("logs"):
        return (
            f"board '{board.name}' was never fitted, so its record names no log. Fit it "
            f"({space.command('fit', *board.options, logs=())}), or name logs here."
        )
    names = ", ".join(str(entry.get("path")) for entry in board.fit["logs"])
    return f"the logs of the fit of '{board.name}' are gone ({names}). Name logs here."


@dataclass(frozen=True, slots=True)
class Material:
    """Contents of the logs."""

    recordings: tuple[Recording, ...]
    films: "Mapping[str, FilmFrames]"
    """Pictures of each film, by the roll's log."""


def read_logs(
    files: "Sequence[LogFile]",
    arguments: LogArguments,
    printer: Printer,
    *,
    films: bool = False,
    rest: float = 0.0,
) -> Material:
    """Read all logs that are there; `rest` is where the record's joint rests [rad or m].

    Raises:
        SysidError: No log was given, one cannot be read, holds no free decay, or was given twice.
    """
    if not files:
        raise SysidError("no log was given.")
    refuse_duplicates(file.found for file in files if file.found is not None)
    recordings: list[Recording] = []
    pictures: dict[str, FilmFrames] = {}
    for file in files:
        if file.found is None:
            continue
        if films and is_film(file.found):
            from reports.rerun.film_frames import read_film

            with reading(arguments, printer, shown=True) as options:
                roll, frames = read_film(file.found, options)
            pictures[roll.log] = frames
            say_notes(file.found, roll, printer)
        else:
            roll = load_roll(file.found, arguments, printer)
        recordings.append(recording_of(roll, arguments, printer, rest=rest))
    return Material(tuple(recordings), pictures)


def write_recording(
    path: Path,
    board: Board,
    files: "Sequence[LogFile]",
    material: Material,
    printer: Printer,
    *,
    tolerance: float = 0.02,
) -> "Evidence":
    """Compare a board with logs and write the recording of it.

    Raises:
        SysidError: rerun-sdk is not installed, or the path cannot be written.
    """
    from reports.evidence import gather
    from reports.page.summary import board_summary
    from reports.rerun.decay import comparison_recording
    from reports.rerun.stream import need_rerun
    from sysid.cli.bars import working

    need_rerun()
    with working(printer):
        evidence = gather(board, material.recordings, files=files, tolerance=tolerance, heldout=False)
    films = [
        material.films[roll.log].aligned(recording.releases[0].start)
        for recording in material.recordings
        if (roll := recording.roll).log in material.films
    ]
    comparison_recording(path, evidence, board_summary(evidence), films)
    return evidence
