"""The picture of a comparison: decays, residuals, the missing torque, and the backbone."""

from typing import TYPE_CHECKING, Any

import numpy as np

from reports.figures.decay import STYLE
from reports.figures.palette import NOISE, REAL, SIM
from reports.figures.svg import thin
from sysid.comparison.compare import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 4
"""Releases drawn; more would be too small to read."""


def compare_figure(result: Comparison, title: str) -> "Figure":
    """Draw the comparison.

    Args:
        result: What was compared.
        title: Heading.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    shown = result.releases[:MOST]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 7.4), layout="constrained")
        heading = figure.suptitle(f"{title}\n{result.summary}", fontsize=10)
        heading.set(x=0.01, ha="left")
        halves: Any = figure.subfigures(2, 1, height_ratios=(1.25, 1))
        top, bottom = halves
        upper = top.subplots(2, len(shown), sharex="col", sharey="row", squeeze=False, height_ratios=(2, 1))
        for column, release in enumerate(shown):
            _release(upper[:, column], result, column)
            upper[0, column].set_title(f"release {release.number}: error {_size(result, release.rmse)}")
        upper[0, 0].set_ylabel("rate [rad/s]" if result.is_rate else "roll [°]")
        upper[1, 0].set_ylabel("sim - real [rad/s]" if result.is_rate else "sim - real [°]")
        upper[0, 0].legend(loc="best")
        lower = bottom.subplots(1, 3, width_ratios=(1.35, 1, 1))
        _surface(lower[0], result)
        _backbone(lower[1], result, "period", "period [s]")
        _backbone(lower[2], result, "damping_ratio", "damping ratio")
    return figure


def _scale(result: Comparison) -> float:
    return 1.0 if result.is_rate else float(np.degrees(1.0))


def _size(result: Comparison, value: float) -> str:
    return f"{value:.3g} rad/s" if result.is_rate else f"{np.degrees(value):.3g}°"


def _release(axes: "list[Axes]", result: Comparison, index: int) -> None:
    release, scale = result.releases[index], _scale(result)
    time, measured, simulated, residual = thin(
        release.time, release.measured, release.simulated, release.residual
    )
    axes[0].plot(time, scale * measured, color=REAL, linewidth=2.6, label="real")
    axes[0].plot(time, scale * simulated, color=SIM, linewidth=1.1, label="sim")
    band = 2 * scale * result.noise.std
    axes[1].axhspan(-band, band, color=NOISE, alpha=0.3, linewidth=0)
    axes[1].plot(time, scale * residual, color=SIM, linewidth=0.7)
    axes[1].set_xlabel("time since release [s]")
    axes[1].locator_params(axis="x", nbins=4)


def _surface(axes: "Axes", result: Comparison) -> None:
    axes.set_title(
        "torque that the model lacks" if result.where else "torque that the model lacks: only noise"
    )
    axes.set_xlabel("tilt [°]")
    axes.set_ylabel("rate [rad/s]")
    missing = result.missing
    if missing is None:
        axes.text(0.5, 0.5, "too few samples a swing", ha="center", transform=axes.transAxes)
        return
    largest = float(np.nanquantile(np.abs(missing.torque), 0.98)) or 1.0
    mesh = axes.pcolormesh(
        np.degrees(missing.angle), missing.rate, missing.torque.T, cmap="PuOr", vmin=-largest, vmax=largest
    )
    axes.grid(visible=False)
    axes.figure.colorbar(mesh, ax=axes, label="N·m (hatched: no data)")
    axes.patch.set(facecolor="#e8e8e8", edgecolor="#cccccc", hatch="////")


def _backbone(axes: "Axes", result: Comparison, what: str, label: str) -> None:
    axes.set_title(f"{label.split(' [')[0]} by amplitude")
    axes.set_xlabel("amplitude [°]")
    if not len(result.measured_backbone.amplitude):
        axes.text(0.5, 0.5, "no two real swings\nabove the noise", ha="center", transform=axes.transAxes)
        axes.set(xticks=[], yticks=[])
        return
    for backbone, colour, name, size in (
        (result.measured_backbone, REAL, "real", 7),
        (result.simulated_backbone, SIM, "sim", 3.5),
    ):
        amplitude = np.degrees(backbone.amplitude)
        axes.plot(amplitude, getattr(backbone, what), "o", color=colour, label=name, markersize=size)
    axes.set_ylabel(label)
    axes.margins(0.15)
    axes.legend()
