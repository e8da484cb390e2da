"""The paper's figures: paths, learning curves, and success over stiffness, speed and delay."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from reports.figures.palette import BAD, SERIES, SIM
from sysid.files import write_figure
from sysid.roll import Array

DASHES = ("-", "--", ":")
"""Of lines, once all colours are taken."""


def trajectories_figure(panels: Sequence[tuple[str, Sequence[Array]]], path: Path) -> None:
    """Draw paths of the board, one panel for each policy and board: x [m], y [m] and heading [rad], shape (t, 3) each."""
    from matplotlib.figure import Figure

    columns = max(1, min(4, len(panels)))
    rows = max(1, -(-len(panels) // columns))
    figure = Figure(figsize=(3.1 * columns, 4.0 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axis in axes.flat[len(panels) :]:
        axis.remove()
    for axis, (title, paths) in zip(axes.flat, panels, strict=False):
        for line in paths:
            axis.plot(line[:, 0], line[:, 1], color=SIM, alpha=0.6, lw=1.2)
            axis.plot(*line[-1, :2], ".", color=BAD, ms=4)
        axis.set_title(f"{title}\n{len(paths)} rides", loc="left", fontsize=9)
        axis.set(xlabel="x [m]", ylabel="y [m]")
        axis.set_aspect("equal", adjustable="box")
        axis.grid(alpha=0.3)
    for axis in axes.flat[max(len(panels) - columns, 0) : len(panels)]:  # the lowest of each column
        axis.tick_params(labelbottom=True)
    write_figure(path, figure, dpi=120)


def curves_figure(
    curves: Mapping[str, Sequence[Mapping[str, float]]], columns: Sequence[tuple[str, str, str]], path: Path
) -> None:
    """Draw learning curves over iterations, a mapping an iteration for each run; columns with title and unit of each panel."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 6.5), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    for axis, (column, title, unit) in zip(axes.flat, columns, strict=True):
        for i, (name, rows) in enumerate(curves.items()):
            values = np.array([[row["iteration"], row.get(column, np.nan)] for row in rows])
            dashes = DASHES[i // len(SERIES) % len(DASHES)]
            axis.plot(*values.T, dashes, color=SERIES[i % len(SERIES)], lw=1.1, label=name)
        axis.set_title(title if unit == "1" else f"{title} [{unit}]", loc="left", fontsize=10)
        axis.grid(alpha=0.3)
        axis.set_ylim(0, None)
    for axis in axes[-1]:
        axis.set_xlabel("iteration")
    figure.legend(
        *axes.flat[0].get_legend_handles_labels(), loc="outside right center", fontsize=8, frameon=False
    )
    write_figure(path, figure, dpi=120)


def map_figure(
    grids: Mapping[tuple[str, float], Sequence[Sequence[float]]],
    stiffness: Sequence[float],
    speed: Sequence[float],
    path: Path,
) -> None:
    """Draw the share of rides that last over stiffness and speed, one panel for each policy and delay.

    Args:
        grids: By policy and delay [s], shares with one row a speed and one column a stiffness.
        stiffness: Factors of the record's.
        speed: [m/s]
    """
    from matplotlib.figure import Figure

    policies = list(dict.fromkeys(policy for policy, _ in grids))
    delays = list(dict.fromkeys(delay for _, delay in grids))
    figure = Figure(figsize=(3.4 * len(delays) + 0.6, 2.6 * len(policies) + 0.4), layout="constrained")
    axes = figure.subplots(len(policies), len(delays), squeeze=False, sharex=True, sharey=True)
    image = None
    for (policy, delay), grid in grids.items():
        axis = axes[policies.index(policy), delays.index(delay)]
        image = axis.imshow(np.asarray(grid), vmin=0, vmax=1, cmap="cividis", aspect="auto", origin="lower")
        for (i, j), share in np.ndenumerate(np.asarray(grid)):
            ink = "black" if share > 0.5 else "white"
            axis.text(j, i, f"{share:.2f}", ha="center", va="center", fontsize=8, color=ink)
        axis.set_title(f"{policy}, {delay * 1e3:.0f} ms", loc="left", fontsize=10)
        axis.set_xticks(range(len(stiffness)), [f"{k:g}" for k in stiffness])
        axis.set_yticks(range(len(speed)), [f"{v:g}" for v in speed])
    for axis in axes[-1]:
        axis.set_xlabel("stiffness, of the record's")
    for axis in axes[:, 0]:
        axis.set_ylabel("speed [m/s]")
    if image is not None:
        figure.colorbar(image, ax=axes, label="share of rides that last", shrink=0.9)
    write_figure(path, figure, dpi=120)
