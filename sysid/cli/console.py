"""Common parts of all commands: `--json`, `--workspace`, results on stdout, other output on stderr."""

import json
import math
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter
from cyclopts.validators import Number
from rich.console import Console

from sysid.board import Board
from sysid.cli.streams import one_line
from sysid.errors import QualityGateError
from sysid.files import refuse_overwriting, require_writable, write_json
from sysid.quantity import Quantity
from sysid.text import WIDTH, table
from sysid.workspace import Workspace

if TYPE_CHECKING:
    from sysid.recording import Recording


LOG, FILM, FIT, OUTPUT = (
    Group(name, sort_key=place) for place, name in enumerate(("Log", "Film", "Fit", "Output"), 1)
)
"""Groups of options, in the order of a command's help."""
Output = Annotated[Path, Parameter(name=("--output", "-o"), group=OUTPUT)]
LEAST_WIDTH = 40
"""Least width of a table [characters]; in a narrower one the cells are columns of letters."""
Made = Annotated[Path, Parameter(group=OUTPUT)]
"""An optional output file."""
BoardName = Annotated[str, Parameter(name=("--board", "-b"))]
Drawn = Annotated[bool, Parameter(group=OUTPUT, negative="--no-picture", help="Draw the picture.")]
Coupling = Literal["equality", "direct"]
Terrain = Literal["flat", "slopes", "steps"]
Texts = Annotated[tuple[str, ...], Parameter(show_default=False)]
"""An option that may be repeated."""
Fix = Annotated[
    Texts,
    Parameter(
        group=FIT,
        help="Hold a parameter, as NAME=VALUE in SI units: stiffness, damping, rest, or EFFECT.PARAMETER; repeat it for several.",
    ),
]
Tolerance = Annotated[
    float,
    Parameter(
        help="Largest accepted error: RMS without the sensor noise, over the RMS motion.",
        validator=Number(gt=0, lt=1),
    ),
]
Step = Annotated[float, Parameter(validator=Number(gt=0, lte=0.05))]
"""A time step [s], as long as `check` takes it at most."""


@Parameter(name="*", group=OUTPUT)
@dataclass(frozen=True, kw_only=True)
class Common:
    """Options of every command."""

    json: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    """Write the result as JSON to this file; '-' for stdout without other output."""
    workspace: Path = Path()
    """Folder with the user's boards (data/boards) and outputs (reports/BOARD)."""

    effect_file: Annotated[tuple[Path, ...], Parameter(group=FIT, show_default=False)] = ()
    """File with an effect of your own (see husky-sysid effects new); repeat it for several."""

    def own_effects(self) -> tuple[str, ...]:
        """Add the effects of the user's files to the catalogue and return their names."""
        if not self.effect_file:  # importing the catalogue takes a while
            return ()
        from sysid.effects import use_file

        return tuple(use_file(path) for path in self.effect_file)

    @property
    def space(self) -> Workspace:
        """The workspace."""
        return Workspace(self.workspace)


class Printer:
    """Prints a command's results as text and JSON.

    Colour only on a terminal, and never with NO_COLOR; a pipe gets plain text of any width.
    """

    def __init__(self, common: Common) -> None:
        """Load the user's own effects, and open both consoles."""
        common.own_effects()
        self.common = common
        quiet = common.json == "-"
        if common.json is not None and not quiet:
            require_writable(Path(common.json))
        # On a terminal break lines between words; a pipe gets whole lines.
        out, err = sys.stdout.isatty(), sys.stderr.isatty()
        width = None if out else _piped_width()
        self.stdout = Console(quiet=quiet, highlight=False, width=width, soft_wrap=not out, emoji=False)
        self.stderr = Console(stderr=True, highlight=False, soft_wrap=not err, emoji=False)

    def keep(self, inputs: Iterable[Path], outputs: Mapping[str, Path | None] | None = None) -> None:
        """Refuse outputs, the JSON included, that are inputs or cannot be written."""
        json = self.common.json
        own = {"--json": None if json is None or json == "-" else Path(json)}
        refuse_overwriting(inputs, own | dict(outputs or {}))
        for output in (outputs or {}).values():
            if output is not None:
                require_writable(output)

    def say(self, text: str = "") -> None:
        """Print a result line on stdout."""
        self.stdout.print(text, markup=False)

    def saved(self, record: Board, since: Board) -> str:
        """Save a record made from an earlier one, print its path, and warn where its check is lost."""
        path = self.common.space.save_board(record, since=since)
        if since.last_check:
            self.warn(f"{record.name}: the check of the old record no longer counts; run it again.")
        self.say(f"saved: {path}")
        return str(path)

    def require_passed(self, board: Board, *, force: bool) -> None:
        """Refuse a board whose current record has not passed `check`; with `force` only warn."""
        if board.passed:
            return
        text = f"the current record of board '{board.name}' has not passed `check`: its tilt joint may not move like the real one."
        if not force:
            command = self.common.space.command("check", *board.options, logs=())
            raise QualityGateError(f"{text} Run {command}, or go on with --force.")
        self.warn(text)

    def written(self, *paths: Path) -> None:
        """Print the written files."""
        self.say(f"written: {', '.join(map(str, paths))}")

    def warn(self, text: str) -> None:
        """Print a warning on stderr."""
        self.stderr.print(f"warning: {one_line(text)}", markup=False, style="yellow")

    def note(self, text: str) -> None:
        """Print a note on stderr."""
        self.stderr.print(text, markup=False, style="dim")

    @property
    def width(self) -> int:
        """Characters that fit into a line of stdout."""
        return self.stdout.width

    def warnings(self, texts: Iterable[str], recordings: Sequence["Recording"] = ()) -> None:
        """Print warnings on stderr, except those already printed by the reader of the logs."""
        from sysid.recording import reading_warnings

        said = set(reading_warnings(recordings))
        for text in texts:
            if text not in said:
                self.warn(text)

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[str]], title: str | None = None) -> None:
        """Print a table on stdout."""
        self.say(table(columns, rows, title, width=self.width))

    def quantities(self, rows: Sequence[tuple[str, Quantity]], title: str | None = None) -> None:
        """Print quantities as a table: name, value ± 95 %, method."""
        cells = [(name, str(quantity), quantity.method) for name, quantity in rows]
        self.table(("quantity", "value ± 95 %", "how"), cells, title)

    def result(self, content: dict[str, Any], *written: Path) -> None:
        """Print the written files, and write the result as JSON if `--json` was given."""
        if written:
            self.written(*written)
        if self.common.json is None:
            return
        content = plain(content)
        if self.common.json == "-":
            sys.stdout.write(json.dumps(content, indent=2, allow_nan=False) + "\n")
        else:
            write_json(Path(self.common.json), content)
            self.note(f"written: {self.common.json}")


def plain(content: Any) -> Any:
    """Return a result for JSON: quantities by their fields, NaN as null, dates and paths as text."""
    if isinstance(content, Quantity):
        return content.to_json()
    if isinstance(content, Mapping):
        return {str(key): plain(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [plain(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content if content is None or isinstance(content, bool | int | float | str) else str(content)


def _piped_width() -> int:
    """Return the width of tables for a pipe or a file [characters]: COLUMNS if it is exported."""
    columns = os.environ.get("COLUMNS", "")
    return max(LEAST_WIDTH, int(columns)) if columns.isdigit() else WIDTH
