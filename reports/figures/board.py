"""The figures of a board's page."""

from typing import TYPE_CHECKING

from reports.evidence import Evidence
from reports.figures.compare import draw_release
from reports.figures.svg import thin

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LADDER = ("#CC79A7", "#009E73", "#D55E00", "#8C6BB1")
"""Colours of simpler models, far from the blue of the board's law in light and dark."""
WIDTH = 4.4
"""Width of a figure [inch]: type of 10 points is 11 px high on a phone, and two figures fit side by side on a desk."""


def release_figure(evidence: Evidence, number: int) -> "Figure":
    """Draw one release: measured, simulated and the simpler models, over the residual with the noise band."""
    result = evidence.comparison
    release, scale = result.releases[number], result.show.scale
    figure = small_figure(3.8)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
    draw_release((top, bottom), result, number)
    colours = [LADDER[j % len(LADDER)] for j in range(len(evidence.ladder) - 1)]
    for rung, colour in zip(evidence.ladder[:-1], colours, strict=True):
        simpler, error = rung.simulated[number], rung.simulated[number] - release.measured
        top.plot(*thin(release.time, scale * simpler), color=colour, lw=1.0, label=rung.label)
        bottom.plot(*thin(release.time, scale * error), color=colour, lw=0.7)
    top.set_ylabel(result.show.axis)
    top.legend(loc="best")
    bottom.set_ylabel(f"model - real [{result.show.unit.strip()}]")
    top.set_xlim(release.time[0], release.time[-1])
    figure.align_ylabels()
    return figure


def small_figure(height: float = 3.2) -> "Figure":
    """Return an empty figure of the page's width and of some height [inch]."""
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH, height), layout="constrained")
