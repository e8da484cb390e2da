"""An A4 page with markers in two sizes: print it, cut one out, fix it to the deck's end."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.files import atomic_path
from sysid.video.trackers.marker import marker_cells

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HOW_TO = {
    "Print": 'at 100 % ("actual size"): the bar is then 100 mm long.',
    "Cut": "along the dashed line: the white margin belongs to the marker.",
    "Fix": "it to the deck's rear end, the arrow up, square across the board's axis. Glue it onto stiff card,\n"
    "held at top and bottom: a marker that flaps moves on its own.",
    "Size": "50 pixels or more in the film: the small one up to 1 m away, the large one up to 2 m.",
    "Camera": "behind the board, lens level with the deck, looking along the board's axis, on a tripod.\n"
    "The main lens (1x), not the wide one; stabilisation, HDR and filters off.",
    "Rate": "120 frames/s or more (slow motion): eight frames or more for each swing of the deck.",
    "Light": "as bright as can be: a short shutter, 1/500 s, keeps a moving edge sharp.",
    "Take": "one, trimmed as you like, from before the release until the deck rests; hands out of the picture.\n"
    "Copy the file as it is: a messenger compresses it again.",
    "Read": "husky-sysid decay clip.mp4 --board NAME --overlay seen.mp4, and look at seen.mp4.",
}
"""Instructions, step by step."""


def write_marker_page(path: Path, number: int) -> None:
    """Write the page as PDF, SVG or PNG, by the path's suffix.

    Args:
        path: The file.
        number: Of the large marker, 0 to 48; the small one has the next.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    page = np.array([210.0, 297.0])  # A4 [mm]
    figure = Figure(figsize=tuple(page / 25.4))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, page[0]), ylim=(0, page[1]))
    axes.set_axis_off()
    for offset, (across, side) in enumerate(((74.0, 80.0), (166.0, 40.0))):
        _draw_marker(axes, number + offset, across, 205.0, side)
    axes.text(20, 280, "husky-sysid: markers for films of a rocking board", fontsize=14, weight="bold")
    axes.plot([55, 155], [125, 125], color="black", linewidth=1.0)
    for end in (55, 155):
        axes.plot([end, end], [123, 127], color="black", linewidth=1.0)
    axes.text(105, 128, "100 mm", ha="center", fontsize=10)
    line = 112.0
    for step, words in HOW_TO.items():
        axes.text(20, line, step, va="top", fontsize=9, weight="bold", linespacing=1.5)
        axes.text(40, line, words, va="top", fontsize=9, linespacing=1.5)
        line -= 5.5 * (2 + words.count("\n")) - 3
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=150)


def _draw_marker(axes: "Axes", number: int, across: float, up: float, side: float) -> None:
    """Draw the cells, the cut line one cell outside them, and which way is up."""
    from matplotlib.patches import PathPatch, Rectangle
    from matplotlib.path import Path as Outline

    cells = marker_cells(number)
    unit = side / len(cells)
    left, top = across - side / 2, up + side / 2
    squares = [
        Outline([(x, y), (x + unit, y), (x + unit, y - unit), (x, y - unit), (x, y)], closed=True)
        for row, column in np.argwhere(cells == 0)
        for x, y in [(left + column * unit, top - row * unit)]
    ]
    # One path for all cells: apart, neighbours would show a hair of paper between them.
    axes.add_patch(PathPatch(Outline.make_compound_path(*squares), facecolor="black", linewidth=0))
    axes.add_patch(
        Rectangle(
            (left - unit, top - side - unit), side + 2 * unit, side + 2 * unit, fill=False, linestyle="--",
            linewidth=0.5, edgecolor="0.5",
        )
    )  # fmt: skip
    axes.annotate(
        "",
        (across, top + unit + 11),
        (across, top + unit + 2),
        arrowprops={"arrowstyle": "-|>", "color": "black"},
    )
    axes.text(across + 3, top + unit + 5, f"UP   {side:g} mm, no. {number}", fontsize=9)
