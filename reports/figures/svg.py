"""Matplotlib figures as inline SVG that follows the page: its text colour, its dark mode, its script.

Lines that carry a `gid` become groups the page can find: `series:NAME` can be switched off, and an
axes' own data is embedded so that the page can show values under the pointer.
"""

import io
import json
import re
from collections.abc import Sequence
from contextlib import contextmanager
from html import escape
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from reports.figures.style import PLAIN

if TYPE_CHECKING:
    from collections.abc import Generator

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

MOST_POINTS = 600
"""Points kept of one curve: about one a pixel; the numbers beside it use all of them."""
PIXELS_PER_INCH = 104
"""Width on the page of an inch of a figure [CSS px]."""


@contextmanager
def page_style() -> "Generator[None]":
    """Draw figures for a page: real text, no background, stable identifiers."""
    import matplotlib as mpl

    page: dict[Any, Any] = {
        "svg.fonttype": "none",
        "svg.hashsalt": "husky-sysid",
        "font.family": "sans-serif",
        "font.size": 10,
        "legend.fontsize": 10,
        "figure.constrained_layout.use": True,
    }
    with mpl.rc_context(PLAIN | page):
        yield


def thin(*columns: "np.typing.ArrayLike") -> tuple[np.ndarray, ...]:
    """Thin curves for the eye: of each bin of the first column keep the extremes of the second.

    Args:
        columns: Arrays of shape (n,): the abscissa, the curve, and any that go with them.

    Returns:
        The same columns with at most about `MOST_POINTS` rows, in order.
    """
    arrays = [np.asarray(column) for column in columns]
    n = len(arrays[0])
    if n <= MOST_POINTS or len(arrays) < 2:
        return tuple(arrays)
    edges = np.linspace(0, n, MOST_POINTS // 2 + 1).astype(int)
    keep = {0, n - 1}
    for start, stop in pairwise(edges):
        piece = arrays[1][start:stop]
        keep.update((start + int(np.argmin(piece)), start + int(np.argmax(piece))))
    rows = np.array(sorted(keep))
    return tuple(array[rows] for array in arrays)


def figure_to_svg(figure: "Figure", identifier: str, title: str) -> str:
    """Return a figure that was drawn under `page_style` as an `<svg>` element for a page.

    Its identifier is unique on the page, and prefixes all of its own; the title is for readers who cannot see it.
    """
    series = {_name(line) for axes in figure.axes for line in axes.get_lines()} - {""}
    for axes in figure.axes:  # the page names its series beside the boxes that switch them
        legend = axes.get_legend()
        if legend is not None and len(series) > 1 and series.issuperset(t.get_text() for t in legend.texts):
            legend.remove()
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\bid="([^"]+)"', rf'id="{identifier}-\1"', text)
    text = re.sub(r'(xlink:href="|url\()#', rf"\1#{identifier}-", text)
    # Black is matplotlib's "ink"; on a page the ink depends on light and dark.
    text = re.sub(r"(fill|stroke): ?#000000", r"\1: currentColor", text)
    # Figures narrower than the page stay narrow: type is of one size on all of the page.
    width = PIXELS_PER_INCH * figure.get_figwidth()
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" id="{identifier}" class="figure" '
        f'\\1 style="max-width: {width:.0f}px" role="img" aria-label="{escape(title)}">'
    )
    text = re.sub(r'<svg [^>]*?(viewBox="[^"]+")[^>]*>', head, text, count=1)
    hover = json.dumps(_hover_data(figure), separators=(",", ":"), allow_nan=False)
    return text.replace("</svg>", f'<script type="application/json" class="hover">{hover}</script></svg>')


def _hover_data(figure: "Figure") -> list[dict[str, object]]:
    """Return for each axes with named series its box in the SVG and the series in data and SVG units."""
    height = figure.get_figheight() * 72
    scale = 72 / figure.dpi
    panels: list[dict[str, object]] = []
    for axes in figure.axes:
        lines = [line for line in axes.get_lines() if _name(line)]
        if not lines:
            continue
        box = axes.get_window_extent()
        sides = box.x0 * scale, height - box.y1 * scale, box.width * scale, box.height * scale
        panels.append(
            {
                "box": [round(side, 2) for side in sides],
                "x": axes.get_xlabel(),
                "y": axes.get_ylabel(),
                "series": [_series(axes, line, height, scale) for line in lines],
            }
        )
    return panels


def _name(line: "Line2D") -> str:
    """Return the name of a line for the page; '' without one."""
    group = str(line.get_gid())
    return group.removeprefix("series:") if group.startswith("series:") else ""


def _series(axes: "Axes", line: "Line2D", height: float, scale: float) -> dict[str, object]:
    points = np.column_stack((np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)))
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) > MOST_POINTS // 2:
        points = points[:: -(-len(points) // (MOST_POINTS // 2))]
    pixels = axes.transData.transform(points) * scale
    return {
        "name": _name(line),
        "colour": str(line.get_color()),
        "px": _rounded(pixels[:, 0], 4),
        "py": _rounded(height - pixels[:, 1], 4),
        "x": _rounded(points[:, 0], 5),
        "y": _rounded(points[:, 1], 4),
    }


def _rounded(values: Sequence[float] | np.ndarray, digits: int) -> list[float]:
    return [float(f"{value:.{digits}g}") for value in values]
