"""Words for people about a film: inferences and faults."""

from collections.abc import Iterator

import numpy as np

from sysid.video.film.camera import Lens
from sysid.video.film.frames import Clip
from sysid.video.film.track import Track
from sysid.video.options import VideoOptions
from sysid.video.pose.angle import AngleTrack
from sysid.video.pose.camera_state import DIFFERENCE_STEP, READOUT, CameraState
from sysid.video.pose.rectify import rectify
from sysid.video.trackers._base import SAME_SCALE, Target, rests_at

MAX_OFF_LEVEL = np.radians(5.0)
"""A board that ends a film further from level is doubted to rest there [rad]: board and camera are level to a degree or two."""
OLD_CODECS = frozenset(
    {"mpeg4", "msmpeg4v1", "msmpeg4v2", "msmpeg4v3", "h263", "mpeg1video", "mpeg2video", "flv1"}
)
"""Kinds of compression with motion to half a pixel: MPEG-4 part 2 and those before it."""


def inferred(
    clip: Clip,
    lens: Lens,
    target: Target,
    track: Track,
    before: CameraState,
    found: AngleTrack,
    options: VideoOptions,
) -> Iterator[str]:
    """Yield the inferences; `before` is the prior knowledge of the camera."""
    intervals = np.diff(track.time)
    spread = float(np.std(intervals) / np.mean(intervals))
    stamps = (
        "the given rate"
        if options.rate is not None
        else "the container's stamps (of slow motion give --rate)"
    )
    yield (
        f"film: {clip.width}x{clip.height}, {track.index[-1] + 1} frames, {1 / np.mean(intervals):.4g} frames/s by {stamps}"
        + (f", varying by {100 * spread:.0f} %" if spread > 0.02 else "")
    )
    if track.index[0] > 0:
        yield (
            f"film: its first {track.index[0]} frames show no motion and are left out; times are the film's own, from "
            f"{track.time[0]:.4g} s on"
        )
    if clip.slowed > 1 and options.rate is None:
        yield (
            f"film: taken at {clip.slowed:.3g} times the rate at which it plays, as the phone notes in the file: its times are "
            "divided by that (--rate)"
        )
    yield f"follows: {target.why}"
    yield f"lens: {lens.note}"
    camera = found.camera_state
    doubt = f" (± {2 * np.degrees(_level_std(track, lens, camera)):.1f}° if the camera is level)"
    yield f"zero: {target.zero_note}{doubt if target.shows_level else ''}"
    if options.camera_angle is not None:
        yield "axis: its direction as given"
    elif target.direction_from:
        yaw, pitch = np.degrees(camera.value[:2])
        yield (
            f"axis: {yaw:+.1f}° to the right of and {pitch:+.1f}° below the line of sight "
            f"(± {2 * np.degrees(camera.std[:2].max()):.1f}°), from {target.direction_from}"
        )
    if track.shake.moves:
        yield f"shake: {np.degrees(track.shake.size):.2g}° of the camera's, taken out by the background"
    elif not track.shake.found:
        yield "camera: taken to stand still, as nothing of the background can be followed"
    if not before.std[READOUT]:
        source = "given" if options.readout is not None else "the phone notes in the file"
        yield f"read-out: {camera.readout * 1e3:.3g} ms, as {source}"
    else:
        doubt, most = 2e3 * camera.std[READOUT], 1e3 * before.readout_limit
        yield f"read-out: {camera.readout * 1e3:.3g} ± {doubt:.2g} of {most:.2g} ms at most, from how moving points are sheared (--readout)"


def _level_std(track: Track, lens: Lens, camera: CameraState) -> float:
    """Return the standard deviation of level at the body's place in the picture [rad].

    Above and below the picture's middle, a camera that looks aside of the axis sees level lines at a slope.
    """
    place = np.nanmedian(lens.straighten(track.points.astype(np.float64)), axis=(0, 1))
    line = place + np.array([[-1.0, 0.0], [1.0, 0.0]])
    values = camera.value + DIFFERENCE_STEP * np.vstack([np.zeros(4), np.eye(4)])
    slope = np.angle(np.diff([rectify(line, lens.matrix, value) for value in values])[:, 0])
    change = (slope[1:] - slope[0]) / DIFFERENCE_STEP
    return float(np.sqrt(change @ camera.covariance @ change))


def faults(clip: Clip, target: Target, track: Track, found: AngleTrack) -> Iterator[str]:
    """Yield the faults of a film."""
    if found.scale_std > SAME_SCALE:
        yield (
            f"the scale of the angle is unknown: ± {200 * found.scale_std:.0f} %. Period and damping ratio still hold. "
            "Give the pivot with --pivot, film a wider swing, or use a marker or two stickers"
        )
    if track.repeated:
        yield f"{track.repeated} frames without a later time stamp than the one before are left out"
    if found.outliers:
        yield f"{found.outliers} frames in which the points do not fit a turning body are left out"
    rest = rests_at(found.angle + target.zero(found))
    if target.shows_level and abs(rest) > MAX_OFF_LEVEL:
        yield (
            f"at the end of the film the deck is {abs(np.degrees(rest)):.1f}° off zero, which is {target.zero_note}: if it rests "
            "there, that is no level"
        )
    yield from target.warnings
    if clip.codec in OLD_CODECS:
        yield (
            f"compressed as {clip.codec}, which drops small motion beyond the stated deviations. k may be "
            "off by 5 %. Give the film as the camera wrote it (H.264, HEVC)"
        )
