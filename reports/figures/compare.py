"""The picture of a comparison: decays, residuals, the missing torque against rate and tilt, and the backbone."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from reports.figures.palette import NOISE, REAL, SIM
from reports.figures.style import MOST_ROWS, styled
from reports.figures.svg import thin
from reports.story import release_name
from sysid.comparison.compare import Comparison
from sysid.diagnosis.demand import TorqueProfile
from sysid.quantity import Z95
from sysid.roll import Array
from sysid.text import Display, display, effort

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BACKBONE = {"period": "period [s]", "damping_ratio": "damping ratio"}
"""Columns of a backbone, and the labels of their axes."""


def compare_figure(result: Comparison, title: str) -> "Figure":
    """Draw the comparison."""
    shown = result.releases[:MOST_ROWS]
    with styled(9.6, 7.4) as figure:
        count = len(result.releases)
        left_out = f" ({MOST_ROWS} of {count} releases drawn)" if count > MOST_ROWS else ""
        heading = figure.suptitle(f"{title}{left_out}\n{result.summary}", fontsize=10)
        heading.set(x=0.01, ha="left")
        lower = _lower_panels(result)
        halves: Any = figure.subfigures(2, 1, height_ratios=(1.25, 1)) if lower else (figure,)
        upper = halves[0].subplots(
            2, len(shown), sharex="col", sharey="row", squeeze=False, height_ratios=(2, 1)
        )
        for column, release in enumerate(shown):
            draw_release(upper[:, column], result, column)
            upper[1, column].locator_params(axis="x", nbins=4)
            upper[0, column].set_title(
                f"{release_name(result, column)}: error {result.show(release.rmse, 3)}"
            )
        upper[0, 0].set_ylabel(result.show.axis)
        upper[1, 0].set_ylabel(f"sim - real [{result.show.unit.strip()}]")
        upper[0, 0].legend(loc="best")
        if lower:
            for draw, axes in zip(lower, halves[1].subplots(1, len(lower), squeeze=False)[0], strict=True):
                draw(axes)
    return figure


def draw_release(axes: "Sequence[Axes]", result: Comparison, index: int) -> None:
    """Draw one release, measured and simulated, on the first axes; on the second the residual over the noise's ±2σ."""
    release, scale = result.releases[index], result.show.scale
    draw_pair(axes[0], release.time, scale * release.measured, scale * release.simulated)
    time, residual = thin(release.time, release.residual)
    band = 2 * scale * result.noise.std
    axes[1].axhspan(-band, band, color=NOISE, alpha=0.3, linewidth=0)
    axes[1].plot(time, scale * residual, color=SIM, linewidth=0.7, zorder=3)
    axes[1].set_xlabel("time since release [s]")


def draw_pair(axes: "Axes", time: Array, measured: Array, simulated: Array, name: str = "sim") -> None:
    """Draw a measured and a simulated motion in the unit of the axes."""
    time, measured, simulated = thin(time, measured, simulated)
    axes.plot(time, measured, color=REAL, linewidth=2.7, label="real")
    axes.plot(time, simulated, color=SIM, linewidth=1.1, label=name, zorder=3)


def _lower_panels(result: Comparison) -> "list[Callable[[Axes], None]]":
    """Return the non-empty panels below the decays."""
    panels: list[Callable[[Axes], None]] = []
    if result.missing is not None:
        missing, slides = result.missing, result.slides
        only_noise = "" if result.where else "; the error is at the noise"
        title = f"{effort(slides=slides).split(' [')[0]} that the model lacks{only_noise}"
        for at, is_rate, said in ((missing.rate, True, title), (missing.angle, False, "")):
            show, seen = display(is_rate=is_rate, slides=slides), missing.over(at)
            panels.append(partial(draw_profile, profile=seen, show=show, title=said, slides=slides))
    if len(result.measured_backbone.amplitude):
        panels += [partial(draw_backbone, result=result, what=what) for what in BACKBONE]
    return panels


def draw_profile(
    axes: "Axes", profile: TorqueProfile, show: Display, title: str = "", *, slides: bool = False
) -> None:
    """Draw a missing torque [N*m], or force of a slide [N], with its 95 % band."""
    band, scale = Z95 * profile.std, show.scale
    axes.axhline(0, color=NOISE, lw=0.8)
    axes.fill_between(
        scale * profile.at, profile.torque - band, profile.torque + band, color=REAL, alpha=0.25, linewidth=0
    )
    axes.plot(scale * profile.at, profile.torque, ".-", color=REAL, lw=1.2)
    axes.set(xlabel=show.axis, ylabel=f"missing {effort(slides=slides)}", title=title)


def draw_backbone(axes: "Axes", result: Comparison, what: str) -> None:
    """Draw 'period' or 'damping_ratio' of each half swing against its amplitude."""
    show = display(is_rate=False, slides=result.slides)
    for backbone, colour, name, size in (
        (result.measured_backbone, REAL, "real", 7),
        (result.simulated_backbone, SIM, "sim", 3.5),
    ):
        axes.plot(
            show.scale * backbone.amplitude, getattr(backbone, what), "o",
            color=colour, label=name, ms=size, mew=0,
        )  # fmt: skip
    axes.set(xlabel=f"amplitude [{show.unit.strip()}]", ylabel=BACKBONE[what])
    axes.margins(x=0.1, y=0.25)
    low, high = axes.get_ylim()
    least = 0.1 * (low + high) / 2
    if high - low < least:  # a flat backbone must not look wild
        axes.set_ylim((low + high - least) / 2, (low + high + least) / 2)
