"""`husky-sysid undo`: restore a board's record before its last change."""

from sysid.cli.console import BoardName, Common, Printer
from sysid.text import count


def undo(*, board: BoardName, common: Common = Common()) -> None:
    """Undo the last change of a record: a fit, an inertia, a check.

    Args:
        board: Name of the board.
    """
    printer = Printer(common)
    path = common.space.undo(board)
    left = len(common.space.earlier(board))
    printer.say(f"written: {path}; {count(left, 'step')} more to go back")
    printer.result({"board": board, "record": path, "undo_steps": left})
