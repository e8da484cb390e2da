"""The picture of a training run."""

import math
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from sysid.files import atomic_path

_PANELS = (
    ("episodes that last to the end", (("survival", "all episodes"),), (0, 1.02)),
    ("falls and wrong stances per minute of riding", (("falls_per_minute", "all causes"),), None),
    ("speed error while pushing [m/s]", (("speed_error", "mean |v − command|"),), None),
    ("heading error while steering [rad]", (("heading_error", "mean |heading − target|"),), None),
    (
        "contacts [share of steps]",
        (("both_feet", "both feet on deck, steering"), ("foot_down", "left foot down, pushing")),
        (0, 1.02),
    ),
    ("stride and stance [s]", (("stride_period", "stride"), ("stance_time", "stance")), None),
    ("foot travel [m], slip by load [m/s]", (("foot_travel", "travel"), ("slip", "slip")), None),
    ("reward per second", (("reward", "task"), ("style", "style [0–1], pushing")), None),
)
_COLOURS = ("#0072B2", "#E69F00")


def draw_curves(rows: Sequence[dict[str, float]], path: Path, title: str) -> Path:
    """Draw the run's curves against samples and return the picture's path.

    Args:
        rows: Rows of `RunFolder.read_curves`, at least one.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 6.5), layout="constrained")
    axes = figure.subplots(2, 4, sharex=True)
    samples = [row["samples"] / 1e6 for row in rows]
    for axis, (label, curves, limits) in zip(axes.flat, _PANELS, strict=True):
        _panel(axis, samples, rows, curves)
        axis.set_title(label, fontsize=10, loc="left")
        axis.set_ylim(limits or (0, None))
    for axis in axes[-1]:
        axis.set_xlabel("steps of the world [million]")
    iterations = rows[-1]["iteration"]
    # The shipped curves hold one iteration in five, and nan for lost ones: the mean stands for all.
    seconds = [row["collect_s"] + row["learn_s"] for row in rows]
    minutes = iterations * fmean(s for s in seconds if not math.isnan(s)) / 60
    figure.suptitle(
        f"{title}: {iterations:.0f} iterations, {samples[-1]:.0f} million steps, {minutes:.0f} min",
        x=0.01,
        ha="left",
    )
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=130)
    return path


def _panel(
    axis: Any, samples: Sequence[float], rows: Sequence[dict[str, float]], curves: Sequence[tuple[str, str]]
) -> None:
    for (name, label), colour in zip(curves, _COLOURS, strict=False):
        axis.plot(
            samples, [row.get(name, math.nan) for row in rows], color=colour, linewidth=1.3, label=label
        )
    axis.grid(alpha=0.25)
    axis.legend(frameon=False, fontsize=8)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
