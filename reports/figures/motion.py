"""Reference motions as curves: legs, waist and arms over time, with the planted foot shaded."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from policy_runtime.motion.motions import Motion
from reports.figures.style import styled
from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.robot.g1 import JOINTS
from sysid.files import write_figure

ROWS = (
    ("left leg", ("left_hip_pitch", "left_knee", "left_ankle_pitch")),
    ("right leg", ("right_hip_pitch", "right_knee", "right_ankle_pitch")),
    ("waist", ("waist_yaw", "waist_pitch", "waist_roll")),
    ("arms", ("left_shoulder_pitch", "right_shoulder_pitch", "left_elbow")),
)
COLOURS = ("#0072B2", "#CC79A7", "#009E73")
"""Of the three curves of a row; apart for all common kinds of colour blindness."""


def motion_figure(motions: Sequence[Motion], planted: Sequence[npt.NDArray[np.bool_]], path: Path) -> None:
    """Draw clips side by side into a PNG file, shaded where the left foot stands, bool, shape (frames,) a clip."""
    with styled(1.5 + 3.2 * len(motions), 8) as figure:
        grid = figure.subplots(len(ROWS), len(motions), sharex="col", sharey="row", squeeze=False)
        for column, (motion, down) in enumerate(zip(motions, planted, strict=True)):
            time = CONTROL_PERIOD * np.arange(len(motion.joints))
            grid[0, column].set_title(motion.name)
            for axes, (title, names) in zip(grid[:, column], ROWS, strict=True):
                above = axes.get_xaxis_transform()
                axes.fill_between(time, 0, 1, where=down, color="0.9", lw=0, transform=above)
                for name, colour in zip(names, COLOURS, strict=True):
                    values = motion.joints[:, JOINTS.index(f"{name}_joint")]
                    axes.plot(time, values, color=colour, lw=1.3, label=name)
                axes.margins(x=0)
                if column == 0:
                    axes.set_ylabel(f"{title}\n[rad]")
                if column == len(motions) - 1:
                    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
            grid[-1, column].set_xlabel("time [s]; grey: left foot on the ground")
    write_figure(path, figure, dpi=110)
