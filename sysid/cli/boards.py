"""`husky-sysid boards`: list the boards, or show all of one."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from sysid.board import Board
from sysid.cli.console import Common, Printer
from sysid.decay.report import LABELS
from sysid.errors import SysidError, did_you_mean
from sysid.quantity import Quantity
from sysid.workspace import Workspace

if TYPE_CHECKING:
    from sysid.free_decay import DecayNumbers


def boards(
    name: Annotated[
        str | None, Parameter(help="Show all of this board; without it, a table of all boards.")
    ] = None,
    /,
    *,
    common: Common = Common(),
) -> int:
    """List boards, their parameters with their sources, and the state of the check."""
    printer = Printer(common)
    if name is not None:
        _show(common.space, name, printer)
    else:
        _list(common.space, printer)
    return 0


def _list(space: Workspace, printer: Printer) -> None:
    records: list[Board] = []
    errors: list[str] = []
    for name in space.board_names():
        try:
            records.append(space.load_board(name))
        except SysidError as error:
            printer.warn(str(error))
            errors.append(str(error))
    printer.table(
        ("board", "k [N·m/rad]", "d [N·m·s/rad]", "I [kg·m²]", "ζ", "f [Hz]", "effects", "from", "check"),
        [
            (
                board.name,
                _bare(board.tilt["stiffness"], board),
                _bare(board.tilt["damping"], board),
                _bare(board.inertia, board),
                "-" if (ratio := damping_ratio(board)) is None else f"{ratio:.3f}",
                "-" if (frequency := natural_frequency(board)) is None else f"{frequency:.2f}",
                ", ".join(effect.name for effect in board.effects) or "none",
                provenance(board),
                verdict(board),
            )
            for board in records
        ],
    )
    for board in records:
        if line := derivation_line(board):
            printer.say(line)
    printer.result({"boards": [summary(space, board) for board in records], "errors": errors})


def _show(space: Workspace, name: str, printer: Printer) -> None:
    board = space.load_board(name)
    printer.say(f"{board.name}: {board.description}")
    printer.say(f"source: {board.source}")
    printer.say(f"record: {space.board_path(name)}")
    printer.quantities(
        [
            ("stiffness k", board.tilt["stiffness"].with_method(provenance(board))),
            ("damping d", board.tilt["damping"].with_method(provenance(board))),
            ("rest angle", board.tilt["rest_angle"]),
            ("range, to either side", board.tilt["range"]),
            ("roll inertia I", board.inertia),
        ],
        "tilt joint",
    )
    if (numbers := derivation(board)) is not None:
        decay = [(key.replace("_", " "), quantity) for key, quantity in board.decay.items()]
        printer.quantities([*decay, ("roll inertia", board.inertia)], "measured decay")
        printer.quantities([(LABELS[key], quantity) for key, quantity in numbers.items()], "derived from it")
        printer.say(derivation_line(board))
    if board.effects:
        printer.quantities(
            [
                (f"{effect.name}: {key}", quantity)
                for effect in board.effects
                for key, quantity in effect.parameters.items()
            ],
            "effects beyond spring and damper",
        )
        _warn_of_unknown_effects(board, printer)
    for title, table in (("geometry", board.geometry), ("rolling", board.rolling), ("mass", board.mass)):
        rows = [(key.replace("_", " "), str(quantity)) for key, quantity in table.items()]
        if rows:
            printer.table(("quantity", "value ± 95 %"), rows, title)
    for title, content in (("fit", board.fit), ("check", board.last_check)):
        if content:
            printer.table(("field", "value"), [(key, _told(value)) for key, value in content.items()], title)
    if board.history:
        keys = list(dict.fromkeys(key for line in board.history for key in line))
        printer.table(keys, [[_told(line.get(key, "")) for key in keys] for line in board.history], "history")
    printer.say(f"check: {verdict(board)}")
    printer.result(
        {
            **summary(space, board),
            "geometry": _json(board.geometry),
            "rolling": _json(board.rolling),
            "mass": _json(board.mass),
            "tilt": _json(board.tilt),
            "effect": [{"name": e.name, "parameters": _json(e.parameters)} for e in board.effects],
            "fit": plain(board.fit),
            "check": plain(board.last_check),
            "history": [plain(line) for line in board.history],
        }
    )


def _warn_of_unknown_effects(board: Board, printer: Printer) -> None:
    from sysid.effects import catalogue

    for effect in board.effects:
        if effect.name not in catalogue():
            hint = did_you_mean(effect.name, catalogue())
            printer.warn(f"effect '{effect.name}' of the record is not in the catalogue.{hint}")


def derivation(board: Board) -> "DecayNumbers | None":
    """Return the numbers from the record's period and peaks, if it has them."""
    if not board.decay:
        return None
    from sysid.free_decay import decay_from_peaks

    return decay_from_peaks(
        board.decay["period"], board.decay["first_peak"], board.decay["second_peak"], board.inertia
    )


def derivation_line(board: Board) -> str:
    """Return derived k and d to the digits of the source, with the published numbers."""
    numbers = derivation(board)
    if numbers is None:
        return ""
    data = board.decay
    line = (
        f"{board.name}: T = {data['period'].value:g} s, peaks {data['first_peak'].value:g} → "
        f"{data['second_peak'].value:g} rad, I = {board.inertia.value:g} kg·m² give "
        f"k = {numbers.stiffness.value:.3f} N·m/rad, d = {numbers.damping.value:.4f} N·m·s/rad"
    )
    if board.published:
        k, d = board.published["stiffness"].value, board.published["damping"].value
        # Both are proportional to the inertia; rounding by the source moves them by less than this.
        ratios = (k / numbers.stiffness.value, d / numbers.damping.value)
        rounded = any(abs(ratio - 1) < 0.001 for ratio in ratios)
        why = "rounded on the way" if rounded else "for another roll inertia"
        line += f" (printed there, {why}: {k:.3f}, {d:.3f})"
    return line


def damping_ratio(board: Board) -> float | None:
    """Return ζ = d / (2 √(k I)); None for a joint without a spring."""
    return board.damping / (2 * math.sqrt(board.stiffness * board.inertia.value)) if board.stiffness else None


def natural_frequency(board: Board) -> float | None:
    """Return √(k/I) / 2π [Hz]; None for a joint without a spring."""
    return math.sqrt(board.stiffness / board.inertia.value) / (2 * math.pi) if board.stiffness else None


def provenance(board: Board) -> str:
    """Return the source of stiffness and damping in words."""
    if board.fit:
        logs = board.fit.get("logs", ())
        rmse = board.fit.get("rmse")
        error = f", rmse {1e3 * rmse:.3g} m{board.error_unit}" if isinstance(rmse, int | float) else ""
        return f"fitted to {len(logs)} log{'s' if len(logs) != 1 else ''}{error}"
    return "period and two peaks" if board.decay else "entered by hand"


def verdict(board: Board) -> str:
    """Return the state of the check in words."""
    if not board.last_check:
        return "not run"
    nrmse = board.last_check.get("nrmse")
    error = f" (nrmse {100 * nrmse:.2g} %)" if isinstance(nrmse, int | float) else ""
    if board.check_is_stale:
        return "out of date: the record was changed since; run the check again"
    return ("passed" if board.passed else "failed") + error


def summary(space: Workspace, board: Board) -> dict[str, Any]:
    """Return the table as JSON-ready data."""
    numbers = derivation(board)
    path = space.board_path(board.name)
    return {
        "board": board.name,
        "description": board.description,
        "source": board.source,
        "record": str(path),
        "shipped": space.boards not in path.parents,
        "stiffness": board.tilt["stiffness"].to_json(),
        "damping": board.tilt["damping"].to_json(),
        "inertia": board.inertia.to_json(),
        "damping_ratio": damping_ratio(board),
        "natural_frequency_hz": natural_frequency(board),
        "effects": [effect.name for effect in board.effects],
        "provenance": provenance(board),
        "checked": bool(board.last_check),
        "passed": board.passed,
        "decay": _json(board.decay),
        "derivation": numbers.to_json() if numbers else None,
        "published": _json(board.published),
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


def _json(quantities: Mapping[str, Quantity]) -> dict[str, object]:
    return {key: quantity.to_json() for key, quantity in quantities.items()}


def plain(content: Any) -> Any:
    """Return TOML values for JSON: dates become text, NaN becomes null."""
    if isinstance(content, Mapping):
        return {str(key): plain(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [plain(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content if isinstance(content, bool | int | float | str) else str(content)
