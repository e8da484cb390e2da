"""The ladder: how the error falls from the record as it stood, as one effect after another is added."""

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from reports.figures.palette import HELD_OUT, NOISE, SIM
from reports.figures.style import styled
from reports.story import STOOD, Step, times

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from sysid.fit_mjcf import Fit

WIDE = 8.0
"""Ratio of errors from which their axis is logarithmic."""


def draw_ladder(axes: "Axes", steps: Sequence[Step], noise: tuple[float, float], releases: int) -> None:
    """Draw the error of each model as a dot, the first on top, in multiples of the noise, over the noise's 95 % interval.

    `releases` were fitted; of one alone, parts of it are held out.
    """
    from matplotlib.ticker import NullFormatter, StrMethodFormatter

    rows = np.arange(len(steps))
    axes.axvspan(*noise, color=NOISE, alpha=0.35, lw=0)
    axes.axvline(1, color=NOISE, lw=1.2, label="noise, 95 %")
    errors = np.array([step.error for step in steps])
    held = np.array([np.nan if step.heldout is None else step.heldout for step in steps], dtype=float)
    for row, step in enumerate(steps):
        axes.annotate(times(step.error), (step.error, row), (0, 6), textcoords="offset points", ha="center")
    if np.isfinite(held).any():
        label = "held out: releases" if releases > 1 else "held out: parts of the release"
        axes.plot(held, rows, "o", color=HELD_OUT, mfc="none", mew=1.4, ms=7, label=label)
    axes.plot(errors, rows, "o", color=SIM, ms=7, label="error")
    axes.set_yticks(rows, [fill(step.label, 22) for step in steps])
    axes.set_ylim(len(steps) - 0.5, -0.7)
    largest = float(np.nanmax([*errors, *held]))
    if largest > WIDE:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
    else:
        axes.set_xlim(0, 1.12 * largest)
    axes.set_xlabel("error / noise")
    axes.grid(visible=False, axis="y")
    axes.legend(loc="best")


def ladder_figure(fit: "Fit", title: str) -> "Figure":
    """Draw the ladder of a fit by itself: the record as it stood, then each model."""
    floor, releases = fit.noise.std, len(fit.joint.records)
    steps = [Step(STOOD, fit.rmse_before / floor)]
    steps += [Step(rung.label, rung.rmse / floor, rung.heldout_rmse / floor) for rung in fit.ladder]
    noise = (fit.noise.lowest / floor, fit.noise.highest / floor)
    with styled(5.6, 1.5 + 0.45 * len(steps)) as figure:
        axes = figure.add_subplot()
        draw_ladder(axes, steps, noise, releases)
        axes.set_title(title)
    return figure
