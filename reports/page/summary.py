"""A board and its comparison in Markdown, for a recording."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.board import Board
from sysid.effects import effect
from sysid.joint import JointLaw
from sysid.quantity import Quantity
from sysid.text import display

if TYPE_CHECKING:
    from reports.log_files import LogFile
    from sysid.comparison.compare import Comparison


def board_summary(board: Board, files: "Sequence[LogFile]", result: "Comparison") -> str:
    """Return law, the comparison's report, parameters and warnings."""
    head = [f"# {board.name}: {JointLaw.from_board(board)}", "", "```", result.report(), "```", ""]
    lines = ["| quantity | value ± 95 % |", "|---|---|"]
    lines += [f"| {name} | {pretty(str(quantity))} |" for name, quantity in parameters(board).items()]
    if any(file.synthetic for file in files):
        lines += ["", "Logs are **synthetic**: made with a known truth; nothing was measured."]
    warnings = [f"- ⚠ {warning}" for warning in result.warnings]
    return "\n".join([*head, *lines, "", *warnings]) + "\n"


def title(board: Board) -> str:
    """Return the title of a board, or of a joint without a deck."""
    return f"{'Board' if board.geometry else 'Joint'} {board.name}"


def parameters(board: Board) -> dict[str, Quantity]:
    """Return inertia, stiffness, damping, rest angle and all effects' parameters."""
    own = {"mass" if board.slides else "inertia": board.inertia}
    rest = "rest position" if board.slides else "rest angle"
    own |= {
        "stiffness": board.tilt["stiffness"],
        "damping": board.tilt["damping"],
        rest: board.tilt["rest_angle"],
    }
    for part in board.effects:
        own |= {
            f"{part.name}: {name.replace('_', ' ')}": value
            for name, value in part.parameters.items()
            if value.value or not effect(part.name).is_known
        }
    return own


def pretty(text: str) -> str:
    """Return a text with the powers of its units set high."""
    return text.replace("^2", "²").replace("^3", "³")


def history_table(board: Board) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return columns and rows of a table with a line for each fit of a board."""
    show = display(is_rate=board.error_unit in ("rad/s", "m/s"), slides=board.slides)
    rows: list[tuple[str, ...]] = []
    for line in board.history:
        told = (line.get(key) for key in ("rmse_before", "rmse", "heldout_rmse", "noise_floor"))
        errors = ("-" if error is None else show(error, 3) for error in told)
        model = ", ".join(line.get("effects", [])) or "spring and damper"
        rows.append((str(line.get("date", "")), model, *errors))
    return ("date", "model", "error before", "after", "held out", "noise floor"), rows
