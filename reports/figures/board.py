"""The figures of a board's page: decays, backbone, whole logs."""

from typing import TYPE_CHECKING

from reports.evidence import Evidence
from reports.figures.palette import NOISE, REAL, SIM
from reports.figures.svg import thin
from sysid.comparison.compare import Comparison
from sysid.text import display

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LADDER = ("#CC79A7", "#009E73", "#D55E00", "#8C6BB1")
"""Simpler models; none is near the blue of the board's own law, light or dark."""
WIDTH = 4.4
"""Width of a figure [inch]: on a phone its type of 10 points is then 11 px high, and on a desk two stand side by side."""


def release_figure(evidence: Evidence, number: int) -> "Figure":
    """Draw one release: measured, simulated and the simpler models, over the residual with the noise band."""
    result = evidence.comparison
    release, scale = result.releases[number], result.show.scale
    figure = small_figure(3.8)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
    time, measured, simulated, residual = thin(
        release.time, release.measured, release.simulated, release.residual
    )
    top.plot(time, scale * measured, color=REAL, lw=2.8, gid="series:real")
    colours = [LADDER[j % len(LADDER)] for j in range(len(evidence.ladder) - 1)]
    for rung, colour in zip(evidence.ladder[:-1], colours, strict=True):
        simpler, error = rung.simulated[number], rung.simulated[number] - release.measured
        top.plot(*thin(release.time, scale * simpler), color=colour, lw=1.0, gid=f"series:{rung.label}")
        bottom.plot(
            *thin(release.time, scale * error), color=colour, lw=0.7, gid=f"series:{rung.label}@error"
        )
    top.plot(time, scale * simulated, color=SIM, lw=1.2, gid="series:sim")
    band = 2 * scale * result.noise.std
    bottom.axhspan(-band, band, color=NOISE, alpha=0.3, lw=0)
    bottom.plot(time, scale * residual, color=SIM, lw=0.8, gid="series:sim@error")
    top.set_ylabel(result.show.axis)
    bottom.set(xlabel="time since release [s]", ylabel=f"model - real [{result.show.unit.strip()}]")
    top.set_xlim(release.time[0], release.time[-1])
    figure.align_ylabels()
    return figure


def backbone_figure(result: Comparison) -> "Figure":
    """Draw period and damping ratio of each half swing against its amplitude."""
    figure, show = small_figure(4.6), display(is_rate=False, slides=result.slides)
    for axes, what, label in zip(
        figure.subplots(2, 1, sharex=True),
        ("period", "damping_ratio"),
        ("period [s]", "damping ratio"),
        strict=True,
    ):
        for backbone, colour, name, size in (
            (result.measured_backbone, REAL, "real", 7.5),
            (result.simulated_backbone, SIM, "sim", 3.5),
        ):
            axes.plot(
                show.scale * backbone.amplitude, getattr(backbone, what), "o",
                color=colour, ms=size, mew=0, gid=f"series:{name}@{what}",
            )  # fmt: skip
        axes.set_ylabel(label)
        axes.margins(x=0.05, y=0.25)
        low, high = axes.get_ylim()
        least = 0.1 * (low + high) / 2
        if high - low < least:  # a flat backbone must not look wild
            axes.set_ylim((low + high - least) / 2, (low + high + least) / 2)
    figure.axes[-1].set_xlabel(f"amplitude [{show.unit.strip()}]")
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
