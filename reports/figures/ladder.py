"""The ladder: how the error falls as one effect after another is added."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from reports.figures.decay import STYLE
from reports.figures.palette import HELD_OUT, NOISE, SIM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sysid.fitting.ladder import Rung


def ladder_figure(rungs: "Sequence[Rung]", floor: float, title: str, unit: str = "rad") -> "Figure":
    """Draw training and held-out error of each rung against the noise floor.

    Args:
        rungs: From the simplest model to the last.
        floor: Noise floor in the same unit.
        title: Heading.
        unit: 'rad' (drawn in degrees) or 'rad/s'.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    scale = np.degrees(1.0) if unit == "rad" else 1.0
    shown = "°" if unit == "rad" else unit
    x = np.arange(len(rungs))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(max(4.6, 1.5 * len(rungs) + 2.2), 3.4), layout="constrained")
        axes = figure.add_subplot()
        axes.bar(x - 0.18, [scale * r.rmse for r in rungs], 0.34, color=SIM, label="fitted releases")
        axes.bar(
            x + 0.18, [scale * r.heldout_rmse for r in rungs], 0.34, color=HELD_OUT, label="held-out releases"
        )
        axes.axhline(scale * floor, color=NOISE, linestyle="--", linewidth=1.2, label="noise floor")
        for place, rung in zip(x, rungs, strict=True):
            for shift, value in ((-0.18, rung.rmse), (0.18, rung.heldout_rmse)):
                axes.annotate(
                    f"{scale * value:.3g}",
                    (place + shift, scale * value),
                    ha="center",
                    va="bottom",
                    fontsize=7.5,
                )
        axes.set_xticks(x, [rung.label.replace("and ", "and\n") for rung in rungs])
        axes.set_ylabel(f"RMS error [{shown}]")
        axes.set_title(title)
        axes.margins(y=0.16)
        axes.grid(visible=False, axis="x")
        axes.legend(loc="upper right")
    return figure
