"""A ride as a picture: path, speed, heading, tilt, feet and wheels."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from policy_runtime.evaluation.recording import Recording
from reports.figures.palette import BAD, GOOD, NOISE, SERIES, SIM
from reports.figures.style import styled
from sim.skate.cycle.clock import STILL_SPEED, Clock
from sim.skate.robot.g1 import servos
from sysid.files import write_figure
from sysid.quantity import Quantity
from sysid.roll import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PALE = "#7FB8DA"
"""A second simulated curve beside the first."""
PHASES = {"push": "#E6EEF7", "mount": "#F3EBDD", "steer": "#E3F1EA", "dismount": "#F3EBDD"}
"""Background of each phase of the cycle."""
LANES = (
    "left foot: ground",
    "left foot: deck",
    "right foot: ground",
    "right foot: deck",
    "all wheels: ground",
)


def ride_figure(recording: Recording, title: str, path: Path) -> None:
    """Draw a recorded ride as a PNG file."""
    lean = np.degrees(np.arccos(np.clip(recording.column("upright"), -1, 1)))
    heading = np.degrees(np.unwrap(recording.column("board_heading")))
    target = np.degrees(recording.column("target_heading"))
    told: dict[str, Any] = {"color": "black", "ls": "--", "lw": 1}
    trucks = np.degrees(recording.column("trucks"))[:, 0]
    with styled(11, 8) as figure:
        figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
        halves: Any = figure.subfigures(1, 2, width_ratios=(1.0, 1.5))
        left, right = halves
        above, below = left.subplots(2, 1, height_ratios=(1.6, 1.0))
        _path(above, recording)
        _torques(below, recording)
        rows: list[Axes] = list(right.subplots(5, 1, sharex=True))
        curves: Any = (
            ("speed\n[m/s]", ("commanded", recording.column("command")[:, 0], told), ("board", recording.column("board_speed"), {})),
            ("heading\n[°]", ("target", target, told), ("board", heading, {})),
            ("angle\n[°]", ("deck roll", np.degrees(recording.column("roll")), {}), ("front truck", trucks, {"color": PALE})),
            ("pelvis lean\n[°]", ("", lean, {})),
        )  # fmt: skip
        for axes, (label, *drawn) in zip(rows, curves, strict=False):
            for name, values, style in drawn:
                usual: Any = {"color": SIM, "lw": 1.5, "label": name}
                axes.plot(recording.column("time"), values, **(usual | style))
            axes.set_ylabel(label)
            if len(drawn) > 1:
                axes.legend(ncols=2)
        rows[3].set_ylim(bottom=0)
        _feet(rows[4], recording)
        for axes in rows:
            _shade(axes, recording)
            axes.margins(x=0)
        rows[-1].set_xlabel("time [s]")
    write_figure(path, figure, dpi=120)


def _path(axes: "Axes", recording: Recording) -> None:
    where, pelvis = recording.column("board_position"), recording.column("pelvis_position")
    axes.plot(pelvis[:, 0], pelvis[:, 1], color=NOISE, lw=1, label="pelvis")
    axes.plot(where[:, 0], where[:, 1], color=SIM, lw=2, label="board")
    axes.plot(*where[0, :2], "o", color=GOOD, label="start")
    axes.plot(*where[-1, :2], "s", color=BAD, label="end")
    axes.set(title="path from above", xlabel="x [m]", ylabel="y [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend()


def _torques(axes: "Axes", recording: Recording) -> None:
    share = np.abs(recording.column("torque")) / servos().effort
    axes.plot(recording.column("time"), share.max(axis=1), color=SIM, lw=1, label="hardest worked")
    axes.plot(recording.column("time"), share.mean(axis=1), color=NOISE, lw=1, label="mean of 23")
    axes.set(title="motor torque", xlabel="time [s]", ylabel="share of its limit", ylim=(0, 1.05))
    axes.legend()


def _feet(axes: "Axes", recording: Recording) -> None:
    ground, deck = recording.column("foot_on_ground"), recording.column("foot_on_deck")
    wheels = recording.column("wheel_on_ground").all(axis=1)
    lanes = (ground[:, 0], deck[:, 0], ground[:, 1], deck[:, 1], wheels)
    for i, flags in enumerate(lanes):
        spans = [(start, end - start) for start, end in _spans(recording.column("time"), flags)]
        axes.broken_barh(spans, (len(lanes) - 1 - i + 0.15, 0.7), color=SIM if i < 4 else NOISE)
    axes.set_yticks([len(lanes) - 0.5 - i for i in range(len(lanes))], LANES, fontsize=8)
    axes.set_ylim(0, len(lanes))


def _spans(time: Array, flags: Array) -> list[tuple[float, float]]:
    """Return beginning and end of every interval in which a flag is set [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    ends = np.append(time, time[-1] + 0.02)
    return [(float(ends[a]), float(ends[b])) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _shade(axes: "Axes", recording: Recording) -> None:
    step, clock = recording.column("step"), Clock()
    moves = ~clock.waiting(step, recording.column("command")[:, 0] < STILL_SPEED)
    flags = (clock.pushing, clock.mounting, clock.steering, clock.dismounting)
    for (name, colour), flag in zip(PHASES.items(), flags, strict=True):
        for start, end in _spans(recording.column("time"), flag(step) & moves):
            axes.axvspan(start, end, color=colour, zorder=0, lw=0)
            if axes.get_subplotspec().is_first_row():  # pyright: ignore[reportOptionalMemberAccess]
                above = axes.get_xaxis_transform()
                axes.text((start + end) / 2, 1.02, name, transform=above, fontsize=7, ha="center")


def paths_figure(paths: tuple[Array, ...], headings: Array, title: str, path: Path) -> None:
    """Draw the paths of several episodes, and turns achieved against turns asked for.

    Args:
        paths: x, y and heading of the board, each of shape (t, 3).
        headings: See `policy_runtime.evaluation.metrics.reachable_headings`, shape (m, 3).
    """
    with styled(10, 4.5) as figure:
        figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
        left, right = figure.subplots(1, 2)
        for line in paths:
            left.plot(line[:, 0], line[:, 1], color=SIM, alpha=0.5, lw=1.2)
            left.plot(*line[-1, :2], ".", color=BAD)
        left.set(title=f"paths of the first {len(paths)} episodes", xlabel="x [m]", ylabel="y [m]")
        left.set_aspect("equal", adjustable="datalim")
        right.axline((0, 0), slope=1, color=NOISE, lw=1, ls="--", label="as asked")
        if len(headings):
            asked, done = np.degrees(headings[:, 0]), np.degrees(headings[:, 1])
            right.plot(asked, done, "o", ms=4, alpha=0.5, color=SIM, label="one steering phase each")
        else:
            right.text(0.5, 0.5, "no steering phase came to its end", transform=right.transAxes, ha="center")
        right.set(title="turns", xlabel="asked for [°]", ylabel="achieved [°]")
        right.legend()
    write_figure(path, figure, dpi=120)


def suite_figure(shares: list[tuple[str, str, Quantity]], title: str, path: Path) -> None:
    """Draw which share of the rides lasts, with 95 % intervals; rows of a condition stand together, the first on top."""
    from matplotlib.patches import Patch

    conditions = list(dict.fromkeys(condition for condition, _, _ in shares))
    policies = list(dict.fromkeys(policy for _, policy, _ in shares))
    colours = {policy: SERIES[number % len(SERIES)] for number, policy in enumerate(policies)}
    height = 0.8 / len(policies)
    with styled(8, 1.4 + 0.36 * max(len(conditions), len(shares) / 2)) as figure:
        axes = figure.subplots()
        for condition, policy, share in shares:
            if np.isfinite(share.value):
                place = policies.index(policy) - (len(policies) - 1) / 2
                row = conditions.index(condition) + height * place
                axes.barh(row, share.value, color=colours[policy], height=0.9 * height)
                axes.plot(share.ci95, (row, row), color=NOISE, lw=2)
        axes.set_yticks(range(len(conditions)), conditions)
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        axes.set(xlim=(0, 1.02), xlabel="share of the rides that last, with 95 % interval", title=title)
        patches = [Patch(color=colour, label=policy) for policy, colour in colours.items()]
        figure.legend(handles=patches, loc="outside upper right", ncols=len(policies))
    write_figure(path, figure, dpi=120)
