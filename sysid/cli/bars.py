"""Progress bars on stderr with the remaining time; on a terminal only."""

from collections.abc import Generator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from sysid.cli.console import Printer
from sysid.progress import Listener, listening, stage


def bar(printer: Printer) -> Progress:
    """Return a bar for tasks with a total."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    terminal = printer.stderr.is_terminal
    return Progress(
        *columns, console=printer.stderr, transient=True, disable=not terminal, redirect_stdout=False
    )


@contextmanager
def told_bar(printer: Printer) -> Generator[Listener | None]:
    """Show a bar, and yield its listener; None without a terminal."""
    with bar(printer) as shown:
        task = shown.add_task("", total=1.0)

        def update(what: str, share: float) -> None:
            shown.update(task, description=what, completed=share)

        yield update if printer.stderr.is_terminal else None


@contextmanager
def working(printer: Printer, what: str = "") -> Generator[None]:
    """Show a bar of the progress of the block, through `sysid.progress`; its words are `what`, or those of the stages in it."""
    with told_bar(printer) as update, listening(update), stage(0.0, 1.0, what):
        yield
