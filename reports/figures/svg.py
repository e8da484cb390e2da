"""Matplotlib figures as inline SVG that follows the page: its text colour, its dark mode."""

import io
import re
from contextlib import contextmanager
from html import escape
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from reports.figures.style import PLAIN

if TYPE_CHECKING:
    from collections.abc import Generator

    from matplotlib.figure import Figure

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
    return re.sub(r'<svg [^>]*?(viewBox="[^"]+")[^>]*>', head, text, count=1)
