"""Three intervals of each parameter in one picture: parabola, profile, and bootstrap."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from reports.figures.palette import NOISE, REAL, SIM
from reports.figures.style import styled
from sysid.fitting.bootstrap import Bootstrap
from sysid.fitting.profile import Profile
from sysid.quantity import Z95, Quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TOP = 9.0
"""Deviance at the upper edge [1]: three standard deviations."""


def interval_figure(
    quantities: Mapping[str, Quantity],
    profiles: Sequence[Profile],
    bootstrap: Bootstrap | None,
    title: str,
) -> "Figure":
    """Draw, for each parameter, the rise of the cost, its parabola, and the drawn values."""
    shapes = {shape.name: shape for shape in profiles}
    names = list(shapes) or list(bootstrap.names if bootstrap else ())
    columns = 2 if len(names) == 4 else min(3, len(names))
    rows = -(-len(names) // columns)
    with styled(3.1 * columns + 0.4, 2.7 * rows + 0.6) as figure:
        figure.suptitle(title, fontsize=10, x=0.01, ha="left")
        for number, name in enumerate(names):
            axes = figure.add_subplot(rows, columns, number + 1)
            _draw(axes, quantities[name], shapes.get(name), bootstrap)
            axes.set_title(name)
            unit = quantities[name].printed_unit
            axes.set_xlabel("" if unit == "1" else f"[{unit}]")
            if number % columns == 0:
                axes.set_ylabel("rise of −2 log likelihood")
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower left", ncols=4)
    return figure


def _draw(axes: "Axes", quantity: Quantity, shape: Profile | None, bootstrap: Bootstrap | None) -> None:
    value, std = quantity.value, max(quantity.std, 1e-300)
    ends = [value - 2.6 * std, value + 2.6 * std]
    drawn = bootstrap.draws[:, bootstrap.names.index(shape.name)] if bootstrap and shape else None
    if shape is not None:
        seen = shape.values[shape.rise < 1.3 * _TOP]
        ends = [min(ends[0], float(seen.min())), max(ends[1], float(seen.max()))]
        if any(shape.at_bound):
            ends[0] = max(ends[0], shape.interval[0]) if shape.at_bound[0] else ends[0]
            ends[1] = min(ends[1], shape.interval[1]) if shape.at_bound[1] else ends[1]
    if drawn is not None:
        counts, edges = np.histogram(drawn, bins=28, range=(ends[0], ends[1]))
        heights = 0.55 * _TOP * counts / max(1, counts.max())
        axes.bar(
            edges[:-1], heights, np.diff(edges), align="edge", color=NOISE, alpha=0.35, label="drawn again"
        )
    grid = np.linspace(ends[0], ends[1], 200)
    axes.plot(grid, ((grid - value) / std) ** 2, color=REAL, linestyle="--", linewidth=1.3, label="Jacobian")
    if shape is not None:
        axes.plot(
            shape.values, shape.rise, color=SIM, linewidth=1.5, marker="o", markersize=3, label="profile"
        )
        for end in shape.interval:
            if np.isfinite(end):
                axes.plot([end, end], [0, Z95**2], color=SIM, linewidth=0.9, linestyle=":")
    axes.axhline(Z95**2, color="black", linewidth=0.7, label="95 %")
    margin = 0.03 * (ends[1] - ends[0])
    axes.set_xlim(ends[0] - margin, ends[1] + margin)
    axes.set_ylim(0, _TOP)
    axes.locator_params(axis="x", nbins=4)
