"""Progress bars on stderr with the remaining time; on a terminal only."""

from collections.abc import Generator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn
from rich.text import Text

from sysid.cli.console import Printer
from sysid.progress import Listener, listening


class TimeLeft(ProgressColumn):
    """Time left at the pace so far; it counts down between two updates."""

    def __init__(self) -> None:
        """Begin with no update seen."""
        super().__init__()
        self._seen: dict[TaskID, tuple[float, float]] = {}

    def render(self, task: Task) -> Text:
        """Return the time left in words; before the first part is done, the time so far."""
        elapsed = task.elapsed or 0.0
        done, when = self._seen.get(task.id, (-1.0, 0.0))
        if task.completed != done:
            done, when = self._seen[task.id] = task.completed, elapsed
        if not done or not task.total:
            return Text(f"{elapsed:.0f} s so far", "dim")
        left = when * task.total / done - elapsed
        return Text(
            "soon" if left < 1 else f"{left:.0f} s left" if left < 100 else f"{left / 60:.0f} min left"
        )


def bar(printer: Printer) -> Progress:
    """Return a bar for tasks with a total."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeLeft(),
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
def working(printer: Printer) -> Generator[None]:
    """Show a bar of the progress of the block, through `sysid.progress`."""
    with told_bar(printer) as update, listening(update):
        yield
