"""Other intervals of `husky-sysid fit`: profile likelihood and block bootstrap."""

from typing import TYPE_CHECKING, Any

from sysid.board import Board
from sysid.cli.console import Common, Printer
from sysid.files import write_figure
from sysid.progress import stage

if TYPE_CHECKING:
    from sysid.fitting.bootstrap import Bootstrap
    from sysid.fitting.profile import Profile
    from sysid.fitting.result import JointFit


def show_intervals(
    fit: "JointFit", board: Board, common: Common, printer: Printer, *, profile: bool, draws: int
) -> dict[str, Any]:
    """Compute profiles, and a bootstrap of `draws` logs; print, draw and return the intervals for the JSON.

    Without either it does nothing.
    """
    if not profile and not draws:
        return {}
    from reports.figures.intervals import interval_figure
    from sysid.cli.bars import working
    from sysid.fitting.bootstrap import bootstrap
    from sysid.fitting.intervals import agreements
    from sysid.fitting.profile import profiles
    from sysid.fitting.report import interval_json, interval_report

    shapes: list[Profile] = []
    again: Bootstrap | None = None
    with working(printer):
        if profile:
            with stage(0.0, 1.0 if not draws else 0.5, "profiles"):
                shapes = list(profiles(fit, board))
        if draws:
            with stage(0.5 if profile else 0.0, 1.0, "bootstrap"):
                again = bootstrap(fit, board, draws)
    verdicts = agreements(fit.quantities, shapes, again)
    printer.say(interval_report(fit, shapes, again, verdicts, printer.width))
    title = f"{board.name}: range of each parameter while the others follow"
    figure = interval_figure(fit.quantities, shapes, again, title)
    path = write_figure(common.space.outputs(board.name) / "intervals.png", figure)
    printer.say(f"written: {path}")
    return interval_json(shapes, again, verdicts)
