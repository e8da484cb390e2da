"""Registration of the whole body: every pixel that turns with the board tells its turn, not a few points alone.

Followed points give the rough motion and the direction of the camera. A slanted view shears a body that turns, so all pictures
are first made those of a camera along the axis. Pictures from all over the film, turned back, agree where the board is: their mean
is its picture, with little noise. Each frame is then laid onto that mean by least squares of the brightness (Lucas and Kanade, 1981; Baker and Matthews, 2004).
Six numbers describe an affine motion and six the light. The weights
ignore hands and shine. Four points of the board at these places stand for it from then on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.background import SMALL_SIDE
from sysid.video.film.frames import SURVEY_FRAMES, Frame, halved
from sysid.video.film.track import Track
from sysid.video.pose.prior import ATTITUDE_STEP, ROUNDS
from sysid.video.pose.rectify import attitude_share, pose_between, principal_corners, project, turn_of
from sysid.video.types import Box, Image, Mask, Points

KERNEL = cv2.getGaussianKernel(7, 0.8)
"""Smoothing before gradients are taken: a standard deviation of 0.8 px."""
AGREEMENT = 0.3
"""Spread of a pixel in pictures turned back, over its spread as filmed, up to which it is the board's."""
MAX_PIXELS = 2000
"""Pixels that are used at most: those where brightness changes most."""
MAX_CORRECTION = 4.0
"""A picture in which the points end further from where they were followed is not believed [px]. A body whose pixels are
nearer to their middle than that, across its narrow side, may be confused with its surroundings."""


@dataclass(frozen=True, slots=True)
class BodyPicture:
    """The board to a camera along the axis, at the attitude of a home picture."""

    box: Box
    """Part of the film in which it moves [px]."""
    upright: Array
    """Takes places in the film [px] to those that a camera along the axis sees [px], homogeneous, shape (3, 3)."""
    home: Array
    """The points that were followed, at home, along the axis [px], shape (N, 2)."""
    places: Array
    """The board's pixels that tell most, at home [px], homogeneous, shape (3, m)."""
    bright: Image
    """Their brightness, shape (m,)."""
    corners: Array
    """Four points of the board, as wide apart as its pixels are on average, at home [px], shape (4, 2)."""
    unit: float
    """Length by which places are divided, so that all six numbers are of one size [px]."""
    slopes: Image
    """Change of brightness with each of the six numbers, and of gain and offset with their slopes, at these pixels, shape (12, m)."""

    def seen(self, frame: Frame, points: Points, before: Points | None = None) -> Points:
        """Return where a frame with the followed points (N, 2) shows `corners` [px], shape (4, 2); NaN where it is not made out.

        Without the points the search begins `before`, at the corners in an earlier frame [px], shape (4, 2).
        """
        rough = pose_between(self.home, project(self.upright, points.astype(np.float64)))
        if rough is None and before is not None:
            rough = pose_between(self.corners, project(self.upright, before.astype(np.float64)))
        pose = None if rough is None else self._laid(*seen_upright(frame, self.box, self.upright), rough)
        if pose is None:
            return np.full((4, 2), np.nan, np.float32)
        return project(_inverse(self.upright) @ pose, self.corners).astype(np.float32)

    def _laid(self, picture: Image, inward: Array, rough: Array) -> Array | None:
        """Return the affine pose that lays the board onto a picture as `seen_upright` has it; None where it is not to be seen."""
        pose, middle = rough, self.corners.mean(axis=0)
        start = project(rough, self.corners)
        for _ in range(ROUNDS):
            there = (inward @ pose) @ self.places
            x, y = (there[:2] / there[2]).astype(np.float32)[:, None]
            seen = cv2.remap(picture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
            rest = seen.ravel() - self.bright
            rest -= _middle(rest[::4])
            scale = max(1.4826 * float(_middle(np.abs(rest[::4]))), 1.0)
            weighted = self.slopes / (1 + (rest / np.float32(2.5 * scale)) ** 2) ** 2
            normal = (weighted @ self.slopes.T).astype(np.float64)
            normal += np.diag(1e-6 * np.diag(normal) + 1e-9)
            step = np.linalg.solve(normal, (weighted @ rest).astype(np.float64))
            change, shift = step[[[1, 2], [4, 5]]] / self.unit, step[[0, 3]]
            back = np.eye(3)
            back[:2, :2] -= change
            back[:2, 2] = change @ middle - shift
            pose = pose @ back
            if float(np.abs(project(pose, self.corners) - start).max()) > MAX_CORRECTION:
                return None
        return pose


def seen_upright(frame: Frame, box: Box, upright: Array) -> tuple[Image, Array]:
    """Return a part of a frame, small and smoothed [grey levels], and the map to it of places along the axis, shape (3, 3)."""
    part, corner = frame.part(box)
    small, times = halved(part, SMALL_SIDE)
    # Pixels are squares: one that is made of several has their middle for its own.
    left, top = 0.5 * (1 / times - 1) - np.array(corner) / times
    inward = np.array([[1 / times, 0, left], [0, 1 / times, top], [0, 0, 1.0]])
    smooth = cv2.sepFilter2D(small, cv2.CV_32F, KERNEL, KERNEL)
    return np.asarray(smooth, np.float32), inward @ _inverse(upright)


def picture_of_body(frames: Sequence[Frame], box: Box, track: Track, upright: Array) -> BodyPicture | None:
    """Return what turns with the points of a track, or None where that is too little.

    It moves inside the box [px] of the track's first frames; `upright` is that of `BodyPicture`, shape (3, 3).
    """
    rows = np.unique(np.linspace(0, len(frames) - 1, SURVEY_FRAMES).astype(int))
    rows = rows[np.isfinite(track.points[rows]).all(axis=2).sum(axis=1) >= 2]
    if len(rows) == 0:
        return None
    # The upright picture begins at the corner of the box, and is halved like the film's.
    left, top, right, bottom = box
    ends = project(upright, np.array([[left, top], [right, top], [right, bottom], [left, bottom]]))
    times = halved(np.zeros((bottom - top, right - left), np.uint8), SMALL_SIDE)[1]
    low, size = ends.min(axis=0), np.ceil(np.ptp(ends, axis=0) / times).astype(int)
    upright = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, times]]) @ upright
    places = {row: project(upright, track.points[row].astype(np.float64)) for row in rows}
    seen = [(row, pose_between(places[rows[0]], places[row])) for row in rows]
    turns = {row: turn_of(pose) for row, pose in seen if pose is not None}
    some = sorted(turns, key=turns.__getitem__)
    if turns[some[-1]] - turns[some[0]] < ATTITUDE_STEP:
        return None
    home = places[some[len(some) // 2]]
    shown = [(*seen_upright(frames[row], box, upright), pose_between(home, places[row])) for row in some]
    good = [(picture, inward, pose) for picture, inward, pose in shown if pose is not None]
    across, down = size.tolist()
    _, usual = _mean_and_spread(good, (across, down), back=False)
    mean, spread = _mean_and_spread(good, (across, down))
    closed = cv2.morphologyEx(
        (spread < AGREEMENT * usual).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)
    )
    agree = np.asarray(cv2.erode(closed, np.ones((3, 3), np.uint8)) > 0, np.bool_)
    agree[:3], agree[-3:], agree[:, :3], agree[:, -3:] = False, False, False, False
    found = _board_in(mean, agree) if agree.any() else None
    return None if found is None else BodyPicture(box, upright, home, *found)


def _inverse(homography: Array) -> Array:
    return np.asarray(np.linalg.inv(homography), np.float64)


def _board_in(mean: Image, agree: Mask) -> tuple[Array, Image, Array, float, Image] | None:
    """Return what `BodyPicture` holds from `places` on, of a mean picture and where pictures agree, both of shape (h, w)."""
    slope = np.stack([cv2.Scharr(mean, cv2.CV_32F, *axis)[agree] / 32 for axis in ((1, 0), (0, 1))], axis=1)
    most = np.argsort(-(slope**2).sum(axis=1))[:MAX_PIXELS]
    slope, bright, places = slope[most], mean[agree][most], np.argwhere(agree)[most, ::-1].astype(np.float64)
    weight = (slope**2).sum(axis=1).astype(np.float64) + 1e-6
    corners, lengths = principal_corners(places, weight)
    if lengths[0] < MAX_CORRECTION:
        return None
    unit = float(lengths[1])
    arm = np.vstack([np.ones(len(places)), (places - corners.mean(axis=0)).T / unit]).astype(np.float32)
    # Light may fall on it unevenly, and change: gain and offset slope across the body.
    slopes = np.vstack([slope[:, 0] * arm, slope[:, 1] * arm, (bright - bright.mean()) * arm, arm])
    homogeneous = np.vstack([places.T, np.ones(len(places))])
    return homogeneous, bright, corners, unit, slopes.astype(np.float32)


def _mean_and_spread(
    seen: Sequence[tuple[Image, Array, Array]], size: tuple[int, int], *, back: bool = True
) -> tuple[Image, Image]:
    """Return the mean of pictures and their smoothed spread. Each comes with its map from the upright picture and its pose.

    They are turned back by their poses, or left as they were filmed.
    """
    share = attitude_share(np.array([turn_of(pose) for _, _, pose in seen]), ATTITUDE_STEP)
    first, second = np.zeros((2, size[1], size[0]), np.float32)
    grey = np.float32(seen[0][0].mean())  # squares about a usual brightness need single precision only
    for (picture, inward, pose), part in zip(seen, (share / share.sum()).tolist(), strict=True):
        flags, border = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, cv2.BORDER_REPLICATE
        there = inward @ pose if back else inward
        flat = cv2.warpPerspective(picture, there, size, flags=flags, borderMode=border)
        some = np.asarray(flat, np.float32) - grey
        cv2.scaleAdd(some, part, first, first)
        cv2.scaleAdd(some * some, part, second, second)
    spread = cv2.GaussianBlur(np.sqrt(np.maximum(second - first**2, 0)), (0, 0), 2.0)
    return first + grey, np.asarray(spread, np.float32)


def _middle(values: Image) -> np.float32:
    """Return the upper median, many times faster than numpy's."""
    return np.partition(values, len(values) // 2)[len(values) // 2]
