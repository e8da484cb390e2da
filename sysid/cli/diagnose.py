"""`husky-sysid diagnose`: what the model is missing, or that nothing is, or that nothing known explains it."""

import math
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter, validators

from sysid.board import Board
from sysid.cli.console import Common, Printer
from sysid.cli.log_options import LogArguments, load_releases
from sysid.files import write_json

if TYPE_CHECKING:
    from sysid.diagnosis.diagnose import Candidate, Diagnosis
    from sysid.diagnosis.search import Progress

_NO_ARGUMENTS = LogArguments()
_NO_COMMON = Common()
_SHOWN = 8


def diagnose(
    logs: list[Path],
    /,
    *,
    board: Annotated[str, Parameter(name=("--board", "-b"))],
    workers: Annotated[int, Parameter(name="--workers", validator=validators.Number(gte=1))] = 2,
    arguments: LogArguments = _NO_ARGUMENTS,
    common: Common = _NO_COMMON,
) -> int:
    """Rank the physical effects that the model is missing, or say that nothing is.

    Writes diagnose.json into reports/BOARD of the workspace, where the report finds it.

    Args:
        logs: Logs of one board, with several releases in all.
        board: Name of the board.
        workers: Processes that search.
        arguments: How the logs are read.
        common: Options of every command.
    """
    from sysid.diagnosis.diagnose import diagnose as search
    from sysid.fitting.records import signal_of

    printer = Printer(common)
    record = common.space.load_board(board)
    releases = load_releases(logs, arguments, printer)
    how = signal_of(releases)
    with progress_bar(printer) as progress:
        result = search(releases, record, **how, workers=workers, progress=progress)
    for warning in result.warnings:
        printer.warn(warning)
    _print(printer, result, record, len(releases))
    content = to_json(result, record, [str(log) for log in logs])
    path = common.space.outputs(board) / "diagnose.json"
    write_json(path, content)
    printer.say(f"written: {path}")
    printer.result(content)
    return 0


@contextmanager
def progress_bar(printer: Printer) -> Generator["Progress | None"]:
    """Show a bar on stderr, on a terminal only."""
    if not printer.stderr.is_terminal:
        yield None
        return
    from rich.progress import Progress as Bar

    with Bar(console=printer.stderr, transient=True) as bar:
        task = bar.add_task("", total=1.0)

        def update(what: str, share: float) -> None:
            bar.update(task, description=what, completed=share)

        yield update


def _print(printer: Printer, result: "Diagnosis", board: Board, releases: int) -> None:
    verdict, floor = result.verdict, result.noise
    unit = "°" if result.swing_frequency is None else "°/s"
    printer.say(
        f"{board.name} · {releases} release(s) · noise floor {np.degrees(floor.std):.3g}{unit} ({floor.how})"
    )
    rows = [_row(c, floor.std) for c in result.candidates[:_SHOWN]]
    if not any(c.effects == () for c in result.candidates[:_SHOWN]):
        rows.append(_row(result.baseline, floor.std))
    printer.table(("missing", "error / noise", "held out / noise", "score (0 is best)"), rows)
    printer.say(
        f"{verdict.status}: {', '.join(verdict.effects) or '-'} (confidence {_percent(verdict.confidence)})"
    )
    printer.say(verdict.explanation)
    printer.say(_predicted(result))
    for group in verdict.indistinguishable_from:
        printer.say(f"  looks the same in these logs: {', '.join(group)}")
    if verdict.next_experiment:
        printer.say(f"next experiment: {verdict.next_experiment}")
    if verdict.effects and verdict.status == "missing":
        from sysid.effects import effect

        fittable = [n for n in verdict.effects if effect(n).role != "record"]
        if fittable:
            flags = " ".join(f"--effect {name}" for name in fittable)
            printer.say(f"to add it: husky-sysid fit LOG... --board {board.name} {flags}")


def _percent(share: float) -> str:
    return "over 99 %" if share > 0.99 else f"{100 * share:.0f} %"


def _predicted(result: "Diagnosis") -> str:
    """Say how well releases are predicted that were left out, each in its turn."""
    before, after = (
        ", ".join(f"{error:.2g}" for error in 100 * np.array(errors))
        for errors in (result.heldout_before, result.heldout_after)
    )
    what = (
        "each release, predicted from the others,"
        if len(result.heldout_before) > 1
        else "the second half, predicted from the first,"
    )
    if result.best is result.base:
        return f"{what} is off by {before} % of its RMS motion"
    with_it = "with the nearest effects"
    if result.verdict.status == "missing":
        with_it = "with it" if len(result.verdict.effects) == 1 else "with them"
    return f"{what} is off by {after} % of its RMS motion {with_it}, by {before} % without"


def _row(candidate: "Candidate", floor: float) -> tuple[str, ...]:
    held = "-" if candidate.heldout_rmse is None else f"{candidate.heldout_rmse / floor:.3f}"
    name = ", ".join(candidate.effects) or "(nothing)"
    return name, f"{candidate.rmse / floor:.3f}", held, f"{candidate.score:.1f}"


def to_json(result: "Diagnosis", board: Board, logs: list[str]) -> dict[str, Any]:
    """Return the binding result of the command."""
    verdict = result.verdict
    # An error of a measured rate, as the amplitude of a swing at the joint's frequency that has that rate.
    per = 1.0 if result.swing_frequency is None else 1.0 / result.swing_frequency
    baseline, heldout = result.baseline, result.baseline.heldout_rmse
    content: dict[str, Any] = {
        "board": board.name,
        "logs": logs,
        "signal": "roll" if result.swing_frequency is None else "rate",
        "noise_floor_rad": per * result.noise.std,
        "baseline": {
            "rmse_rad": per * baseline.rmse,
            "heldout_rmse_rad": None if heldout is None else per * heldout,
        },
        "candidates": [
            {
                "effects": list(c.effects),
                "rmse_rad": per * c.rmse,
                "heldout_rmse_rad": None if c.heldout_rmse is None else per * c.heldout_rmse,
                "score": c.score,
                "parameters": {name: quantity.to_json() for name, quantity in c.parameters.items()},
            }
            for c in result.candidates
        ],
        "verdict": {
            "status": verdict.status,
            "effects": list(verdict.effects),
            "confidence": verdict.confidence,
            "indistinguishable_from": [list(group) for group in verdict.indistinguishable_from],
            "heldout_nrmse_before": list(result.heldout_before),
            "heldout_nrmse_after": list(result.heldout_after),
            "error_before_rad": per * verdict.error_before,
            "error_after_rad": per * verdict.error_after,
            "next_experiment": verdict.next_experiment,
            "explanation": verdict.explanation,
            "share_of_peak_torque": dict(result.shares),
        },
        "warnings": list(result.warnings),
    }
    return finite(content)


def finite(value: Any) -> Any:
    """Return a value with null for every number that JSON cannot hold: a runaway model's error is infinite."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]  # pyright: ignore[reportUnknownVariableType]
    return None if isinstance(value, float) and not math.isfinite(value) else value
