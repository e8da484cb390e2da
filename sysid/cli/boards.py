"""`husky-sysid boards`: list the boards, or show all of one."""

import math
from collections.abc import Mapping
from typing import Any

from sysid.board import Board
from sysid.cli.console import Common, Printer
from sysid.errors import SysidError
from sysid.quantity import Quantity
from sysid.text import count
from sysid.workspace import Workspace


def boards(name: str | None = None, /, *, common: Common = Common()) -> None:
    """List boards, their parameters with their sources, and the state of the check.

    Args:
        name: Show all of this board; without it, a table of all boards.
    """
    printer = Printer(common)
    if name is not None:
        _show(common.space, name, printer)
    else:
        _list(common.space, printer)


def _list(space: Workspace, printer: Printer) -> None:
    records: list[Board] = []
    errors: list[str] = []
    for name in space.board_names():
        try:
            records.append(space.load_board(name))
        except SysidError as error:
            printer.warn(str(error))
            errors.append(str(error))
    head = ("board", "k [N·m/rad]", "d [N·m·s/rad]", "I [kg·m²]", "ζ", "f [Hz]", "effects", "from", "check")
    printer.table(head, [_row(board) for board in records])
    printer.result({"boards": [summary(space, board) for board in records], "errors": errors})


def _row(board: Board) -> tuple[str, ...]:
    ratio, frequency = _swing(board)
    return (
        board.name,
        *(_bare(one, board) for one in (board.tilt["stiffness"], board.tilt["damping"], board.inertia)),
        "-" if ratio is None else f"{ratio:.3f}",
        "-" if frequency is None else f"{frequency:.2f}",
        ", ".join(effect.name for effect in board.effects) or "none",
        provenance(board),
        verdict(board),
    )


def _show(space: Workspace, name: str, printer: Printer) -> None:
    board = space.load_board(name)
    printer.say(f"{board.name}: {board.description}")
    printer.say(f"source: {board.source}")
    printer.say(f"record: {space.board_path(name)}")
    how = provenance(board)
    joint = {
        "stiffness k": board.tilt["stiffness"].with_method(how),
        "damping d": board.tilt["damping"].with_method(how),
        "rest angle": board.tilt["rest_angle"],
        "range, to either side": board.tilt["range"],
        "roll inertia I": board.inertia,
    }
    effects = {f"{part.name}: {key}": one for part in board.effects for key, one in part.parameters.items()}
    for title, quantities in {
        "tilt joint": joint,
        "measured decay": board.decay,
        "published": board.published,
        "effects beyond spring and damper": effects,
        "geometry": board.geometry,
        "rolling": board.rolling,
        "mass": board.mass,
    }.items():
        if quantities:
            rows = [(key.replace("_", " "), one) for key, one in quantities.items()]
            printer.quantities(rows, title)
    for title, content in (("fit", board.fit), ("check", board.last_check)):
        if content:
            printer.table(("field", "value"), [(key, _told(value)) for key, value in content.items()], title)
    show_history(board, printer)
    printer.say(f"check: {verdict(board)}")
    whole = {key: getattr(board, key) for key in ("geometry", "rolling", "mass", "tilt", "fit", "history")}
    effect = [{"name": part.name, "parameters": part.parameters} for part in board.effects]
    printer.result({**summary(space, board), **whole, "effect": effect, "check": board.last_check})


def show_history(board: Board, printer: Printer) -> None:
    """Print a line for each fit of a record."""
    if not board.history:
        return
    from reports.page.summary import history_table

    printer.table(*history_table(board), "history")
    printer.say("held out: error on a release (or the second half of a single one) that the fit did not see")


def _swing(board: Board) -> tuple[float | None, float | None]:
    """Return ζ = d / (2 √(k I)) and √(k/I) / 2π [Hz]; None for a joint without a spring."""
    k, inertia = board.stiffness, board.inertia.value
    if not k:
        return None, None
    return board.damping / (2 * math.sqrt(k * inertia)), math.sqrt(k / inertia) / (2 * math.pi)


def provenance(board: Board) -> str:
    """Return the source of stiffness and damping in words."""
    if board.fit:
        logs = board.fit.get("logs", ())
        rmse = board.fit.get("rmse")
        error = f", rmse {1e3 * rmse:.3g} m{board.error_unit}" if isinstance(rmse, int | float) else ""
        return f"fitted to {count(len(logs), 'log')}{error}"
    return "period and two peaks" if board.decay else "entered by hand"


def verdict(board: Board) -> str:
    """Return the state of the check in words."""
    if board.check_is_stale:
        return f"{board.check_state}: the record was changed since; run the check again"
    nrmse = board.last_check.get("nrmse")
    error = f" (nrmse {100 * nrmse:.2g} %)" if isinstance(nrmse, int | float) else ""
    return board.check_state + error


def summary(space: Workspace, board: Board) -> dict[str, Any]:
    """Return the table as data."""
    path = space.board_path(board.name)
    ratio, frequency = _swing(board)
    return {
        "board": board.name,
        "description": board.description,
        "source": board.source,
        "record": path,
        "shipped": space.boards not in path.parents,
        "stiffness": board.tilt["stiffness"],
        "damping": board.tilt["damping"],
        "inertia": board.inertia,
        "damping_ratio": ratio,
        "natural_frequency_hz": frequency,
        "effects": [effect.name for effect in board.effects],
        "provenance": provenance(board),
        "checked": bool(board.last_check),
        "passed": board.passed,
        "decay": board.decay,
        "published": board.published,
    }


def _bare(quantity: Quantity, board: Board) -> str:
    """Return the value with its 95 % interval, without the unit of the column's head; a slide has another unit."""
    unit = quantity.unit if board.slides else "1"
    return str(Quantity(quantity.value, quantity.std, unit, interval=quantity.interval))


def _told(value: Any) -> str:
    """Return a value of a record in words: a number to four digits, the path of a log."""
    if isinstance(value, list | tuple):
        return ", ".join(map(_told, value)) or "none"
    if isinstance(value, Mapping):
        return _told(
            value["path"] if "path" in value else [f"{key} {_told(own)}" for key, own in value.items()]
        )
    return f"{value:.4g}" if isinstance(value, float) else str(value)
