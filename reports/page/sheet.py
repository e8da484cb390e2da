"""A board on one page for a paper or a notebook: answers, law, table, story and provenance."""

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

from reports.evidence import Evidence, LastDiagnosis
from reports.figures.story import draw_panels
from reports.figures.style import styled
from reports.log_files import LogFile
from reports.page.answers import four_answers
from reports.page.board import Provenance, made_of
from reports.page.summary import parameters, pretty, title
from reports.story import story_of_board
from sysid.joint import JointLaw

if TYPE_CHECKING:
    from matplotlib.figure import Figure

A4 = tuple(2 ** (power / 4) / 0.0254 for power in (-9, -7))
"""Width and height [inch]: 2^(-9/4) and 2^(-7/4) m (ISO 216)."""
LINE = 100
"""Characters of a line."""


def board_sheet(
    evidence: Evidence, files: Sequence[LogFile], provenance: Provenance, diagnosis: LastDiagnosis | None
) -> "Figure":
    """Draw a board's page."""
    board, deep = evidence.board, "    "
    answers = four_answers(board, evidence, diagnosis, files, provenance.space)
    said = "\n".join(fill(f"{ask} {answer}", LINE, subsequent_indent=deep) for ask, answer, _ in answers)
    logs = [("log", f"{file.path} · sha256 {file.digest} · {file.state}") for file in files]
    sources = [f"{name}: {value}" for name, value in (*logs, *made_of(board, provenance))]
    made = "\n".join(fill(line, LINE + 20, subsequent_indent=deep) for line in sources)
    law = str(JointLaw.from_board(board)).replace("φ̈", r"$\ddot{\varphi}$").replace("φ̇", r"$\dot{\varphi}$")
    table = parameters(board)
    heights = (1.3 + said.count("\n"), 2.4 + len(table), 34.0, 1.5 + made.count("\n"))
    small = {"font.size": 8, "axes.titlesize": 8, "legend.fontsize": 7}
    with styled(*A4, style=small) as figure:
        figure.suptitle(f"{title(board)}: {board.description}", fontsize=14, x=0.02, ha="left")
        parts: Any = figure.subfigures(4, 1, height_ratios=heights)
        parts[0].text(0.02, 0.98, said, va="top", fontsize=9, linespacing=1.4)
        parts[1].text(0.02, 0.97, law, va="top", fontsize=11)
        for row, (name, quantity) in enumerate(table.items()):
            at = 0.97 - (row + 2.0) / heights[1]
            parts[1].text(0.02, at, name, va="top", fontsize=9)
            parts[1].text(0.35, at, pretty(str(quantity)), va="top", fontsize=9)
        draw_panels(parts[2], story_of_board(evidence, diagnosis), columns=2)
        parts[3].text(0.02, 0.95, made, va="top", fontsize=6.5, color="#444444")
    return figure
