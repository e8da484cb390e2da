"""What people are told of a film: what was inferred, and what is wrong with it."""

from collections.abc import Iterator

import numpy as np

from sysid.video.film.camera import Lens
from sysid.video.film.frames import Clip
from sysid.video.film.track import Track
from sysid.video.options import VideoOptions
from sysid.video.pose.angle import AngleTrack
from sysid.video.pose.camera_state import CameraState
from sysid.video.trackers._base import Target

SHUTTER_SEEN = 0.5
"""A read-out counts as seen in the film if that leaves less than this share of its uncertainty."""
OLD_CODECS = frozenset(
    {"FMP4", "MP4V", "XVID", "DIVX", "DX50", "DIV3", "MP42", "MP43", "H263", "S263", "MPG1", "MPG2", "FLV1"}
)
"""Kinds of compression with motion to half a pixel: MPEG-4 part 2 and those before it."""


def inferred(
    clip: Clip, lens: Lens, target: Target, track: Track, found: AngleTrack, options: VideoOptions
) -> Iterator[str]:
    """Yield what was inferred."""
    intervals = np.diff(track.time)
    spread = float(np.std(intervals) / np.mean(intervals))
    stamps = "the given rate" if options.rate is not None else "the container's stamps"
    yield (
        f"{clip.width}x{clip.height}, {len(track.time)} frames, {1 / np.mean(intervals):.4g} frames/s by {stamps}"
        + (f", varying by {100 * spread:.0f} %" if spread > 0.02 else "")
    )
    yield target.why
    yield lens.note
    yield target.zero_note
    camera = found.camera_state
    if options.camera_angle is not None:
        yield "direction of the axis as given"
    elif target.finds_direction:
        yaw, pitch = np.degrees(camera.value[:2])
        yield (
            f"axis {yaw:+.1f}° to the right of and {pitch:+.1f}° below the line of sight "
            f"(± {2 * np.degrees(camera.std[:2].max()):.1f}°), from how the points move"
        )
    if track.shake.found and track.shake.significant:
        yield f"camera shake of {np.degrees(track.shake.size):.2g}° taken out by the background"


def shutter_note(before: CameraState, after: CameraState) -> str:
    """Say where the read-out time comes from."""
    if not before.std[3]:
        return f"read-out {after.readout * 1e3:.3g} ms, as given"
    if after.std[3] < SHUTTER_SEEN * before.std[3]:
        return f"read-out {after.readout * 1e3:.3g} ± {2 * after.std[3] * 1e3:.2g} ms, from how moving points are sheared"
    return (
        f"read-out not seen in the film: anything up to {before.readout_limit * 1e3:.2g} ms is within the "
        "uncertainty (--readout)"
    )


def faults(clip: Clip, target: Target, track: Track, found: AngleTrack) -> Iterator[str]:
    """Yield what is wrong with a film."""
    if not track.shake.found:
        yield "too little background to see whether the camera shakes; use a tripod"
    if track.repeated:
        yield f"{track.repeated} frames without a later time stamp than the one before are left out"
    if found.outliers:
        yield f"{found.outliers} frames in which the points do not fit a turning body are left out"
    yield from target.warnings
    if clip.codec in OLD_CODECS:
        yield (
            f"compressed as {clip.codec}, an old way that leaves out more small motion than the deviations hold: k may be "
            "off by 5 %; give the film as the camera wrote it (H.264, HEVC)"
        )
