"""`husky-sysid history`: the changes of a board's record."""

from sysid.cli.boards import show_history
from sysid.cli.console import BoardName, Common, Printer
from sysid.text import count


def history(*, board: BoardName, common: Common = Common()) -> None:
    """Show the changes of a board's record: one line a fit, and the steps of `undo`.

    Args:
        board: Name of the board.
    """
    printer = Printer(common)
    record, steps = common.space.load_board(board), len(common.space.earlier(board))
    printer.say(f"{board}: {count(len(record.history), 'fit')}; `undo` can go back {count(steps, 'step')}")
    show_history(record, printer)
    printer.result({"board": board, "history": record.history, "undo_steps": steps})
