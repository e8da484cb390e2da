"""First screen of a command's help: its most common options."""

from collections.abc import Collection
from typing import TYPE_CHECKING

from cyclopts.help import DefaultFormatter

if TYPE_CHECKING:
    from cyclopts.help import HelpPanel
    from rich.console import Console, ConsoleOptions


class FirstScreen(DefaultFormatter):
    """Shows arguments and some of the options."""

    def __init__(self, shown: Collection[str]) -> None:
        """Take the names of the shown options."""
        super().__init__()
        self._shown = frozenset(shown)

    def __call__(self, console: "Console", options: "ConsoleOptions", panel: "HelpPanel") -> None:
        """Print one panel, unless all of its options are hidden."""
        kept = [
            one for one in panel.entries
            if one.required or one.positional_label or not self._shown.isdisjoint((*one.positive_names, *one.negative_names))
        ]  # fmt: skip
        if kept:
            super().__call__(console, options, panel.copy(entries=kept))
