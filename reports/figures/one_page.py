"""A board on one page for a paper or a notebook: answers, law, table, story and provenance."""

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

from reports.figures.story import draw_panels
from reports.figures.style import styled
from reports.story import Story

if TYPE_CHECKING:
    from matplotlib.figure import Figure

A4 = tuple(2 ** (power / 4) / 0.0254 for power in (-9, -7))
"""Width and height [inch]: 2^(-9/4) and 2^(-7/4) m (ISO 216)."""
LINE = 100
"""Characters of a line."""


def one_page(
    title: str,
    answers: Sequence[tuple[str, str, str]],
    law: str,
    table: Sequence[tuple[str, str]],
    story: Story,
    provenance: Sequence[tuple[str, str]],
) -> "Figure":
    """Draw the page."""
    said = "\n".join(
        fill(f"{question} {answer}", LINE, subsequent_indent="    ") for question, answer, _ in answers
    )
    made = "\n".join(
        fill(f"{name}: {value}", LINE + 20, subsequent_indent="    ") for name, value in provenance
    )
    heights = (1.3 + said.count("\n"), 2.4 + len(table), 34.0, 1.5 + made.count("\n"))
    small = {"font.size": 8, "axes.titlesize": 8, "legend.fontsize": 7}
    with styled(*A4, style=small) as figure:
        figure.suptitle(title, fontsize=14, x=0.02, ha="left")
        parts: Any = figure.subfigures(4, 1, height_ratios=heights)
        parts[0].text(0.02, 0.98, said, va="top", fontsize=9, linespacing=1.4)
        dotted = law.replace("φ̈", r"$\ddot{\varphi}$").replace("φ̇", r"$\dot{\varphi}$")
        parts[1].text(0.02, 0.97, dotted, va="top", fontsize=11)
        for row, (name, value) in enumerate(table):
            at = 0.97 - (row + 2.0) / heights[1]
            parts[1].text(0.02, at, name, va="top", fontsize=9)
            parts[1].text(0.35, at, value, va="top", fontsize=9)
        draw_panels(parts[2], story, columns=2)
        parts[3].text(0.02, 0.95, made, va="top", fontsize=6.5, color="#444444")
    return figure
