"""A learned torque over angle and over rate, with its band and the range of the data."""

from typing import TYPE_CHECKING

import numpy as np

from reports.figures.palette import NOISE, REAL, SIM
from reports.figures.style import styled
from sysid.diagnosis.learned_torque import learned_torque
from sysid.diagnosis.shapes import Formula
from sysid.joint.trajectory import simulate
from sysid.quantity import Z95
from sysid.roll import Array
from sysid.text import display, effort

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sysid.fitting.result import JointFit


def learned_figure(fit: "JointFit", formula: Formula | None, title: str, *, slides: bool = False) -> "Figure":
    """Draw the learned torque over the angle at rate zero, and over the rate at rest, within the measured range.

    The nearest formula, if there is one, is drawn beside it.
    """
    tilts, rates = _motion(fit)
    with styled(8.8, 3.9) as figure:
        axes = figure.subplots(2, 2, sharex="col", height_ratios=(4, 1))
        for column, values in enumerate((tilts, rates)):
            show = display(is_rate=column == 1, slides=slides)
            scale = show.scale
            at = np.linspace(values.min(), values.max(), 301)
            x, v = (at, 0 * at) if column == 0 else (0 * at, at)
            torque, std = learned_torque(fit, x, v)
            above, below = axes[0, column], axes[1, column]
            above.fill_between(
                scale * at, torque - Z95 * std, torque + Z95 * std, color=SIM, alpha=0.25, linewidth=0
            )
            above.plot(scale * at, torque, color=SIM, linewidth=1.8, label="learned, with 95 %")
            if formula is not None:
                line = formula.torque(x, v)
                weight = 1 / np.maximum(std, 1e-3 * np.abs(torque).max() + 1e-12)
                slope = np.polyfit(at, torque - line, 1, w=weight)[0]
                above.plot(scale * at, line + slope * at, color=REAL, linestyle="--", label=formula.law)
            above.axhline(0.0, color=NOISE, linewidth=0.8)
            below.hist(scale * values, bins=60, color=NOISE)
            below.set_xlabel(show.axis)
            below.set_yticks([])
        axes[0, 0].set_ylabel(effort(slides=slides))
        axes[1, 0].set_ylabel("data")
        axes[0, 0].set_title("at rate 0")
        axes[0, 1].set_title("at rest")
        axes[0, 1].sharey(axes[0, 0])
        axes[0, 0].legend(loc="best")
        figure.suptitle(title, x=0.01, ha="left", fontsize=10)
    return figure


def _motion(fit: "JointFit") -> tuple[Array, Array]:
    """Return tilt from rest [rad] and rate [rad/s] along the fitted releases, shape (n,) each."""
    law = fit.law.of_joint()
    starts = zip(fit.records, fit.starts, strict=True)
    paths = [
        simulate(law, np.linspace(0.0, float(record.time[-1]), 1500), *start) for record, start in starts
    ]
    tilts = np.concatenate([path.roll for path in paths]) - law.rest_angle
    return tilts, np.concatenate([path.rate for path in paths])
