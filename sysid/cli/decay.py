"""`husky-sysid decay`: stiffness and damping of a joint from its log."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from sysid.cli.console import OUTPUT, Common, Made, Printer
from sysid.cli.log_options import LogArguments, load_recordings, refuse_overwriting_logs, space_of
from sysid.cli.subject import Subject
from sysid.errors import SysidError
from sysid.files import require_writable, write_figure, write_json


def decay(
    logs: list[Path],
    /,
    *,
    subject: Subject = Subject(),
    picture: Annotated[bool, Parameter(group=OUTPUT)] = True,
    rerun: Made | None = None,
    arguments: LogArguments = LogArguments(),
    common: Common = Common(),
) -> int:
    """Identify the board's tilt joint from its free decays.

    Fits a linear decay to all releases in the logs. Prints decrement, damping ratio, frequencies, stiffness and
    damping with 95 % intervals. Writes decay.json
    and decay.png into reports/BOARD of the workspace.

    Args:
        logs: CSV, Parquet, MCAP, phone exports (zip or folder) or videos of one board.
        subject: Board or joint; its record gives the inertia. Without it there is no stiffness and no damping, and only the
            files of --json and --rerun are written.
        picture: Draw decay.png.
        rerun: Write a Rerun recording (.rrd) here.
    """
    from sysid.free_decay import fit_decay

    printer = Printer(common)
    if rerun is not None and len(logs) > 1:
        raise SysidError(
            f"--rerun {rerun}: {len(logs)} logs; a recording of a decay shows one log. Give one, or use `view`."
        )
    refuse_overwriting_logs(logs, arguments, printer, {"--rerun": rerun})
    record = subject.find(common, printer)
    folder = None if record is None else common.space.outputs(record.name)
    if folder is not None:
        require_writable(folder / "decay.json")
    rest = 0.0 if record is None else record.rest_angle
    recordings = load_recordings(logs, arguments, printer, rest=rest)
    result = fit_decay(recordings, board=record)
    printer.warnings(result.warnings, recordings)
    printer.say(result.report(printer.width))
    if not result.linear:
        space, options = (
            space_of(common, arguments),
            ("--board", "NAME") if record is None else record.options,
        )
        made = " (`new NAME` writes the record for it)" if record is None else ""
        printer.say(f"next: find the missing effect: {space.command('diagnose', *options, logs=logs)}{made}")
    content = result.to_json()
    written: list[Path] = []
    if folder is not None:
        written.append(folder / "decay.json")
        write_json(written[-1], content)
        if picture:
            from reports.figures.decay import decay_figure

            names = ", ".join(recording.path.name for recording in recordings)
            rolls = [recording.roll for recording in recordings]
            figure = decay_figure(rolls, result, f"{result.board}: free decay in {names}")
            written.append(write_figure(folder / "decay.png", figure))
    if rerun is not None:
        from reports.page.summary import decay_summary
        from reports.rerun.decay import decay_recording

        summary = decay_summary("a board" if record is None else record.name, result)
        decay_recording(rerun, recordings[0].roll, result, summary)
        written.append(rerun)
    if written:
        printer.written(*written)
    printer.result(content)
    return 0
