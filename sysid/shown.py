"""Display of a result: a short `repr`, a picture in a notebook, `plot` into axes.

Results are data without pictures. The module that draws them is loaded by name at the first picture, like the plotting
backend of pandas.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BACKEND = "reports.plots"
"""Module that draws results."""
MOST_SHOWN = 8
"""Items of a list in `repr`: a choice that keeps a result with a table below 2,000 characters."""


class Shown:
    """A public result; subclasses print `brief`."""

    __slots__ = ()

    def brief(self) -> str:
        """Return a few lines: its kind and its numbers, without arrays."""
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
        return import_module(BACKEND).plot(self, axes)

    def _repr_html_(self) -> str:
        """Return the HTML for a notebook."""
        return import_module(BACKEND).html(self)
