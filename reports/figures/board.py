"""The figures of a board's page: decays, backbone, whole logs."""

from typing import TYPE_CHECKING

from reports.evidence import Evidence
from reports.figures.compare import draw_release
from reports.figures.palette import REAL, SIM
from reports.figures.svg import thin
from sysid.text import display

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
        top.plot(*thin(release.time, scale * simpler), color=colour, lw=1.0, gid=f"series:{rung.label}")
        bottom.plot(
            *thin(release.time, scale * error), color=colour, lw=0.7, gid=f"series:{rung.label}@error"
        )
    top.set_ylabel(result.show.axis)
    bottom.set_ylabel(f"model - real [{result.show.unit.strip()}]")
    top.set_xlim(release.time[0], release.time[-1])
    figure.align_ylabels()
    return figure


def log_figure(evidence: Evidence, number: int) -> "Figure":
    """Draw one whole log with its phases shaded."""
    roll, phases = evidence.rolls[number], evidence.phases[number]
    figure = small_figure(2.6)
    axes = figure.subplots()
    shades = {"free": (SIM, 0.14), "held": (REAL, 0.16), "caught": ("#CC79A7", 0.22)}
    named: set[str] = set()
    for phase in phases:
        if phase.kind in shades:
            colour, alpha = shades[phase.kind]
            label = None if phase.kind in named else phase.kind
            axes.axvspan(phase.start, phase.end, color=colour, alpha=alpha, lw=0, label=label)
            named.add(phase.kind)
    show = display(is_rate=False, slides=evidence.board.slides)
    axes.plot(*thin(roll.time, show.scale * roll.roll), color=REAL, lw=0.9, gid="series:roll")
    axes.set(xlabel="time [s]", ylabel=show.axis, xlim=(roll.time[0], roll.time[-1]))
    axes.margins(y=0.2)
    axes.legend(loc="upper right", ncols=3)
    return figure


def small_figure(height: float = 3.2) -> "Figure":
    """Return an empty figure of the page's width and of some height [inch]."""
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH, height), layout="constrained")
