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
    "Fix": "it to the deck's rear end, the arrow up, square across the board's axis, on stiff card held at top and bottom.",
    "Film": "from behind along the board's axis, the lens level with the deck, on a tripod, stabilisation off.\n"
    "Take 120 frames/s or more, exposed for 1/500 s or less, from before the release until the deck rests.",
    "Size": "50 pixels or more in the film: the small one up to 1 m away, the large one up to 2 m.",
    "Read": "husky-sysid decay clip.mp4 --board NAME --overlay seen.mp4, and look at seen.mp4.",
}
"""Instructions, step by step."""


def write_marker_page(path: Path, number: int) -> None:
    """Write the page as PDF, SVG or PNG, by the path's suffix; the large marker has the number, 0 to 48, the small one the next."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    page = np.array([210.0, 297.0])  # A4 [mm]
    figure = Figure(figsize=tuple(page / 25.4))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    for offset, (across, side) in enumerate(((74.0, 80.0), (166.0, 40.0))):
        _draw_marker(axes, number + offset, across, 205.0, side)
    axes.set(xlim=(0, page[0]), ylim=(0, page[1]))  # pictures set their own
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
    from matplotlib.patches import Rectangle

    cells = marker_cells(number)
    unit = side / len(cells)
    left, top = across - side / 2, up + side / 2
    # Sharp in every viewer, which may smooth the pixels of a picture.
    fine = np.kron(cells, np.ones((60, 60)))
    axes.imshow(
        fine, "gray", extent=(left, left + side, top - side, top), interpolation="none", aspect="auto"
    )
    corner, whole = (left - unit, top - side - unit), side + 2 * unit
    axes.add_patch(
        Rectangle(corner, whole, whole, fill=False, linestyle="--", linewidth=0.5, edgecolor="0.5")
    )
    arrow = {"arrowstyle": "-|>", "color": "black"}
    axes.annotate("", (across, top + unit + 11), (across, top + unit + 2), arrowprops=arrow)
    axes.text(across + 3, top + unit + 5, f"UP   {side:g} mm, no. {number}", fontsize=9)
