"""Measured and simulated decays as Rerun recordings.

One time line for all: seconds since the release. Each release has a tab, and all of them move side by side in 3-D. The whole
log with its phases is aligned at its first release.
"""

import hashlib
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from reports.evidence import Evidence
from reports.figures.decay import envelope
from reports.figures.palette import NOISE, REAL, SIM
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
from sysid.decay.peaks import Peak, find_peaks
from sysid.free_decay import FreeDecay
from sysid.releases import Phase, log_phases
from sysid.releases.clear import CLEAR_AMPLITUDE
from sysid.roll import Array, Release, Roll
from sysid.shown import MOST_SHOWN

if TYPE_CHECKING:
    import rerun as rr
    import rerun.blueprint as rrb

    from reports.rerun.film_frames import FilmFrames

LADDER = ("#CC79A7", "#F0E442", "#009E73", "#D55E00")
"""Simpler models; the board's own law is blue."""
POSES = 50.0
"""Poses a second of the slow tail; while the deck moves, all samples are kept [Hz]."""
ENVELOPE = "#777777"
MEASURED, SIMULATED = Look("real", REAL, 3.5), Look("sim", SIM, 1.4)
PHASES = {"rest": "#555555", "held": REAL, "free": SIM, "caught": "#CC79A7"}


def decay_recording(path: Path, roll: Roll, decay: FreeDecay, summary: str) -> None:
    """Write the recording of one log and of the linear decay found in it, with a summary in Markdown."""
    import rerun.blueprint as rrb

    phases = log_phases(roll, decay.releases)
    signal = decay.trace.signal
    tabs: list[rrb.View | rrb.Container] = []
    last = 0.0
    for release, fitted in zip(decay.releases, decay.trace.releases, strict=True):
        root = f"release{release.number}"
        since = fitted.trace.time - release.start
        span = _window(since, fitted.modelled - fitted.level)
        last = max(last, span[1])
        error = float(np.abs(fitted.residual).max())
        whole = _signal(release, signal)
        tabs.append(_release_tab(root, f"release {release.number}", signal, span, whole, error))
    first = decay.releases[0].start
    beside = rrb.Vertical(
        *_log_views("log", roll, first), rrb.TextDocumentView(origin="summary", name="summary")
    )
    blueprint = _blueprint(rrb.Tabs(*tabs, name="releases"), beside, last)
    with recording(path, _identity(summary, "decay", roll.log), blueprint) as stream:
        _log_whole_log(stream, "log", roll, phases, first)
        for i, (release, peaks) in enumerate(zip(decay.releases, decay.peaks, strict=True)):
            _log_fitted(stream, f"release{release.number}", decay, i)
            _log_peaks(stream, f"log/roll/peaks{release.number}", peaks, first)
        rests = [rest.value for rest in decay.rest_angles]
        values = zip(decay.numbers.to_json(), decay.numbers.items(), strict=True)
        numbers = {name: quantity.value for name, (_, quantity) in values if np.isfinite(quantity.value)}
        log_summary(stream, summary, {"log": roll.log, "rest_angles": rests, **numbers})


def _log_fitted(stream: "rr.RecordingStream", root: str, decay: FreeDecay, number: int) -> None:
    """Log one release with the linear decay fitted to it, its envelope, residual and peaks."""
    release, fitted = decay.releases[number], decay.trace.releases[number]
    measured, since = _signal(release, decay.trace.signal), fitted.trace.time - release.start
    signal = f"{root}/signal"
    log_series(stream, f"{signal}/measured", release.time - release.start, measured, MEASURED)
    # Its entity comes after 'measured': curves are drawn in that order.
    log_series(stream, f"{signal}/model", since, fitted.modelled, SIMULATED._replace(name="linear decay"))
    _log_band(stream, root, since, -fitted.residual, decay.floor.std, "linear decay - real")
    reach = envelope(fitted, since, decay.trace.omega_n * decay.trace.damping_ratio)
    for name, curve in (("above", fitted.level + reach), ("below", fitted.level - reach)):
        look = Look(f"envelope {name}", ENVELOPE, 0.8)
        log_series(stream, f"{signal}/envelope_{name}", since, curve, look)
    if decay.trace.signal == "roll":
        _log_peaks(stream, f"{signal}/peaks", decay.peaks[number], release.start)


def _log_peaks(stream: "rr.RecordingStream", entity: str, peaks: Sequence[Peak], first: float) -> None:
    """Log turning points, if there are any; their time counts from the first release's [s]."""
    if peaks:
        times, values = np.array([(peak.time - first, peak.roll) for peak in peaks]).T
        log_series(stream, entity, times, values, Look("peaks", REAL, 5.0), points=True)


def comparison_recording(
    path: Path, evidence: Evidence, summary: str, films: "Sequence[FilmFrames]" = ()
) -> None:
    """Write the recording of a board beside its logs and the frames of those that are films, with a summary in Markdown."""
    import rerun.blueprint as rrb

    result = evidence.comparison
    kind = "rate" if result.is_rate else "roll"
    many = len({release.log for release in result.releases}) > 1
    tabs: list[rrb.View | rrb.Container] = []
    last = 0.0
    for i, release in enumerate(result.releases):
        span = _shown(release, result)
        last = max(last, span[1])
        name = f"{Path(release.log).stem} {release.number}" if many else f"release {release.number}"
        error = float(np.abs(release.residual).max())
        tabs.append(_release_tab(f"release{i + 1}", name, kind, span, release.measured, error))
    right: list[rrb.View | rrb.Container] = [rrb.TextDocumentView(origin="summary", name="summary")]
    right += [rrb.Spatial2DView(origin="missing_torque", name="missing torque")] if result.missing else []
    right += [rrb.Spatial2DView(origin=f"film{i + 1}", name="film") for i in range(len(films))]
    for i, roll in enumerate(evidence.rolls):
        views = _log_views(f"log{i + 1}", roll, _first(evidence, roll))
        right.append(rrb.Vertical(*views, name=f"log {Path(roll.log).name}"))
    beside: rrb.Container = rrb.Tabs(*right)
    if evidence.board.geometry:  # else there is no shape to draw
        scene = rrb.Spatial3DView(
            origin="world", name="simulated (solid), measured (ghost)", eye_controls=_eye(evidence)
        )
        beside = rrb.Vertical(scene, beside, row_shares=[1, 1])
    blueprint = _blueprint(rrb.Tabs(*tabs, name="releases"), beside, last)
    with recording(
        path, _identity(summary, evidence.board.name, *(roll.log for roll in evidence.rolls)), blueprint
    ) as stream:
        for i, (roll, phases) in enumerate(zip(evidence.rolls, evidence.phases, strict=True)):
            _log_whole_log(stream, f"log{i + 1}", roll, phases, _first(evidence, roll))
        for i, release in enumerate(result.releases):
            _log_release(stream, f"release{i + 1}", release, evidence, i)
        if evidence.board.geometry:
            _log_boards(stream, evidence)
        _log_missing(stream, result)
        for i, film in enumerate(films):
            film.log(stream, f"film{i + 1}")
        log_summary(stream, summary, _board_properties(evidence))


def _first(evidence: Evidence, roll: Roll) -> float:
    """Return when the first release of a log begins, on the log's clock [s]."""
    return evidence.releases_of(roll)[0].start


def _log_release(
    stream: "rr.RecordingStream", root: str, release: ComparedRelease, evidence: Evidence, number: int
) -> None:
    signal, result, measured = f"{root}/signal", evidence.comparison, evidence.releases[number]
    log_series(stream, f"{signal}/measured", release.time, release.measured, MEASURED)
    for j, rung in enumerate(evidence.ladder[:-1]):
        look = Look(rung.label, LADDER[j % len(LADDER)], 1.0)
        log_series(stream, f"{signal}/model{j}", release.time, rung.simulated[number], look)
    log_series(stream, f"{signal}/simulated", release.time, release.simulated, SIMULATED)
    _log_band(stream, root, release.time, release.residual, result.noise.std)
    if not result.is_rate:
        _log_peaks(stream, f"{signal}/peaks", _peaks(measured, result), measured.start)


def _peaks(release: Release, result: Comparison) -> list[Peak]:
    """Return the measured turning points."""
    law = result.law
    decay = law.damping / (2 * law.inertia)
    if decay >= law.frequency:
        return []
    damped = float(np.sqrt(law.frequency**2 - decay**2))
    rest = law.rest_angle if release.zero == "known" else release.rest
    return find_peaks(release, rest, law.frequency, damped, result.noise.std)


def _log_band(
    stream: "rr.RecordingStream",
    root: str,
    time: Array,
    residual: Array,
    noise: float,
    name: str = "sim - real",
) -> None:
    """Log a residual over the band of ±2σ of the sensor's noise, in thousandths: Rerun's axis labels are short."""
    log_series(stream, f"{root}/residual/error", time, 1e3 * residual, Look(name, SIM, 1.0))
    ends = np.array([time[0], time[-1]])
    for sign, side in ((2, "upper"), (-2, "lower")):
        look = Look(f"noise {sign:+d}σ", NOISE, 1.2)
        log_series(stream, f"{root}/residual/noise_{side}", ends, np.full(2, sign * 1e3 * noise), look)


def _log_whole_log(
    stream: "rr.RecordingStream", root: str, roll: Roll, phases: Sequence[Phase], first: float
) -> None:
    log_series(stream, f"{root}/roll/measured", roll.time - first, roll.roll, Look("roll", REAL))
    log_states(stream, f"{root}/phase", [(phase.start - first, phase.kind) for phase in phases], PHASES)


def _log_boards(stream: "rr.RecordingStream", evidence: Evidence) -> None:
    """Log the board twice for each release, side by side: simulated solid, measured as a ghost."""
    import rerun as rr

    from sim.board.scene import TILT_JOINT, TRUCK_JOINTS, board_spec, steering_angle

    result, board = evidence.comparison, evidence.board
    model = board_spec(board, ground=False).compile()
    rake = board.geometry["rake"].value
    tilt = int(model.joint(TILT_JOINT).qposadr[0])
    trucks = [int(model.joint(name).qposadr[0]) for name in TRUCK_JOINTS]
    rest = np.array(model.qpos0)
    rest[2] = board.geometry["truck_height"].value + board.geometry["wheel_radius"].value
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    before = min([-1.0, *(float(roll.time[0]) - _first(evidence, roll) for roll in evidence.rolls)])
    for i, release in enumerate(result.releases[:MOST_SHOWN]):
        kept = _moving(release, result)
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
            # Before its release the deck is held at its start.
            time = np.r_[before, release.time[kept]]
            log_poses(stream, root, model, time, np.vstack([positions[:1], positions]))
        label = [0.0, -_spacing(board) * i, 0.28]
        name = f"{Path(release.log).stem} {release.number}"
        stream.log(f"world/name{i + 1}", rr.Points3D([label], labels=[name], radii=[0.0]), static=True)


def _moving(release: ComparedRelease, result: Comparison) -> npt.NDArray[np.int64]:
    """Return the samples whose poses are logged: all while the deck moves, few of the rest."""
    step = float(np.median(np.diff(release.time)))
    end = int(np.searchsorted(release.time, _shown(release, result)[1]))
    stride = max(1, round(1 / POSES / step))
    return np.unique(np.r_[0:end, end : len(release.time) : stride]).astype(np.int64)


def _log_missing(stream: "rr.RecordingStream", result: Comparison) -> None:
    """Log the missing torque as a picture with axes."""
    import rerun as rr

    if result.missing is None:
        return
    from matplotlib.figure import Figure

    from reports.figures.compare import draw_profile, profiles

    figure = Figure(figsize=(6.4, 6.4), layout="constrained")
    drawn = profiles(result.missing, slides=result.slides)
    for axes, (profile, show) in zip(figure.subplots(2, 1), drawn, strict=True):
        draw_profile(axes, profile, show, slides=result.slides)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=130, facecolor="white")
    image = rr.EncodedImage(contents=picture.getvalue(), media_type="image/png")
    stream.log("missing_torque", image, static=True)


def _release_tab(
    root: str, name: str, kind: str, span: tuple[float, float], measured: Array, error: float
) -> "rrb.Vertical":
    """Return one release's overlay over its residual; ranges are given, since found ones drift while drawing."""
    import rerun.blueprint as rrb

    unit = "rad" if kind == "roll" else "rad/s"
    low, high = float(measured.min()), float(measured.max())
    pad = 0.08 * (high - low)
    reach = 1.15 * 1e3 * error
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


def _eye(evidence: Evidence) -> "rrb.EyeControls3D":
    """Return a place behind the boards from which all of them are seen."""
    import rerun.blueprint as rrb

    count = min(len(evidence.comparison.releases), MOST_SHOWN)
    middle = -_spacing(evidence.board) * (count - 1) / 2
    back = 0.62 + 0.42 * _spacing(evidence.board) * count
    return rrb.EyeControls3D(position=(-back, middle, 0.3), look_target=(0.0, middle, 0.08))


def _spacing(board: Board) -> float:
    return 1.9 * board.geometry["width"].value


def _shown(release: ComparedRelease, result: Comparison) -> tuple[float, float]:
    """Return the times between which the measured or the simulated deck moves [s]: a wrong law may rest long before."""
    begin, end = _window(release.time, release.simulated)
    return begin, max(end, _window(release.time, release.measured, CLEAR_AMPLITUDE * result.noise.std)[1])


def _window(time: Array, motion: Array, least: float = 0.0) -> tuple[float, float]:
    """Return the times between which there is something to see [s]: a motion about rest of at least that size."""
    rest = float(np.median(motion[len(motion) * 3 // 4 :]))
    size = np.abs(motion - rest)
    moving = np.flatnonzero(size > max(0.01 * float(size.max()), least))
    end = float(time[moving[-1]]) if len(moving) else float(time[-1])
    return -0.03 * end, min(1.6 * end, float(time[-1]))


def _signal(release: Release, kind: str) -> Array:
    return release.roll if kind == "roll" or release.rate is None else release.rate


def _identity(summary: str, name: str, *logs: str) -> str:
    """Return a name for a recording that is another one when its numbers are."""
    digest = hashlib.sha256(summary.encode()).hexdigest()[:8]
    return " ".join([name, *(Path(log).stem for log in logs), digest])


def _board_properties(evidence: Evidence) -> dict[str, object]:
    board, result = evidence.board, evidence.comparison
    return {
        "board": board.name,
        "inertia": board.inertia.value,
        "stiffness": board.stiffness,
        "damping": board.damping,
        "effects": [part.name for part in board.effects] or ["none"],
        "rmse": result.rmse,
        "nrmse": result.nrmse,
        "noise_floor": result.noise.std,
        "logs": [file.path for file in evidence.files] or [roll.log for roll in evidence.rolls],
        "sha256": [file.digest for file in evidence.files] or None,
    }
