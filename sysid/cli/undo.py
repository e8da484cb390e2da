"""`husky-sysid undo`: restore a board's record before its last change."""

from sysid.board import Board
from sysid.cli.boards import verdict
from sysid.cli.console import BoardName, Common, Printer
from sysid.text import count


def undo(*, board: BoardName, common: Common = Common()) -> None:
    """Undo the last change of a record: a fit, an inertia, a check.

    Args:
        board: Name of the board.
    """
    printer = Printer(common)
    changed = common.space.load_board(board)
    path = common.space.undo(board)
    record = common.space.load_board(board)
    was, again = _told(changed), _told(record)
    rows = [(name, was.get(name, "-"), again.get(name, "-")) for name in {**was, **again}]
    changes = [row for row in rows if row[1] != row[2]] or [("joint and check", "the same", "the same")]
    printer.table(("what", "was", "is again"), changes)
    left = len(common.space.earlier(board))
    printer.say(f"written: {path}; {count(left, 'step')} more to go back")
    printer.result({"board": board, "record": path, "undo_steps": left})


def _told(board: Board) -> dict[str, str]:
    """Return the main contents of a record in words."""
    effects = [f"{part.name} ({', '.join(map(str, part.parameters.values()))})" for part in board.effects]
    tilt = {name.replace("_", " "): str(quantity) for name, quantity in board.tilt.items()}
    return {
        **tilt,
        "roll inertia": str(board.inertia),
        "effects": ", ".join(effects) or "none",
        "check": verdict(board),
    }
