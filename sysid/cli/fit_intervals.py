"""The part of `husky-sysid fit` that asks twice how sure the fit is: profiles, and a block bootstrap."""

from typing import TYPE_CHECKING, Any

from sysid.board import Board
from sysid.cli.console import Common, Printer
from sysid.files import atomic_path

if TYPE_CHECKING:
    from sysid.fitting.bootstrap import Bootstrap
    from sysid.fitting.profile import Profile
    from sysid.fitting.result import JointFit


def show_intervals(
    fit: "JointFit", board: Board, common: Common, printer: Printer, *, profile: bool, draws: int
) -> dict[str, Any]:
    """Profile the parameters, draw the logs again, print and draw what comes out.

    Args:
        fit: The fit.
        board: The record that gave the inertia.
        common: Where the picture goes.
        printer: Where the words go.
        profile: Whether profiles were asked for.
        draws: Of the bootstrap; 0 for none.

    Returns:
        What is added to the JSON; nothing if neither was asked for.
    """
    if not profile and not draws:
        return {}
    from rich.progress import Progress

    from reports.figures.intervals import interval_figure
    from sysid.fitting.bootstrap import bootstrap
    from sysid.fitting.intervals import agreements
    from sysid.fitting.profile import profiles

    shapes: list[Profile] = []
    again: Bootstrap | None = None
    with Progress(console=printer.stderr, transient=True, disable=not printer.stderr.is_terminal) as bar:
        if profile:
            task = bar.add_task("profiles", total=len(fit.quantities))
            for shape in profiles(fit, board):
                shapes.append(shape)
                bar.advance(task)
        if draws:
            task = bar.add_task("bootstrap", total=draws)
            again = bootstrap(fit, board, draws, progress=lambda done: bar.update(task, completed=done))
    _print(printer, fit, shapes, again)
    verdicts = agreements(fit.quantities, shapes, again)
    for verdict in verdicts:
        printer.say(f"{verdict.name}: trust the {verdict.trust}'s interval: {verdict.text}")
    path = common.space.outputs(board.name) / "intervals.png"
    with atomic_path(path) as temporary:
        title = f"{board.name}: how far each parameter can move while the others follow"
        interval_figure(fit.quantities, shapes, again, title).savefig(temporary, dpi=140)
    printer.say(f"written: {path}")
    return {
        **({"profile": {shape.name: shape.to_json() for shape in shapes}} if shapes else {}),
        **({"bootstrap": again.to_json()} if again else {}),
        "intervals": [
            {"name": v.name, "trust": v.trust, "ci95": _finite(v.interval), "text": v.text} for v in verdicts
        ],
    }


def _print(printer: Printer, fit: "JointFit", shapes: "list[Profile]", again: "Bootstrap | None") -> None:
    columns = ["95 % interval", "Jacobian"]
    columns += (["profile"] if shapes else []) + ([again.how] if again else [])
    by_name = {shape.name: shape for shape in shapes}
    rows: list[list[str]] = []
    for name, quantity in fit.quantities.items():
        row = [name, _text(quantity.ci95, quantity.std)]
        if shapes:
            row.append(_text(by_name[name].interval, quantity.std) if name in by_name else "-")
        if again:
            row.append(_text(again.intervals[name], quantity.std))
        rows.append(row)
    printer.table(columns, rows)


def _text(interval: tuple[float, float], error: float) -> str:
    """Print an interval to a tenth of its deviation."""
    from math import floor, isfinite, log10

    decimals = max(0, 1 - floor(log10(error))) if error > 0 and isfinite(error) else 4
    low, high = (f"{end:.{decimals}f}" if isfinite(end) else "open" for end in interval)
    return f"{low} … {high}"


def _finite(interval: tuple[float, float]) -> list[float | None]:
    from math import isfinite

    return [end if isfinite(end) else None for end in interval]
