"""`husky-sysid decay`: a log of a rocking board in, its stiffness and damping out."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from sysid.cli.console import Common, Printer
from sysid.cli.log_options import LogArguments, keep_logs, load_recordings
from sysid.files import atomic_path, write_json

_NO_ARGUMENTS = LogArguments()
_NO_COMMON = Common()


def decay(
    log: Path,
    /,
    *,
    board: Annotated[str, Parameter(name=("--board", "-b"))],
    picture: bool = True,
    rerun: Annotated[Path | None, Parameter(name="--rerun")] = None,
    arguments: LogArguments = _NO_ARGUMENTS,
    common: Common = _NO_COMMON,
) -> int:
    """Identify the board's tilt joint from its free decays.

    Finds the releases in the log, fits a linear decay to all of them together, and prints logarithmic
    decrement, damping ratio, frequencies, stiffness and damping with 95 % intervals. Writes decay.json
    and decay.png into reports/BOARD of the workspace.

    Args:
        log: CSV, Parquet, MCAP, phone export (zip or folder) or video.
        board: Board that was recorded; its record gives the roll inertia.
        picture: Draw decay.png.
        rerun: Write a Rerun recording (.rrd) here.
        arguments: How the log is read.
        common: Options of every command.
    """
    from sysid.free_decay import fit_decay

    printer = Printer(common)
    keep_logs([log], arguments, printer, {"--rerun": rerun})
    record = common.space.load_board(board)
    recordings = load_recordings([log], arguments, printer)
    result = fit_decay(recordings, board=record)
    printer.warnings(result.warnings, recordings)
    printer.say(result.report(printer.width))
    content = result.to_json()
    folder = common.space.outputs(board)
    write_json(folder / "decay.json", content)
    written = [folder / "decay.json"]
    roll = recordings[0].roll
    if picture:
        from reports.figures.decay import decay_figure

        with atomic_path(folder / "decay.png") as temporary:
            decay_figure(roll, result, f"{board}: free decay in {log.name}").savefig(temporary, dpi=140)
        written.append(folder / "decay.png")
    if rerun is not None:
        from reports.page.summary import decay_summary
        from reports.rerun.decay import decay_recording

        decay_recording(rerun, roll, result, decay_summary(board, result))
        written.append(rerun)
    printer.say("written: " + ", ".join(str(path) for path in written))
    printer.result(content)
    return 0
