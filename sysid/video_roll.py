"""Roll of the deck from a film taken from behind.

What is followed is a printed marker, two coloured stickers (or one dot on a pendulum), the deck's
straight edge, or its texture. From then on all is one: points in pictures, freed of lens, camera
shake and rolling shutter, and the angle of a body that turns about an axis seen at a slant.
"""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sysid.errors import HuskyError
from sysid.roll import Array, Roll
from sysid.video.options import VideoOptions as VideoOptions

if TYPE_CHECKING:
    from sysid.video.film.camera import Lens
    from sysid.video.film.frames import Clip
    from sysid.video.film.track import Track
    from sysid.video.pose.angle import Turning
    from sysid.video.pose.camera_state import Unknowns
    from sysid.video.select import Chosen

FEWEST_PER_PERIOD = 8
"""Frames a period below which the fastest part of a swing is guessed rather than seen."""
LEAST_SWING = np.radians(1.0)
"""A record that swings by less is suspect [rad]."""
MOST_SEEN = 0.6
"""Share of the frames in which what is followed must be seen."""
SHUTTER_SEEN = 0.5
"""A read-out counts as seen in the film if that leaves less than this share of its uncertainty."""
COARSE = frozenset(
    {"FMP4", "MP4V", "XVID", "DIVX", "DX50", "DIV3", "MP42", "MP43", "H263", "S263", "MPG1", "MPG2", "FLV1"}
)
"""Kinds of compression with motion to half a pixel: MPEG-4 part 2 and those before it."""
LONGEST_GAP = 3
"""Lost frames in a row that are interpolated over."""


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
    from sysid.video.film.camera import lens_of
    from sysid.video.film.frames import open_clip

    options = options or VideoOptions()
    clip = open_clip(path)
    lens = lens_of(clip, options.calibration)
    chosen, track = follow_board(clip, lens, options)
    roll, rows = roll_from_track(clip, lens, chosen, track, options)
    if clip.codec in COARSE:
        fault = (
            f"compressed as {clip.codec}, an old way that leaves out more small motion than the deviations hold: k may be "
            "off by 5 %; give the film as the camera wrote it (H.264, HEVC)"
        )
        roll = replace(roll, warnings=(*roll.warnings, fault))
    if options.overlay is not None:
        from sysid.video.overlay import draw_overlay

        draw_overlay(clip, track, roll, rows, options.overlay, chosen.joined, options.on_frame)
    return roll


def roll_from_track(
    clip: "Clip", lens: "Lens", chosen: "Chosen", track: "Track", options: VideoOptions
) -> "tuple[Roll, npt.NDArray[np.intp]]":
    """Turn what was followed in a film into roll; return it and the row of `track` of each sample.

    Raises:
        HuskyError: There are fewer than 8 frames for each period of the oscillation.
    """
    from sysid.video.pose.outliers import lone_frames
    from sysid.video.pose.view import View

    before = _unknowns(clip, track, lens, chosen, options)
    view = View(track, lens.straighten, clip.row_share)
    turning = chosen.solve(view, lens.matrix, before)
    shaken = track.shake.std if track.shake.significant else np.zeros(len(turning.std))
    std = np.hypot(turning.std, shaken)
    own = std if turning.own is None else np.hypot(turning.own, shaken)
    time = view.time(turning.unknowns.readout)
    sign = -1.0 if options.front else 1.0
    angle = sign * (turning.angle + chosen.zero(turning))
    alone = lone_frames(time, angle, std)
    signal = _Signal(time, angle, np.hypot(std, alone), np.hypot(own, alone))
    _refuse_contradiction(clip.path, chosen, track, angle)
    pace = _refuse_slow(clip.path, signal)
    signal, filled, dropped = _fill(signal, pace)
    notes, faults = _words(clip, track, lens, chosen, turning, options)
    notes.append(_shutter_note(before, turning.unknowns))
    if np.any(alone > 0):
        notes.append(
            f"{np.sum(alone > 0)} frames that those before and after do not bear out are given less weight"
        )
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
        log=str(clip.path),
        time=signal.time - signal.time[0],
        roll=signal.roll,
        std=signal.std,
        own_std=signal.own,
        origin="video",
        zero="constant",
        errors_last=True,
        notes=tuple(notes),
        warnings=tuple(faults),
    )
    return roll, signal.index


class _Signal:
    """Angle and deviation against time, NaN where the board was not seen."""

    def __init__(
        self, time: Array, roll: Array, std: Array, own: Array, index: npt.NDArray[np.intp] | None = None
    ) -> None:
        """Hold arrays of shape (n,); `own` is the share of `std` that is a frame's own, `index` counts the tracked frames."""
        self.time, self.roll, self.std, self.own = time, roll, std, own
        self.index: npt.NDArray[np.intp] = np.arange(len(time)) if index is None else index


def _unknowns(
    clip: "Clip", track: "Track", lens: "Lens", chosen: "Chosen", options: VideoOptions
) -> "Unknowns":
    """What is known of camera, lens and shutter before the film is looked at."""
    from sysid.video.film.camera import FOCAL_SPREAD
    from sysid.video.film.shutter import READOUT_CEILING
    from sysid.video.pose.camera_state import Unknowns

    if options.readout is not None and not 0 <= options.readout <= 0.2:
        raise HuskyError(
            f"--readout {options.readout}: a read-out takes 0 to 0.2 s; typical is 0.01 to 0.02."
        )
    yaw, pitch = options.camera_angle or (0.0, 0.0)
    focal, focal_std = 0.0, 0.0 if lens.known else FOCAL_SPREAD
    if track.shake.significant and track.shake.focal_std < focal_std:  # a camera that turns shows its lens
        focal, focal_std = float(np.log(track.shake.focal / lens.matrix[0, 0])), track.shake.focal_std
    ceiling = min(float(np.median(np.diff(track.time))), READOUT_CEILING)
    std = np.array(
        [
            *((chosen.direction_doubt if options.camera_angle is None else 0.0,) * 2),
            focal_std,
            ceiling / np.sqrt(12) if options.readout is None else 0.0,
        ]
    )
    readout, limit = (ceiling / 2, ceiling) if options.readout is None else (options.readout, np.inf)
    return Unknowns(np.array([yaw, pitch, focal, readout]), np.diag(std**2), limit)


def _shutter_note(before: "Unknowns", after: "Unknowns") -> str:
    """Say where the read-out time comes from."""
    if not before.std[3]:
        return f"read-out {after.readout * 1e3:.3g} ms, as given"
    if after.std[3] < SHUTTER_SEEN * before.std[3]:
        return f"read-out {after.readout * 1e3:.3g} ± {2 * after.std[3] * 1e3:.2g} ms, from how moving points are sheared"
    return (
        f"read-out not seen in the film: anything up to {before.readout_limit * 1e3:.2g} ms is within the "
        "uncertainty (--readout)"
    )


def follow_board(clip: "Clip", lens: "Lens", options: VideoOptions) -> "tuple[Chosen, Track]":
    """Follow the first of the choices that is seen in most frames.

    Raises:
        HuskyError: There is none.
    """
    from sysid.video.film.track import follow
    from sysid.video.select import choices

    failed: list[str] = []
    for chosen in choices(clip, options):
        track = follow(clip, chosen.tracker, lens, options.rate)
        track = track if chosen.settle is None else chosen.settle(track)
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
    time, roll, good = signal.time[inside], signal.roll[inside].copy(), good[inside]
    deviations = [signal.std[inside].copy(), signal.own[inside].copy()]
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
            for std in deviations:
                std[a:b] = np.hypot(max(std[a - 1], std[b]), np.abs(roll[a:b] - straight[a:b]))
    keep = np.isfinite(roll)
    dropped = len(signal.roll) - int(keep.sum())
    filled = int(keep.sum() - good.sum())
    std, own = (std[keep] for std in deviations)
    return _Signal(time[keep], roll[keep], std, own, index[keep]), filled, dropped


def _refuse_contradiction(path: Path, chosen: "Chosen", track: "Track", angle: Array) -> None:
    """Refuse a film in whose frames what was followed does not turn as one body."""
    kept, seen = int(np.isfinite(angle).sum()), len(track.time) - track.lost
    if kept < MOST_SEEN * len(angle):
        raise HuskyError(
            f"{path}: {chosen.what} is seen in {seen} of {len(angle)} frames, but turns as one body in only {kept}: "
            "something else was followed in the others. Film straighter from behind and with more contrast, give "
            "--roi, or put a marker on the deck."
        )


def _refuse_slow(path: Path, signal: _Signal) -> float:
    """Return the frames a period (infinite where nothing swings), or refuse."""
    from sysid.video.film.pace import frames_per_period

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
    direction = turning.unknowns
    if options.camera_angle is None and chosen.finds_direction:
        yaw, pitch = np.degrees(direction.value[:2])
        notes.append(
            f"axis {yaw:+.1f}° to the right of and {pitch:+.1f}° below the line of sight "
            f"(± {2 * np.degrees(direction.std[:2].max()):.1f}°), from how the points move"
        )
    elif options.camera_angle is not None:
        notes.append("direction of the axis as given")
    faults: list[str] = []
    shake = track.shake
    if not shake.found:
        faults.append("too little background to see whether the camera shakes; use a tripod")
    elif shake.significant:
        notes.append(f"camera shake of {np.degrees(shake.size):.2g}° taken out by the background")
    if track.repeated:
        faults.append(f"{track.repeated} frames without a later time stamp than the one before are left out")
    if turning.outliers:
        faults.append(f"{turning.outliers} frames in which the points do not fit a turning body are left out")
    return notes, [*faults, *chosen.warnings]
