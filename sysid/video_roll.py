"""Roll of the deck from a film taken from behind.

What is followed is a printed marker, two coloured stickers (or one dot on a pendulum), the deck's
straight edge, or its texture. From then on all is one: points in pictures, freed of lens, camera
shake and rolling shutter, and the angle of a body that turns about an axis seen at a slant.
"""

import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sysid.errors import HuskyError
from sysid.roll import Array, Roll
from sysid.video.options import VideoOptions as VideoOptions

if TYPE_CHECKING:
    from sysid.video.camera import Lens
    from sysid.video.choose import Chosen
    from sysid.video.frames import Clip
    from sysid.video.track import Track
    from sysid.video.turning import Turning

FEWEST_PER_PERIOD = 8
"""Frames a period below which the fastest part of a swing is guessed rather than seen."""
LEAST_SWING = np.radians(1.0)
"""A record that swings by less is suspect [rad]."""
MOST_SEEN = 0.6
"""Share of the frames in which what is followed must be seen."""
STEADY = 0.5
"""Change of velocity from frame to frame, as a share of it, up to which it counts as known."""
SHEAR_DOUBT = 0.1
"""Least deviation of a read-out time that is seen in the film, as a share of the frame interval."""
LONGEST_GAP = 3
"""Lost frames in a row that are interpolated over."""
READOUT_CEILING = 1 / 30
"""No sensor takes longer for a frame [s]."""


def roll_from_video(path: Path, options: VideoOptions | None = None) -> Roll:
    """Read the roll of a board from a film.

    Roll zero is the picture's horizontal (marker, two dots, edge), or where the body rests at the end
    (one dot, features). Times are the container's, moved to when the sensor read the board if the
    read-out time is known.

    Args:
        path: Film taken from behind the board, one uncut take.
        options: What is not to be inferred.

    Raises:
        HuskyError: The file is not a film, is damaged, cut or too large; no board is found in it; or
            it has fewer than 8 frames for each period of the oscillation.
    """
    from sysid.video.camera import lens_of
    from sysid.video.frames import open_clip

    options = options or VideoOptions()
    clip = open_clip(path)
    lens = lens_of(clip, options.calibration)
    chosen, track = _followed(clip, options)
    time, turning, readout_note = _angle(clip, track, lens, chosen, options)
    sign = -1.0 if options.front else 1.0
    signal = _Signal(time, sign * (turning.angle + chosen.zero(turning)), turning.std)
    pace = _refuse_slow(path, signal)
    signal, filled, dropped = _fill(signal, pace)
    notes, faults = _words(clip, track, lens, chosen, turning, options)
    notes.append(readout_note)
    if filled:
        notes.append(f"{filled} lost frames filled in from their neighbours")
    if np.ptp(signal.roll) < max(6 * float(np.median(signal.std)), LEAST_SWING):
        faults.append(
            f"what is followed turns by {np.degrees(np.ptp(signal.roll)):.2g}° in all: is it the board? Look at --overlay"
        )
    if dropped:
        faults.append(
            f"{dropped} of {len(track.time)} frames show too little of the board and are left out; "
            "keep hands and feet out of the picture"
        )
    roll = Roll(
        log=str(path),
        time=signal.time - signal.time[0],
        roll=signal.roll,
        std=signal.std,
        origin="video",
        notes=tuple(notes),
        warnings=tuple(faults),
    )
    if options.overlay is not None:
        from sysid.video.overlay import draw_overlay

        draw_overlay(clip, track, roll, signal.index, options.overlay, options.on_frame)
    return roll


class _Signal:
    """Angle and deviation against time, NaN where the board was not seen."""

    def __init__(
        self, time: Array, roll: Array, std: Array, index: npt.NDArray[np.intp] | None = None
    ) -> None:
        """Hold arrays of shape (n,); `index` counts the tracked frames."""
        self.time, self.roll, self.std = time, roll, std
        self.index: npt.NDArray[np.intp] = np.arange(len(time)) if index is None else index


def _angle(
    clip: "Clip", track: "Track", lens: "Lens", chosen: "Chosen", options: VideoOptions
) -> tuple[Array, "Turning", str]:
    """Solve for the angle with the read-out time that is given, seen in the film, or bounded."""
    from sysid.video.camera import FOCAL_SPREAD
    from sysid.video.shutter import at_common_time

    share = clip.row_share(track.points)
    points = lens.straighten(track.points)
    if track.shake.significant:
        points = track.shake.undo(points)
    interval = float(np.median(np.diff(track.time)))
    ceiling = min(interval, READOUT_CEILING)

    def at(readout: float, direction: tuple[float, float] | None) -> "tuple[Array, Turning]":
        moved, time = at_common_time(points, track.time, share, readout)
        return time, chosen.solve(moved, lens.matrix, direction)

    def focal_doubt(readout: float, turning: "Turning") -> Array:
        """What the focal length's uncertainty does to the angles, less what it does at rest."""
        if lens.known:
            return np.zeros(len(turning.angle))
        longer = np.diag([np.exp(FOCAL_SPREAD), np.exp(FOCAL_SPREAD), 1.0]) @ lens.matrix
        longer[:2, 2] = lens.matrix[:2, 2]
        moved, _ = at_common_time(points, track.time, share, readout)
        change = chosen.solve(moved, longer, options.camera_angle).angle - turning.angle
        change = np.abs(change - np.nanmedian(change))
        return np.where(np.isfinite(change), change, np.nanmax(change))

    if options.readout is not None:
        if not 0 <= options.readout <= 0.2:
            raise HuskyError(
                f"--readout {options.readout}: a read-out takes 0 to 0.2 s; typical is 0.01 to 0.02."
            )
        time, turning = at(options.readout, options.camera_angle)
        turning = replace(turning, std=np.hypot(turning.std, focal_doubt(options.readout, turning)))
        return time, _with_shake(turning, track), f"read-out {options.readout * 1e3:.3g} ms, as given"
    _, middle = at(ceiling / 2, options.camera_angle)
    fixed = (middle.yaw, middle.pitch)
    tried = [at(readout, fixed) for readout in (0.0, ceiling / 2, ceiling)]
    freedom = 2 * chosen.tracker.points - 3 if chosen.shows_shear else 0
    misfit = [np.where(_steady(points), turning.misfit, np.nan) for _, turning in tried]
    readout, deviation = _seen_readout(misfit, freedom, ceiling)
    if deviation < 0.2 * ceiling:
        note = (
            f"read-out {readout * 1e3:.3g} ± {2 * deviation * 1e3:.1g} ms, from how moving points are sheared"
        )
    else:
        readout, deviation = ceiling / 2, ceiling / np.sqrt(12)
        note = (
            f"read-out not known: anything up to {ceiling * 1e3:.2g} ms is within the uncertainty (--readout)"
        )
    time, turning = at(readout, options.camera_angle)
    (time_0, none), (time_1, whole) = tried[0], tried[2]
    later = (time_1 - time_0) - np.mean(time_1 - time_0)
    change = whole.angle - none.angle - _rate(time, turning.angle) * later
    change = change - np.nanmedian(change)
    # The correction uses velocities from neighbouring frames: it is as good as they are alike.
    step = np.abs(np.diff(change, prepend=change[:1], append=change[-1:]))
    roughness = 0.3 * np.fmax(step[1:], step[:-1]) * readout / ceiling
    spread = np.hypot(np.abs(change) * deviation / ceiling, roughness)
    spread = np.where(np.isfinite(spread), spread, np.nanmax(spread))
    spread = np.hypot(spread, focal_doubt(readout, turning))
    return time, _with_shake(replace(turning, std=np.hypot(turning.std, spread)), track), note


def _steady(points: Array) -> npt.NDArray[np.bool_]:
    """Frames whose velocity is known from their neighbours: not those in which a hand lets go."""
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a frame in which nothing is seen
        middle = np.nanmean(points, axis=1)
    speed = np.linalg.norm(middle[2:] - middle[:-2], axis=1) / 2
    bend = np.linalg.norm(middle[2:] - 2 * middle[1:-1] + middle[:-2], axis=1)
    return np.concatenate([[False], (bend < STEADY * speed + 0.2) & np.isfinite(bend), [False]])


def _seen_readout(misfit: list[Array], freedom: int, ceiling: float) -> tuple[float, float]:
    """Vertex and deviation of the parabola through the misfit at no, half and full read-out."""
    if freedom <= 0:
        return ceiling / 2, np.inf
    square = np.stack(misfit)
    good = np.isfinite(square).all(axis=0)
    square = square[:, good]
    least = square.min(axis=0)
    square = square[:, least < 60 * np.median(least)]
    total = square.sum(axis=1)
    bend = 2 * (total[0] - 2 * total[1] + total[2]) / ceiling**2
    if bend <= 0:
        return ceiling / 2, np.inf
    vertex = ceiling / 2 - (total[2] - total[0]) / (ceiling * bend)
    left = max(
        total.min() - bend / 2 * (np.array([0, ceiling / 2, ceiling])[total.argmin()] - vertex) ** 2,
        0.2 * total.min(),
    )
    noise = left / (freedom * max(square.shape[1], 1))
    return float(np.clip(vertex, 0, ceiling)), float(
        np.hypot(np.sqrt(2 * noise / bend), SHEAR_DOUBT * ceiling)
    )


def _rate(time: Array, angle: Array) -> Array:
    good = np.isfinite(angle)
    rate = np.zeros(len(angle))
    rate[good] = np.gradient(angle[good], time[good])
    return rate


def _with_shake(turning: "Turning", track: "Track") -> "Turning":
    """Subtract nothing (the points were freed of it), but add what is not known of the camera's rotation."""
    if not track.shake.significant:
        return turning
    return replace(turning, std=np.hypot(turning.std, track.shake.std))


def _followed(clip: "Clip", options: VideoOptions) -> "tuple[Chosen, Track]":
    """Follow the first of the choices that is seen in most frames."""
    from sysid.video.choose import choices
    from sysid.video.track import follow

    failed: list[str] = []
    for chosen in choices(clip, options):
        track = follow(clip, chosen.tracker, options.rate)
        seen = len(track.time) - track.lost
        if seen >= MOST_SEEN * len(track.time):
            return chosen, track
        failed.append(f"{chosen.what} is seen in only {seen} of {len(track.time)} frames")
    raise HuskyError(
        f"{clip.path}: {'; '.join(failed)}. Keep the board in the picture, film in more light (less blur), or "
        "follow something else (--method)."
    )


def _fill(signal: _Signal, pace: float) -> tuple[_Signal, int, int]:
    """Interpolate over gaps shorter than an eighth of the period, leave out others; count both."""
    from scipy.interpolate import CubicSpline

    good = np.isfinite(signal.roll)
    first, last = np.flatnonzero(good)[[0, -1]]
    inside = slice(first, last + 1)
    time, roll, std, good = (
        signal.time[inside],
        signal.roll[inside].copy(),
        signal.std[inside].copy(),
        good[inside],
    )
    index = signal.index[inside]
    edges = np.flatnonzero(np.diff(np.concatenate([[True], good, [True]]).astype(int)))
    gaps = list(zip(edges[::2], edges[1::2], strict=True))
    short = [(a, b) for a, b in gaps if b - a <= min(LONGEST_GAP, pace / 8)]
    if short and good.sum() >= 4:
        spline = CubicSpline(time[good], roll[good])
        straight = np.interp(time, time[good], roll[good])
        for a, b in short:
            roll[a:b] = spline(time[a:b])
            # Where the deck was let go in the gap, the cubic is no better than the chord.
            std[a:b] = np.hypot(max(std[a - 1], std[b]), np.abs(roll[a:b] - straight[a:b]))
    keep = np.isfinite(roll)
    dropped = len(signal.roll) - int(keep.sum())
    filled = int(keep.sum() - good.sum())
    return _Signal(time[keep], roll[keep], std[keep], index[keep]), filled, dropped


def _refuse_slow(path: Path, signal: _Signal) -> float:
    """Return the frames a period (infinite where nothing swings), or refuse."""
    from sysid.video.pace import frames_per_period

    seen = np.isfinite(signal.roll)
    count = frames_per_period(signal.time[seen], signal.roll[seen], signal.std[seen])
    if count is not None and count < FEWEST_PER_PERIOD:
        rate = 1 / float(np.median(np.diff(signal.time)))
        raise HuskyError(
            f"{path}: {count:.1f} frames a period ({rate:.3g} frames/s for an oscillation of {rate / count:.3g} Hz); "
            f"{FEWEST_PER_PERIOD} are needed. Film at {rate * FEWEST_PER_PERIOD / count:.0f} frames/s or more "
            "(slow motion), or use an IMU."
        )
    return np.inf if count is None else count


def _words(
    clip: "Clip", track: "Track", lens: "Lens", chosen: "Chosen", turning: "Turning", options: VideoOptions
) -> tuple[list[str], list[str]]:
    """Say what was inferred, and what is wrong."""
    intervals = np.diff(track.time)
    spread = float(np.std(intervals) / np.mean(intervals))
    stamps = "the given rate" if options.rate is not None else "the container's stamps"
    notes = [
        f"{clip.width}x{clip.height}, {len(track.time)} frames, {1 / np.mean(intervals):.4g} frames/s by {stamps}"
        + (f", varying by {100 * spread:.0f} %" if spread > 0.02 else ""),
        chosen.why,
        lens.note,
        chosen.zero_note,
    ]
    if options.camera_angle is None and chosen.finds_direction:
        yaw, pitch = np.degrees([turning.yaw, turning.pitch])
        notes.append(
            f"axis {yaw:+.1f}° to the right of and {pitch:+.1f}° below the line of sight "
            f"(± {2 * np.degrees(turning.direction_std):.1f}°), from how the points move"
        )
    elif options.camera_angle is not None:
        notes.append("direction of the axis as given")
    faults: list[str] = []
    shake = track.shake
    if not shake.found:
        faults.append("too little background to see whether the camera shakes; use a tripod")
    elif shake.significant:
        notes.append(f"camera shake of {np.degrees(np.std(shake.rotation)):.2g}° taken out by the background")
    if track.repeated:
        faults.append(f"{track.repeated} frames without a later time stamp than the one before are left out")
    if turning.outliers:
        faults.append(f"{turning.outliers} frames in which the points do not fit a turning body are left out")
    return notes, [*faults, *chosen.warnings]
