"""Points that were followed, and how the camera moved meanwhile."""

from collections.abc import Sequence

import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video.film.frames import MAX_MISSING_SHARE, Frame
from sysid.video.film.reel import Reel
from sysid.video.film.track import Track
from sysid.video.pose.pose import pose_between, turn_of
from sysid.video.trackers._base import MIN_SEEN_SHARE, Follower
from sysid.video.types import Points


def follow_all(follower: Follower, frames: Sequence[Frame]) -> Points:
    """Return the points in n frames [px], shape (n, N, 2); it is not looked for any longer where too few can show it."""
    points = np.full((len(frames), follower.points, 2), np.nan, np.float32)
    lost = 0
    for row, frame in enumerate(frames):
        points[row] = follow(follower, frame)
        lost += bool(np.isnan(points[row]).all())
        if lost > (1 - MIN_SEEN_SHARE) * len(frames):
            break
    return points


def follow(follower: Follower, frame: Frame) -> Points:
    """Return the points in the next frame [px], shape (N, 2); NaN where not seen."""
    found = follower.update(frame)
    return np.full((follower.points, 2), np.nan, np.float32) if found is None else found.astype(np.float32)


def track_of(reel: Reel, frames: Sequence[tuple[int, float]], points: Points) -> Track:
    """Return points with the camera's shake.

    Args:
        reel: The film.
        frames: Number and time of each of n frames [s], the first ones that were kept.
        points: N points in each [px], shape (n, N, 2).

    Raises:
        SysidError: There are fewer than 8 frames, or their stamps are garbled.
    """
    if len(frames) < 8:
        raise SysidError(
            f"{reel.clip.path}: {len(frames)} frames are too few for a decay. Film at least a second."
        )
    if reel.repeated > MAX_MISSING_SHARE * len(frames):
        raise SysidError(
            f"{reel.clip.path}: {reel.repeated} frames carry no later time stamp than the one before: its times are not those of "
            "the board. Give the film as the camera wrote it, or its frame rate with --rate."
        )
    turn = _turn(points, reel.lens.matrix[0, 0])
    shake = reel.background.shake(reel.skipped, turn)
    index, time = np.array([number for number, _ in frames], np.intp), np.array([at for _, at in frames])
    return Track(time, points, shake, index, reel.repeated)


def _turn(points: Points, focal: float) -> Array:
    """Return roughly how the points (n, N, 2) turn as filmed, or a single one swings to and fro [rad], shape (n,)."""
    if points.shape[1] == 1:
        path = points[:, 0] @ np.array([1, 1j])
        path -= np.nanmean(path) if np.isfinite(path).any() else 0
        along = np.exp(0.5j * np.angle(np.nansum(path**2)))
        turn = np.real(path / along) / focal
    else:
        home = points[int(np.argmax(np.isfinite(points).sum(axis=(1, 2))))]
        poses = (pose_between(home, seen) for seen in points)
        turn = np.array([np.nan if pose is None else turn_of(pose) for pose in poses])
    number, good = np.arange(len(turn)), np.isfinite(turn)
    return np.interp(number, number[good], np.unwrap(turn[good])) if good.any() else np.zeros(len(turn))
