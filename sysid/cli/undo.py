"""`husky-sysid undo`: a board's record as it was before the last change."""

from sysid.cli.console import BoardName, Common, Printer
from sysid.text import count


def undo(*, board: BoardName, common: Common = Common()) -> int:
    """Put a board's record back to what it was before the last change of it: a fit, an inertia, a check.

    Args:
        board: Name of the board.
    """
    printer = Printer(common)
    changed = common.space.load_board(board)
    path = common.space.undo(board)
    record = common.space.load_board(board)
    rows = [
        (name, str(changed.tilt[name]), str(record.tilt[name]))
        for name in ("stiffness", "damping", "rest_angle")
    ]
    rows.append(("roll inertia", str(changed.inertia), str(record.inertia)))
    effects = tuple(", ".join(part.name for part in one.effects) or "none" for one in (changed, record))
    printer.table(("quantity", "was", "is again"), [*rows, ("effects", *effects)])
    left = len(common.space.earlier(board))
    printer.say(f"written: {path}; {count(left, 'step')} more to go back")
    printer.result({"board": board, "record": str(path), "undo_steps": left})
    return 0
