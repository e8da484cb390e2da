"""A joint and its logs: the options that the commands of the loop share, and the logs that they read."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Parameter

from sysid.board import Board
from sysid.cli.console import Common, Printer
from sysid.cli.drive_options import DriveArguments
from sysid.cli.log_options import (
    LogArguments,
    load_roll,
    recording_of,
    refuse_overwriting_logs,
    typed,
)
from sysid.cli.subject import Subject
from sysid.errors import SysidError
from sysid.recording import Recording, refuse_duplicates
from sysid.workspace import Workspace

if TYPE_CHECKING:
    from reports.log_files import LogFile


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A joint, the reading of its logs, and the outputs of a command."""

    subject: Subject = Subject()
    reading: LogArguments = LogArguments()
    common: Common = Common()

    @property
    def space(self) -> Workspace:
        """The workspace; printed commands get the options for reading logs."""
        return Workspace(self.common.workspace, tuple(typed(self.reading)))

    def load(self, printer: Printer) -> Board:
        """Return the record of the joint."""
        return self.subject.load(self.common, printer)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class DriveMeasurement(Measurement):
    """The same, of a joint that a motor may drive."""

    drive: DriveArguments = DriveArguments()


@dataclass(frozen=True, kw_only=True)
class MeasuredLogs:
    """Logs of a joint and their contents."""

    record: Board
    """The joint; with the numbers of each pose and payload where the logs have several."""
    paths: Sequence[Path]
    """Logs as a printed command names them."""
    files: "Sequence[LogFile]"
    """Logs one by one, also those that are gone."""
    recordings: Sequence[Recording]
    space: Workspace
    """Workspace whose printed commands read the logs in the same way."""

    def next_step(self, why: str, command: str, *options: str) -> str:
        """Return the line with the next command for these logs, with some options."""
        return f"next: {why}: {self.space.command(command, *self.record.options, *options, logs=self.paths)}"


def read_logs(
    options: Measurement,
    logs: Sequence[Path],
    printer: Printer,
    *,
    record: Board | None = None,
    outputs: Mapping[str, Path | None] | None = None,
    may_be_gone: bool = False,
) -> MeasuredLogs:
    """Read the given logs of a joint, or without them those of its record's fit as they were read then.

    Args:
        record: The joint; read from its file or model if left out.
        outputs: Outputs of the command, by option.
        may_be_gone: Accept that all logs of the fit are gone.
    """
    from reports.log_files import find_logs

    record = record or options.load(printer)
    reading = options.reading if logs else _reading_of_fit(record, options.reading, printer)
    options = replace(options, reading=reading)
    each, setups = options.subject.logs(logs)
    files = find_logs(record, each, options.common.space)
    found = [file.found for file in files if file.found]
    refuse_overwriting_logs([*logs, *found], reading, printer, outputs)
    for file in files:
        if file.found is None:
            printer.warn(f"{file.path}: {file.state}")
    if not files or not (found or may_be_gone):
        raise SysidError(no_logs(record, options.space))
    if not logs and found:
        printer.note(f"logs of the fit: {', '.join(map(str, found))}")
    refuse_duplicates(found)
    rest = record.rest_angle
    recordings = [
        recording_of(load_roll(path, reading, printer), reading, printer, rest=rest) for path in found
    ]
    record, recordings = options.subject.posed(record, recordings, setups)
    return MeasuredLogs(
        record=record, paths=logs or found, files=files, recordings=recordings, space=options.space
    )


def _reading_of_fit(record: Board, given: LogArguments, printer: Printer) -> LogArguments:
    """Return the reading options of a record's fit, unless others are given."""
    words = record.fit.get("reading", "")
    if given != LogArguments() or not words:
        return given
    from cyclopts import App, CycloptsError

    def command(*, reading: LogArguments = LogArguments()) -> LogArguments:
        return reading

    app = App(default_command=command)
    try:
        found = app(shlex.split(words), exit_on_error=False, print_error=False, result_action="return_value")
    except (CycloptsError, ValueError) as error:
        raise SysidError(
            f"record '{record.name}': field 'fit.reading' is {words!r}; expected options for reading a log. Give the logs and "
            "their options on the command line."
        ) from error
    printer.note(f"logs read with the options of the fit: {words}")
    return found


def no_logs(board: Board, space: Workspace) -> str:
    """Return why there is no log, and the next step."""
    if not board.fit.get("logs"):
        return (
            f"board '{board.name}' was never fitted, so its record names no log. Fit it "
            f"({space.command('fit', *board.options, logs=())}), or name logs here."
        )
    names = ", ".join(str(entry.get("path")) for entry in board.fit["logs"])
    return f"the logs of the fit of '{board.name}' are gone ({names}). Name logs here."
