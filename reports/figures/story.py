"""The story of a board in four panels: before and after, the missing torque, the ladder, the candidates; and whether the rest is white."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from textwrap import fill, wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from reports.figures.compare import draw_profile
from reports.figures.ladder import draw_ladder
from reports.figures.palette import NOISE, REAL, SIM, STOOD
from reports.figures.style import styled
from reports.figures.svg import thin
from reports.story import Missing, Ranked, Story, times
from sysid.diagnosis.report import TIE as TIED
from sysid.effects import effect
from sysid.roll import Array
from sysid.text import Display, display, effort

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase


@dataclass(frozen=True, slots=True)
class Panel:
    """One picture of the story."""

    name: str
    title: str
    caption: str
    draw: "Callable[[Axes], None]"


def panels(story: Story) -> list[Panel]:
    """Return the panels that there is something to draw for, in reading order."""
    former, latter = story.fall
    begun = "" if np.isnan(former) else f"{times(former)} → "
    fell = f"error {begun}{times(latter)} × noise"
    named = " and ".join(name for name in story.effects if effect(name).role == "torque")
    stood = ", the record as it stood," if story.before else ""
    caption = f"{story.release}: the raw measurement{stood} and the law, {story.labels[1]}."
    drawn = [Panel("decay", fell, caption, lambda axes: draw_decay(axes, story))]
    slides = story.after.slides
    push = effort(slides=slides).split(" [")[0]
    for missing, is_rate in ((story.over_rate, True), (story.over_angle, False)):
        if missing is None:
            continue
        show = display(is_rate=is_rate, slides=slides)
        caption = (
            f"{push.capitalize()} beyond spring and damper. Orange: the {push} that the motion demands, averaged by "
            f"{show.name}, with its 95 % band.{f' Blue: the law of {named}.' if named else ''}"
        )
        draw = partial(draw_missing, missing=missing, show=show, named=named, slides=slides)
        drawn.append(Panel(f"torque-{show.name}", f"Missing {push} over {show.name}", caption, draw))
    caption = "Error of each model in multiples of the noise; grey: the noise's own 95 % interval."
    draw = partial(
        draw_ladder, steps=story.steps, noise=story.noise_range, releases=len(story.after.releases)
    )
    drawn.append(Panel("ladder", "Ladder of errors", caption, draw))
    if story.ranked:
        title = f"Chosen: {story.why}" if story.why else "Candidates"
        caption = "Twice the log evidence of each candidate below the best. Candidates in the grey zone tie with it."
        drawn.append(Panel("candidates", title, caption, partial(draw_candidates, ranked=story.ranked)))
    caption = "Autocorrelation of the residual; inside the grey 99 % band it is noise."
    drawn.append(Panel("whiteness", "Is the rest noise?", caption, partial(draw_whiteness, story=story)))
    return drawn


def story_figure(story: Story, title: str) -> "Figure":
    """Draw all panels in one picture."""
    rows = -(-len(panels(story)) // 3)
    with styled(12.6, 3.5 * rows + 0.4) as figure:
        figure.suptitle(title, fontsize=11, x=0.01, ha="left")
        draw_panels(figure, story, columns=3)
    return figure


def draw_panels(figure: "FigureBase", story: Story, *, columns: int) -> None:
    """Draw all panels into a figure or a part of one, each with its title."""
    drawn = panels(story)
    grid: Any = figure.subfigures(-(-len(drawn) // columns), columns, squeeze=False)
    for part, panel in zip(grid.flat, drawn, strict=False):
        panel.draw(part.subplots())
        part.suptitle("\n".join(wrap(panel.title, 54)), fontsize="large", x=0.02, ha="left")


def draw_decay(axes: "Axes", story: Story) -> None:
    """Draw one release: the raw measurement, the record as it stood, and the law with the missing effects."""
    after = story.after
    release, scale = after.releases[story.shown], after.show.scale

    def draw(label: str, time: Array, curve: Array, **style: Any) -> None:
        axes.plot(*thin(time, scale * curve), label=label, **style)

    draw("measured", release.time, release.measured, color=REAL, ls="", marker=".", ms=4)
    if story.before is not None:
        former = story.before.releases[story.shown]
        draw(story.labels[0], former.time, former.simulated, color=STOOD, lw=1.4, ls="--")
    draw(story.labels[1], release.time, release.simulated, color=SIM, lw=1.4)
    axes.set(xlabel="time since release [s]", ylabel=after.show.axis)
    axes.legend(loc="best")


def draw_missing(axes: "Axes", missing: Missing, show: Display, named: str, *, slides: bool) -> None:
    """Draw the torque beyond spring and damper with its 95 % band, and the named effect's law over it."""
    draw_profile(axes, missing.seen, show, slides=slides)
    if len(missing.at):
        label = f"law of {named}"
        axes.plot(show.scale * missing.at, missing.law, color=SIM, lw=1.6, label=label)
        axes.legend(loc="best")
    axes.set_ylabel(effort(slides=slides))


def draw_candidates(axes: "Axes", ranked: "tuple[Ranked, ...]") -> None:
    """Draw the score of each candidate, the chosen one filled."""
    from matplotlib.ticker import NullLocator, StrMethodFormatter, SymmetricalLogLocator

    axes.axvspan(0, TIED, color=NOISE, alpha=0.25, lw=0)
    axes.axvline(0, color=NOISE, lw=1.2, ls="--")
    for row, model in enumerate(ranked):
        color = SIM if model.chosen else "black"
        axes.plot(model.score, row, "o", color=color, mfc=SIM if model.chosen else "none", ms=7)
    names = [fill(f"{model.label} (chosen)" if model.chosen else model.label, 22) for model in ranked]
    axes.set_yticks(range(len(ranked)), names)
    axes.set_ylim(len(ranked) - 0.5, -0.5)
    largest = max(model.score for model in ranked)
    if largest > 4 * TIED:
        axes.set_xscale("symlog", linthresh=TIED)
        decades = SymmetricalLogLocator(base=10, linthresh=TIED)
        decades.set_params(numticks=4)  # more labels run into one another
        axes.xaxis.set_major_locator(decades)
        axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.margins(x=0.08)
    axes.autoscale()
    axes.set_xlim(left=-TIED / 2)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("score (grey: a tie)")


def draw_whiteness(axes: "Axes", story: Story) -> None:
    """Draw the autocorrelation of the residuals with the 99 % band of white noise."""
    axes.axhspan(-story.white, story.white, color=NOISE, alpha=0.35, lw=0)
    axes.axhline(0, color=NOISE, lw=0.8)
    colours = [STOOD, SIM][-len(story.correlations) :]
    for (label, values), colour in zip(story.correlations, colours, strict=True):
        axes.plot(1e3 * story.lags, values, ".-", color=colour, lw=1.0, ms=3, label=label)
    axes.set(xlabel="lag [ms]", ylabel="autocorrelation")
    axes.legend(loc="best")
