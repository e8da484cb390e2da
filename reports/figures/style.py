"""The look that all pictures share."""

from collections.abc import Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_ROWS = 4
"""Most logs or releases in a picture; more are too small to read."""
PLAIN: dict[Any, Any] = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "path.simplify": True,
}
"""Style of all pictures and of the figures of a page."""
STYLE: dict[Any, Any] = PLAIN | {
    "font.size": 9,
    "legend.fontsize": 8,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
}


@contextmanager
def styled(width: float, height: float, *, layout: str | None = "constrained") -> "Generator[Figure]":
    """Yield an empty figure of a size [inch], to be drawn on in this style."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        yield Figure(figsize=(width, height), layout=layout)  # pyright: ignore[reportArgumentType]
