"""Measured beside simulated decay: overlay, residual, missing torque, backbone."""

from typing import TYPE_CHECKING

import numpy as np

from reports.palette import NOISE, REAL, SIM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from sysid.compare import Comparison


def compare_figure(comparison: "Comparison") -> "Figure":
    """Draw a comparison on one sheet."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 7.2), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=(2, 1, 2.2))
    overlay = figure.add_subplot(grid[0, :])
    residual = figure.add_subplot(grid[1, :], sharex=overlay)
    draw_overlay(overlay, comparison)
    draw_residual(residual, comparison)
    draw_torque(figure.add_subplot(grid[2, 0]), comparison)
    draw_backbone(figure.add_subplot(grid[2, 1]), comparison)
    verdict = "within" if comparison.passed else "beyond"
    figure.suptitle(
        f"{comparison.board.name}: error {100 * comparison.excess:.2f} % beyond the noise, {verdict} the "
        f"tolerance of {100 * comparison.tolerance:g} %",
        x=0.01, ha="left", fontsize=11,
    )  # fmt: skip
    for axes in figure.axes[:2]:
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def draw_overlay(axes: "Axes", comparison: "Comparison") -> "Axes":
    """Draw all releases, aligned at their start: measured wide, simulated narrow on top."""
    for i, c in enumerate(comparison.releases):
        measured, simulated = np.degrees(c.measured - c.rest), np.degrees(c.simulated - c.rest)
        axes.plot(c.time, measured, color=REAL, lw=3, alpha=0.7, label="measured" if i == 0 else None)
        axes.plot(c.time, simulated, color=SIM, lw=1.1, label="simulated" if i == 0 else None)
    axes.set_ylabel("roll about rest [°]")
    axes.legend(frameon=False, loc="upper right", ncols=2)
    axes.grid(alpha=0.25)
    axes.margins(x=0.01)
    axes.tick_params(labelbottom=False)
    return axes


def draw_residual(axes: "Axes", comparison: "Comparison") -> "Axes":
    """Draw measured less simulated, on the band of the sensor noise."""
    band = 2 * np.degrees(comparison.noise.std)
    axes.axhspan(-band, band, color=NOISE, alpha=0.3, lw=0, label="sensor noise ±2σ")
    for c in comparison.releases:
        axes.plot(c.time, np.degrees(c.residual), color=REAL, lw=0.8)
    axes.axhline(0, color=SIM, lw=0.8)
    axes.set_ylabel("residual [°]")
    axes.set_xlabel("time since release [s]")
    axes.legend(frameon=False, loc="upper right")
    axes.grid(alpha=0.25)
    return axes


def draw_torque(axes: "Axes", comparison: "Comparison") -> "Axes":
    """Draw the torque that the law lacks over angle and rate; blank where there was no data."""
    chart = comparison.torque
    most = float(np.nanmax(np.abs(chart.torque))) if np.isfinite(chart.torque).any() else 1.0
    mesh = axes.pcolormesh(
        np.degrees(chart.angle), chart.rate, chart.torque, cmap="PuOr", vmin=-most, vmax=most
    )
    bar = axes.figure.colorbar(mesh, ax=axes, pad=0.02)
    bar.set_label("missing torque [N·m]")
    axes.axhline(0, color="black", lw=0.5, alpha=0.5)
    axes.axvline(0, color="black", lw=0.5, alpha=0.5)
    axes.set_xlabel("tilt from rest [°]")
    axes.set_ylabel("roll rate [rad/s]")
    axes.set_title("what the model lacks (blank: no data)", loc="left", fontsize=10)
    return axes


def draw_backbone(axes: "Axes", comparison: "Comparison") -> "Axes":
    """Draw the period of every half swing against its amplitude: level for a linear joint."""
    for backbone, colour, marker, label in (
        (comparison.measured_backbone, REAL, "o", "measured"),
        (comparison.simulated_backbone, SIM, "x", "simulated"),
    ):
        axes.plot(
            np.degrees(backbone.amplitude), 1e3 * backbone.period, marker, color=colour, ms=5, label=label
        )
    axes.set_xlabel("amplitude of the half swing [°]")
    axes.set_ylabel("period [ms]")
    axes.set_xlim(left=0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)
    axes.set_title("backbone", loc="left", fontsize=10)
    return axes
