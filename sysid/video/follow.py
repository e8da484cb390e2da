"""One pass through a clip: what is followed on the board, and how the camera moved."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video.film.background import Background
from sysid.video.film.camera import Lens
from sysid.video.film.frames import Clip, Frame
from sysid.video.film.shake import Shake, still
from sysid.video.film.track import Track
from sysid.video.options import VideoOptions
from sysid.video.pose.rigid_group import rough_turn
from sysid.video.trackers._base import Follower
from sysid.video.types import Mask


def follow(
    clip: Clip, followers: Sequence[Follower], lens: Lens, spare: Mask, options: VideoOptions
) -> list[Track]:
    """Follow points through a clip, frame by frame; nothing but the points is kept.

    Args:
        clip: The film.
        followers: What is followed, all in one pass.
        lens: The lens.
        spare: Pixels where something moves, shape (height, width); the followers' boxes are spared as well.
        options: A rate that replaces the stamps, and whether the camera is known to stand still.

    Returns:
        The track of each: N points in n frames [px], shape (n, N, 2).

    Raises:
        SysidError: The clip is damaged or cut, or has fewer than 8 frames.
    """
    spare = spare.copy()
    for follower in followers:
        left, top, right, bottom = follower.box
        spare[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = True
    background = Background(spare, lens)
    stamps: list[float] = []
    indices: list[int] = []
    rows: list[list[npt.NDArray[np.float32]]] = [[] for _ in followers]
    repeated = 0
    for frame in clip.ahead():
        if options.rate is not None:
            frame = Frame(frame.index, frame.index / options.rate, frame.picture)
        if stamps and frame.time <= stamps[-1]:
            repeated += 1
            continue
        try:
            background.update(frame)
        except SysidError as error:
            raise SysidError(f"{clip.path}: {error}") from None
        for follower, own in zip(followers, rows, strict=True):
            found = follower.update(frame)
            nothing = np.full((follower.points, 2), np.nan, np.float32)
            own.append(nothing if found is None else found.astype(np.float32))
        stamps.append(frame.time)
        indices.append(frame.index)
    if len(stamps) < 8:
        raise SysidError(
            f"{clip.path}: {len(stamps)} frames are too few for a decay. Film at least a second."
        )
    time, index, shake = np.array(stamps), np.array(indices, np.intp), background.result()
    tracks: list[Track] = []
    for own in rows:
        points = np.array(own)
        tracks.append(Track(time, points, _of_the_camera(shake, points, options), index, repeated))
    return tracks


def _of_the_camera(shake: Shake, points: npt.NDArray[np.float32], options: VideoOptions) -> Shake:
    """Return the shake unless it is the board's own motion, or there is none."""
    none = still(len(points), shake.focal, shake.centre, found=options.no_shake)
    if options.no_shake:
        return none
    if shake.significant and shake.goes_with(_turn(points, shake.focal)):
        return replace(none, mistaken=True)
    return shake


def _turn(points: npt.NDArray[np.float32], focal: float) -> Array:
    """Return roughly how the points (n, N, 2) turn as filmed, or a single one swings to and fro [rad], shape (n,)."""
    place = points[..., 0].astype(np.float64) + 1j * points[..., 1]
    seen = np.isfinite(place)
    if place.shape[1] == 1:
        path = place[:, 0] - place[seen[:, 0], 0].mean()
        along = np.exp(0.5j * np.angle(np.sum(path[seen[:, 0]] ** 2)))
        turn, good = np.real(path / along) / focal, seen[:, 0]
    else:
        home = place[int(np.argmax(seen.sum(axis=1)))]
        seen &= np.isfinite(home)
        good = seen.sum(axis=1) >= 2
        turn = np.full(len(place), np.nan)
        turn[good] = np.unwrap(rough_turn(np.nan_to_num(home), np.where(seen, place, 0)[good], seen[good]))
    number = np.arange(len(turn))
    return np.interp(number, number[good], turn[good]) if good.any() else np.zeros(len(turn))
