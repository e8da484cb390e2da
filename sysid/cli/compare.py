"""`husky-sysid compare`: the simulated decay beside the measured one."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from sysid.board import Board
from sysid.cli.console import Common, Printer
from sysid.cli.log_options import LogArguments, load_releases
from sysid.files import atomic_path, sha256, write_json

if TYPE_CHECKING:
    from sysid.compare import Comparison

_NO_ARGUMENTS = LogArguments()
_NO_COMMON = Common()


def compare(
    *logs: Path,
    board: Annotated[str, Parameter(name=("--board", "-b"))],
    tolerance: float = 0.02,
    picture: bool = True,
    arguments: LogArguments = _NO_ARGUMENTS,
    common: Common = _NO_COMMON,
) -> int:
    """Compare the board's law with measured decays: how far off, and where.

    Each release is simulated from its own start; the error is told apart from the sensor's noise, and placed
    in time, amplitude, velocity and side. Writes compare.json and compare.png into reports/BOARD of the
    workspace.

    Args:
        logs: Logs of the board.
        board: Name of the board.
        tolerance: Accepted error beyond the noise, over the RMS of the measured roll.
        picture: Draw compare.png.
        arguments: How the logs are read.
        common: Options of every command.
    """
    from sysid.compare import compare as compare_releases

    printer = Printer(common)
    record = common.space.load_board(board)
    releases = load_releases(logs, arguments, printer)
    comparison = compare_releases(releases, record, tolerance=tolerance)
    _print(printer, comparison)
    folder = common.space.outputs(board)
    content = to_json(comparison, heldout=not _fitted_to(record, logs))
    write_json(folder / "compare.json", content)
    written = [folder / "compare.json"]
    if picture:
        from reports.compare_figure import compare_figure

        with atomic_path(folder / "compare.png") as temporary:
            compare_figure(comparison).savefig(temporary, dpi=140)
        written.append(folder / "compare.png")
    printer.say("written: " + ", ".join(str(path) for path in written))
    printer.result(content)
    return 0


def to_json(comparison: "Comparison", *, heldout: bool) -> dict[str, Any]:
    """Return the result file.

    Args:
        comparison: What was compared.
        heldout: Whether the board's law was fitted without these logs; else its error on them says
            nothing of other logs, and `heldout_rmse_rad` is None.
    """
    return {
        "board": comparison.board.name,
        "logs": sorted({c.release.log for c in comparison.releases}),
        "rmse_rad": comparison.rmse,
        "nrmse": comparison.nrmse,
        "nrmse_beyond_noise": comparison.excess,
        "noise_floor_rad": comparison.noise.std,
        "noise_floor_how": comparison.noise.how,
        "heldout_rmse_rad": comparison.rmse if heldout else None,
        "where": [
            {"axis": p.axis, "range": [p.low, p.high], "share_of_error": p.share, "text": p.text}
            for p in comparison.places
        ],
        "releases": [
            {
                "log": c.release.log,
                "number": c.release.number,
                "t_start_s": c.release.start,
                "rmse_rad": c.rmse,
                "nrmse": c.nrmse,
            }
            for c in comparison.releases
        ],
        "passed": comparison.passed,
        "tolerance": comparison.tolerance,
    }


def _fitted_to(board: Board, logs: tuple[Path, ...]) -> bool:
    known = {entry.get("sha256") for entry in board.fit.get("logs", [])}
    return any(log.is_file() and sha256(log) in known for log in logs) if known else False


def _print(printer: Printer, comparison: "Comparison") -> None:
    printer.table(
        ("log", "release", "from", "RMSE", "NRMSE"),
        [
            (
                c.release.log,
                str(c.release.number),
                f"{c.release.side}, {c.release.amplitude:.3f} rad",
                f"{1e3 * c.rmse:.2f} mrad",
                f"{100 * c.nrmse:.2f} %",
            )
            for c in comparison.releases
        ],
    )
    floor = comparison.noise
    printer.say(f"noise floor {1e3 * floor.std:.2f} mrad, {floor.how}")
    for place in comparison.places:
        printer.say(f"  {place.text}")
    if comparison.passed:
        printer.say(
            f"✓ simulated and measured agree: {100 * comparison.excess:.2f} % beyond the noise "
            f"(tolerance {100 * comparison.tolerance:g} %)"
        )
    else:
        printer.say(
            f"✗ the simulated decay is {100 * comparison.excess:.1f} % off beyond the noise (tolerance "
            f"{100 * comparison.tolerance:g} %). `husky-sysid diagnose` says which effect is missing."
        )
