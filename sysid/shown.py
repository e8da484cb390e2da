"""How a result shows itself: a short `repr`, a picture in a notebook, `plot` into axes.

Results are data and know no picture. The module that draws them is loaded by name at the first picture, as pandas loads
its plotting backend.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Protocol, cast

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BACKEND = "reports.plots"
"""Module that draws results."""
MOST_SHOWN = 8
"""Items of a list that `repr` shows: a choice, so that a result with a table in it stays below 2,000 characters."""


class Backend(Protocol):
    """Draws any public result."""

    def plot(self, result: object, axes: "Axes | None" = None) -> "Axes":
        """Draw a result into axes, new ones if None, and return them."""
        ...

    def html(self, result: object) -> str:
        """Return a result as HTML: its text and its picture."""
        ...


class Shown:
    """A public result; subclasses say in `brief` how they print."""

    __slots__ = ()

    def brief(self) -> str:
        """Return a few lines: what it is, its numbers, and no array."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """Return `brief()`."""
        return self.brief()

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the result.

        Args:
            axes: Matplotlib axes to draw into; new ones if left out.

        Returns:
            The axes.
        """
        return _backend().plot(self, axes)

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return _backend().html(self)


def _backend() -> Backend:
    return cast(Backend, import_module(BACKEND))
