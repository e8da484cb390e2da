"""`husky-sysid history`: the changes of a board's record."""

from sysid.cli.boards import plain
from sysid.cli.console import BoardName, Common, Printer
from sysid.text import count


def history(*, board: BoardName, common: Common = Common()) -> int:
    """Show the changes of a board's record: one line a fit, and the steps of `undo`.

    Args:
        board: Name of the board.
    """
    printer = Printer(common)
    record, earlier = common.space.load_board(board), common.space.earlier(board)
    printer.say(
        f"{board}: {count(len(record.history), 'fit')}; `undo` can go back {count(len(earlier), 'step')}"
    )
    if record.history:
        errors = ("rmse_before", "rmse", "heldout_rmse", "noise_floor")
        printer.table(
            ("date", "effects", f"error before [{record.error_unit}]", "after", "held out", "noise floor"),
            [
                (
                    str(line.get("date", "-")),
                    ", ".join(line.get("effects", ())) or "none",
                    *(f"{line[name]:.4g}" if name in line else "-" for name in errors),
                )
                for line in record.history
            ],
        )
        printer.say(
            "held out: error on a release (or the second half of a single one) that the fit did not see"
        )
    printer.result(
        {"board": board, "history": [plain(line) for line in record.history], "undo_steps": len(earlier)}
    )
    return 0
