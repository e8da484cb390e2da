"""`husky-sysid compare`: measured against simulated, and where they part."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter

from sysid.board import Board
from sysid.cli.console import Common, Printer, require_share
from sysid.cli.log_options import LogArguments, keep_logs
from sysid.cli.view import read_logs, write_recording
from sysid.files import atomic_path, sha256, write_json

if TYPE_CHECKING:
    from sysid.comparison.compare import Backbone, Comparison

_NO_ARGUMENTS = LogArguments()
_NO_COMMON = Common()


def compare(
    logs: list[Path],
    /,
    *,
    board: Annotated[str, Parameter(name=("--board", "-b"))],
    tolerance: float = 0.02,
    picture: bool = True,
    rerun: Annotated[Path | None, Parameter(name="--rerun")] = None,
    arguments: LogArguments = _NO_ARGUMENTS,
    common: Common = _NO_COMMON,
) -> int:
    """Compare the board's simulated decay with measured ones: how far off, and where.

    Each release is simulated from its own start; the error is told apart from the sensor's noise, and placed
    in time, amplitude, velocity, side and phase. Writes compare.json and compare.png into reports/BOARD
    of the workspace.

    Args:
        logs: Logs of one board.
        board: Name of the board.
        tolerance: Error beyond the noise, over the RMS motion, at which the comparison passes.
        picture: Draw compare.png.
        rerun: Write a Rerun recording (.rrd) here.
        arguments: How the logs are read.
        common: Options of every command.
    """
    from reports.evidence import find_logs
    from sysid.comparison.compare import compare as compare_releases
    from sysid.decay.plausibility import amplitude_warnings
    from sysid.fitting.records import signal_of

    require_share("--tolerance", tolerance)
    printer = Printer(common)
    keep_logs(logs, arguments, printer, {"--rerun": rerun})
    record = common.space.load_board(board)
    files = find_logs(record, logs, common.space) if logs else []
    material = read_logs(files, arguments, printer, films=rerun is not None)
    releases = list(material.releases)
    for warning in amplitude_warnings(releases, record):
        printer.warn(warning)
    result = compare_releases(releases, record, tolerance=tolerance, **signal_of(releases))
    content = to_json(result, record, logs)
    folder = common.space.outputs(board)
    write_json(folder / "compare.json", content)
    written = [folder / "compare.json"]
    if picture:
        from reports.figures.compare import compare_figure

        names = ", ".join(log.name for log in logs)
        with atomic_path(folder / "compare.png") as temporary:
            compare_figure(result, f"{board}: simulated against {names}").savefig(temporary, dpi=140)
        written.append(folder / "compare.png")
    if rerun is not None:
        write_recording(rerun, record, files, material, printer, tolerance=tolerance)
        written.append(rerun)
    _print(printer, result)
    printer.say("written: " + ", ".join(str(path) for path in written))
    printer.result(content)
    return 0


def _print(printer: Printer, result: "Comparison") -> None:
    scale, unit = (1.0, " rad/s") if result.is_rate else (float(np.degrees(1.0)), "°")
    printer.table(
        ("release", "error", "error / noise"),
        [
            (
                f"{Path(r.log).name} {r.number}",
                f"{scale * r.rmse:.4g}{unit}",
                f"{r.rmse / result.noise.std:.2f}",
            )
            for r in result.releases
        ],
    )
    printer.say(
        f"error {scale * result.rmse:.4g}{unit} = {100 * result.nrmse:.2f} % of the RMS motion; noise floor "
        f"{scale * result.noise.std:.4g}{unit} ({result.noise.how})"
    )
    printer.say(result.summary)
    mark = "✓ within" if result.passed else "✗ beyond"
    printer.say(f"{mark} tolerance: {result.verdict()}")
    if not result.passed:
        printer.say("what is missing: husky-sysid diagnose")


def to_json(result: "Comparison", board: Board, logs: Sequence[Path]) -> dict[str, Any]:
    """Return the binding result of the command.

    The held-out error of logs that the board was fitted to is the one that the fit measured by leaving
    releases out; on any other logs every error is held out.
    """
    fitted = {entry.get("sha256") for entry in board.fit.get("logs", [])}
    seen = any(sha256(log) in fitted for log in logs)
    heldout = board.fit.get("heldout_rmse") if seen else result.rmse
    # An error of a measured rate, as the amplitude of a swing at the joint's frequency that has that rate.
    per = 1.0 / result.law.frequency if result.is_rate else 1.0
    missing = result.missing
    return {
        "board": result.board,
        "logs": [str(log) for log in logs],
        "rmse_rad": per * result.rmse,
        "nrmse": result.nrmse,
        "nrmse_beyond_noise": result.excess,
        "nrmse_beyond_noise_ci95": list(result.excess_range),
        "noise_floor_rad": per * result.noise.std,
        "noise_floor_how": result.noise.how,
        "heldout_rmse_rad": per * heldout if heldout is not None else None,
        "signal": "rate" if result.is_rate else "roll",
        "releases": [{"log": r.log, "number": r.number, "rmse_rad": per * r.rmse} for r in result.releases],
        "where": [
            {"axis": p.axis, "range": list(p.range), "share_of_error": p.share, "text": p.text}
            for p in result.where
        ],
        "summary": result.summary,
        "missing_torque": None
        if missing is None
        else {
            "angle_edges_rad": missing.angle.tolist(),
            "rate_edges_rad_s": missing.rate.tolist(),
            "torque_nm": [[v if np.isfinite(v) else None for v in row] for row in missing.torque.tolist()],
            "samples": missing.count.tolist(),
        },
        "backbone": {
            "measured": _backbone_json(result.measured_backbone),
            "simulated": _backbone_json(result.simulated_backbone),
        },
        "passed": result.passed,
        "tolerance": result.tolerance,
    }


def _backbone_json(backbone: "Backbone") -> dict[str, list[float]]:
    return {
        "amplitude_rad": backbone.amplitude.tolist(),
        "period_s": backbone.period.tolist(),
        "damping_ratio": backbone.damping_ratio.tolist(),
    }
