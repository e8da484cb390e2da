"""One quantity of many jobs with its intervals, side by side."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from reports.figures.palette import SIM
from sysid.batch.jobs import ENDS, column

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LABELS = {"stiffness": "k [N·m/rad]", "damping": "d [N·m·s/rad]"}


def batch_figure(rows: "Sequence[Mapping[str, Any]]", key: str) -> "Figure":
    """Draw 'stiffness' or 'damping' of some jobs, one line a job, one panel a board; hollow where a decay was not linear."""
    from matplotlib.figure import Figure

    boards = list(dict.fromkeys(row.get("board", "") for row in rows))
    groups = [[row for row in rows if row.get("board", "") == board] for board in boards]
    sizes = [len(group) for group in groups]
    figure = Figure(figsize=(8.0, 0.9 * len(groups) + 0.24 * len(rows)))
    panels = figure.subplots(len(groups), 1, squeeze=False, height_ratios=sizes)[:, 0]
    for axes, board, group in zip(panels, boards, groups, strict=True):
        for place, row in enumerate(group):
            value, low, high = (row[column(key, end)] for end in ENDS)
            inside = "none" if row.get("verdict") == "not linear" else SIM
            reach = [[value - low], [high - value]]
            axes.errorbar(value, place, xerr=reach, fmt="o", color=SIM, mfc=inside, ms=4.5, capsize=2)
        axes.set_yticks(range(len(group)), [row["job"] for row in group])
        axes.set_ylim(len(group) - 0.5, -0.5)
        axes.set_title(board, loc="left")
    panels[-1].set_xlabel(LABELS[key])
    return figure
