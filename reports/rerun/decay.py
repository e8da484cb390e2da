"""Measured and simulated decays as a Rerun recording.

One time line for all: seconds since the release. Each release has a tab, and all of them move side by side in 3-D. The whole
log with its phases is aligned at its first release.
"""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from reports.figures.palette import NOISE, REAL, SIM
from reports.figures.svg import MOST_POINTS
from reports.rerun.stream import (
    TIMELINE,
    Look,
    log_model,
    log_poses,
    log_series,
    log_states,
    log_summary,
    recording,
)
from sysid.board import Board
from sysid.comparison.compare import ComparedRelease, Comparison
from sysid.recording import Recording
from sysid.roll import Roll
from sysid.shown import MOST_SHOWN

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

MEASURED, SIMULATED = Look("real", REAL, 3.5), Look("sim", SIM, 1.4)
PHASES = {"rest": "#555555", "held": REAL, "free": SIM, "caught": "#CC79A7"}


def comparison_recording(
    path: Path, board: Board, recordings: Sequence[Recording], result: Comparison, summary: str
) -> None:
    """Write the recording of a board beside its logs, with a summary in Markdown."""
    import rerun.blueprint as rrb

    many = len(recordings) > 1
    tabs: list[rrb.View | rrb.Container] = []
    for i, release in enumerate(result.releases):
        name = f"{Path(release.log).stem} {release.number}" if many else f"release {release.number}"
        tabs.append(_release_tab(f"release{i + 1}", name, release, result))
    right: list[rrb.View | rrb.Container] = [rrb.TextDocumentView(origin="summary", name="summary")]
    for i, one in enumerate(recordings):
        views = _log_views(f"log{i + 1}", one.roll, one.releases[0].start)
        right.append(rrb.Vertical(*views, name=f"log {one.path.name}"))
    beside: rrb.Container = rrb.Tabs(*right)
    if board.geometry:  # else there is no shape to draw
        eye = _eye(len(result.releases), board)
        scene = rrb.Spatial3DView(
            origin="world", name="simulated (solid), measured (ghost)", eye_controls=eye
        )
        beside = rrb.Vertical(scene, beside, row_shares=[1, 1])
    last = max(float(release.time[-1]) for release in result.releases)
    blueprint = _blueprint(rrb.Tabs(*tabs, name="releases"), beside, last)
    # Another recording when its numbers are others.
    digest = hashlib.sha256(summary.encode()).hexdigest()[:8]
    identity = " ".join([board.name, *(one.path.stem for one in recordings), digest])
    with recording(path, identity, blueprint) as stream:
        for i, one in enumerate(recordings):
            root, roll, first = f"log{i + 1}", one.roll, one.releases[0].start
            log_series(stream, f"{root}/roll/measured", roll.time - first, roll.roll, Look("roll", REAL))
            states = [(phase.start - first, phase.kind) for phase in one.phases]
            log_states(stream, f"{root}/phase", states, PHASES)
        for i, release in enumerate(result.releases):
            _log_release(stream, f"release{i + 1}", release, result.noise.std)
        if board.geometry:
            before = min(-1.0, *(float(one.roll.time[0]) - one.releases[0].start for one in recordings))
            _log_boards(stream, board, result, before)
        log_summary(stream, summary)


def _log_release(stream: "rr.RecordingStream", root: str, release: ComparedRelease, noise: float) -> None:
    """Log one release, and its residual over the band of ±2σ of the noise, in thousandths: Rerun's axis labels are short."""
    log_series(stream, f"{root}/signal/measured", release.time, release.measured, MEASURED)
    log_series(stream, f"{root}/signal/simulated", release.time, release.simulated, SIMULATED)
    error = Look("sim - real", SIM, 1.0)
    log_series(stream, f"{root}/residual/error", release.time, 1e3 * release.residual, error)
    ends = release.time[[0, -1]]
    for sign, side in ((2, "upper"), (-2, "lower")):
        look = Look(f"noise {sign:+d}σ", NOISE, 1.2)
        log_series(stream, f"{root}/residual/noise_{side}", ends, np.full(2, sign * 1e3 * noise), look)


def _log_boards(stream: "rr.RecordingStream", board: Board, result: Comparison, before: float) -> None:
    """Log the board twice for each release, side by side: simulated solid, measured as a ghost.

    From the time `before` [s] to its release the deck is held at its start.
    """
    import rerun as rr

    from sim.board.scene import TILT_JOINT, TRUCK_JOINTS, board_spec, steering_angle

    model = board_spec(board, ground=False).compile()
    rake = board.geometry["rake"].value
    tilt = int(model.joint(TILT_JOINT).qposadr[0])
    trucks = [int(model.joint(name).qposadr[0]) for name in TRUCK_JOINTS]
    rest = np.array(model.qpos0)
    rest[2] = board.geometry["truck_height"].value + board.geometry["wheel_radius"].value
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for i, release in enumerate(result.releases[:MOST_SHOWN]):
        kept = np.arange(0, len(release.time), -(-len(release.time) // MOST_POINTS))
        measured = release.roll if result.is_rate else release.measured
        for root, roll, tint, alpha in (
            (f"world/simulated{i + 1}", release.roll, SIM, 1.0),
            (f"world/measured{i + 1}", measured, REAL, 0.35),
        ):
            positions = np.tile(rest, (len(kept), 1))
            positions[:, 1] = -_spacing(board) * i
            positions[:, tilt] = roll[kept]
            steer = np.array([steering_angle(angle, rake) for angle in roll[kept]])
            for address in trucks:
                positions[:, address] = steer
            log_model(stream, root, model, tint=tint if alpha < 1 else None, alpha=alpha)
            time = np.r_[before, release.time[kept]]
            log_poses(stream, root, model, time, np.vstack([positions[:1], positions]))
        label = [0.0, -_spacing(board) * i, 0.28]
        name = f"{Path(release.log).stem} {release.number}"
        stream.log(f"world/name{i + 1}", rr.Points3D([label], labels=[name], radii=[0.0]), static=True)


def _release_tab(root: str, name: str, release: ComparedRelease, result: Comparison) -> "rrb.Vertical":
    """Return one release's overlay over its residual; ranges are given, since found ones drift while drawing."""
    import rerun.blueprint as rrb

    kind, unit = ("rate", "rad/s") if result.is_rate else ("roll", "rad")
    span = float(release.time[0]), float(release.time[-1])
    low, high = float(release.measured.min()), float(release.measured.max())
    pad = 0.08 * (high - low)
    reach = 1.15 * 1e3 * float(np.abs(release.residual).max())
    views = (
        _curves(f"{root}/signal", f"{kind} [{unit}]", span, (low - pad, high + pad)),
        _curves(f"{root}/residual", f"residual [m{unit}]", span, (-reach, reach)),
    )
    return rrb.Vertical(*views, row_shares=[3, 1], name=name)


def _curves(
    origin: str, name: str, span: tuple[float, float], heights: tuple[float, float]
) -> "rrb.TimeSeriesView":
    """Return a view of curves between two times [s] and two heights."""
    import rerun as rr
    import rerun.blueprint as rrb

    start, end = (rr.TimeRangeBoundary.absolute(rr.TimeInt(seconds=at)) for at in span)
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
        axis_y=rrb.ScalarAxis(range=heights),
        plot_legend=rrb.Corner2D.RightTop,
    )


def _log_views(root: str, roll: Roll, first: float) -> "list[rrb.View]":
    """Return the whole log and its phases, over all of its time: else they take the range of a release's view.

    In the recording the first release, at `first` on the log's clock [s], is 0.
    """
    import rerun.blueprint as rrb

    reach = 1.1 * float(np.abs(roll.roll).max())
    span = float(roll.time[0]) - first, float(roll.time[-1]) - first
    whole = _curves(f"{root}/roll", "whole log: roll [rad]", span, (-reach, reach))
    return [whole, rrb.StateTimelineView(origin=f"{root}/phase", name="phases")]


def _blueprint(left: "rrb.Tabs", right: "rrb.Container", end: float) -> "rrb.Blueprint":
    """Return the layout; it opens playing the releases up to a time [s], again and again."""
    import rerun as rr
    import rerun.blueprint as rrb

    played = rrb.components.AbsoluteTimeRange(min=rr.TimeInt(seconds=0.0), max=rr.TimeInt(seconds=end))
    loop: Any = {"time_selection": played, "loop_mode": "selection", "play_state": "playing"}
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[3, 2]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", **loop),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )


def _eye(releases: int, board: Board) -> "rrb.EyeControls3D":
    """Return a place behind the boards from which all of them are seen."""
    import rerun.blueprint as rrb

    count = min(releases, MOST_SHOWN)
    middle = -_spacing(board) * (count - 1) / 2
    back = 0.62 + 0.42 * _spacing(board) * count
    return rrb.EyeControls3D(position=(-back, middle, 0.3), look_target=(0.0, middle, 0.08))


def _spacing(board: Board) -> float:
    return 1.9 * board.geometry["width"].value
