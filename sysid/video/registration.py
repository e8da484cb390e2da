"""Registration of the whole body: every pixel that turns with the board tells its turn, not a few points alone.

What was followed says roughly how the board moved, and from where the camera looks: as a slanted view shears what turns, all
pictures are first made those of a camera along the axis. Pictures from all over the film, turned back by that, agree where
there is board and differ where there is none: their mean is what the board looks like, with little noise, and where they
agree is the board. Each picture of the film is then laid onto that mean by least squares of the brightness, for six
numbers of an affine motion (Lucas and Kanade, 1981; the gradients are the mean's own, as Baker and Matthews, 2004), with
weights that ignore hands and shine. Four points of the board at these places stand for it from then on.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sysid.roll import Array
from sysid.video.film.frames import Frame, grey
from sysid.video.film.track import Track
from sysid.video.pose.rectify import project
from sysid.video.pose.rigid_group import similarities
from sysid.video.types import Box, Points

Image = npt.NDArray[np.float32]

MAX_SIDE = 480
"""Longer side of the board's picture; larger ones are made smaller [px]."""
BLUR = 0.8
"""Standard deviation of the smoothing before gradients are taken [px]."""
ATTITUDE_STEP = np.radians(1.0)
"""Turns this far apart are different attitudes [rad]: the outermost pixels are a pixel or two apart."""
AGREEMENT = 0.3
"""Spread of a pixel in pictures turned back, over its spread as filmed, up to which it is the board's."""
MIN_PIXELS, MAX_PIXELS = 400, 3000
"""Fewer pixels are no body; of more, those where brightness changes most are used."""
MIN_SPREAD = 4.0
"""Least standard deviation of the body's pixels about their middle, across its narrow side [px]."""
MIN_PICTURES, MIN_TURN = 5, np.radians(1.0)
"""Pictures, and turn among them [rad], that tell the body from the rest."""
MAX_PICTURES = 40
"""Pictures that are averaged at most, evenly spread: most of them at rest, where compression leaves the least out."""
MIDDLE_GREY = np.float32(128.0)
"""About which brightness is squared, so that single precision does [grey levels]."""
MAX_ROUNDS, CONVERGED = 5, 0.02
"""Rounds at most, and by how little the points move in the last one [px]: each takes away most of what is left."""
MAX_CORRECTION = 4.0
"""A picture in which the points end further from where they were followed is not believed [px]."""
MIN_TRUST = 0.35
"""Share of the pixels that must agree with the mean in a picture that is believed."""


@dataclass(frozen=True, slots=True)
class Cutout:
    """The part of the pictures in which the board moves, made small, as a camera along the axis would take it."""

    box: Box
    scale: float
    """Its pixels in one of the film."""
    inward: Array
    """Map from places in the film [px] to places in it [px], homogeneous, shape (3, 3)."""
    size: tuple[int, int]
    """Its width and height [px]."""

    def of(self, frame: Frame) -> Image:
        """Return the part of a frame, smoothed [grey levels], shape (h, w)."""
        part, corner = frame.part(self.box)
        small = cv2.resize(grey(part), None, fx=self.scale, fy=self.scale, interpolation=cv2.INTER_AREA)
        onward = self.inward @ np.linalg.inv(_shrinking(self.scale, corner))
        flat = cv2.warpPerspective(
            small, onward, self.size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(cv2.GaussianBlur(flat.astype(np.float32), (0, 0), BLUR), np.float32)

    def places(self, points: Points) -> Points:
        """Return places in it [px] of points in the film [px], both of shape (N, 2)."""
        return project(self.inward, points.astype(np.float64)).astype(np.float32)


def _cutout(box: Box, upright: Array) -> Cutout:
    """Return the cutout of a box [px]; `upright`, shape (3, 3), takes the film's places to those that a camera along the axis sees."""
    left, top, right, bottom = box
    ends = project(upright, np.array([[left, top], [right, top], [right, bottom], [left, bottom]]))
    low, high = ends.min(axis=0), ends.max(axis=0)
    scale = min(1.0, MAX_SIDE / float((high - low).max()))
    width, height = np.ceil(scale * (high - low)).astype(int).tolist()
    return Cutout(box, scale, _shrinking(scale, low) @ upright, (width, height))


def _shrinking(scale: float, corner: Sequence[float] | Array) -> Array:
    """Map from places [px] to those in a picture that begins at a corner [px] and is made small, shape (3, 3)."""
    # Pixels are squares: one that is made of several has their middle for its own.
    left, top = 0.5 * (scale - 1) - scale * np.asarray(corner, np.float64)
    return np.array([[scale, 0, left], [0, scale, top], [0, 0, 1.0]])


@dataclass(frozen=True, slots=True)
class BodyPicture:
    """What the board looks like, at the attitude of a home picture."""

    home: Points
    """The points that were followed, there, in the cutout [px], shape (N, 2)."""
    cutout: Cutout
    places: Array
    """The board's pixels that tell most, in the cutout [px], shape (m, 2)."""
    bright: Image
    """Their brightness, shape (m,)."""
    corners: Array
    """Four points of the board, as wide apart as its pixels are on average, in the cutout [px], shape (4, 2)."""
    unit: float
    """Length by which places are divided, so that all six numbers are of one size [px]."""
    slopes: Image
    """Change of brightness with each of the six numbers, gain and offset, at these pixels, shape (m, 8)."""

    def find(self, frame: Frame, points: Points) -> Points:
        """Return the four points of the board in a frame [px], shape (4, 2); NaN where it is not made out.

        Args:
            frame: The frame.
            points: Where what was followed is in it [px], shape (N, 2).
        """
        rough = pose_between(self.home, self.cutout.places(points))
        pose = None if rough is None else lay_onto(self, self.cutout.of(frame), rough)
        if pose is None:
            return np.full((4, 2), np.nan, np.float32)
        outward = np.asarray(np.linalg.inv(self.cutout.inward), np.float64)
        return project(outward, project(pose, self.corners)).astype(np.float32)


def picture_of_body(frames: Sequence[Frame], box: Box, track: Track, upright: Array) -> BodyPicture | None:
    """Return what turns with the points of a track, or None where that is too little.

    Args:
        frames: The first frames of the track.
        box: Left, top, right and bottom [px] of where it moves.
        track: Points that were followed, two or more.
        upright: Takes the film's places to those that a camera along the axis sees, shape (3, 3).
    """
    rows = np.unique(np.linspace(0, len(frames) - 1, MAX_PICTURES).astype(int))
    rows = rows[np.isfinite(track.points[rows]).all(axis=2).sum(axis=1) >= 2]
    if len(rows) < MIN_PICTURES:
        return None
    cutout = _cutout(box, upright)
    places = {row: cutout.places(track.points[row]) for row in rows}
    seen = [(row, pose_between(places[rows[0]], places[row])) for row in rows]
    turns = {row: float(np.arctan2(pose[1, 0], pose[0, 0])) for row, pose in seen if pose is not None}
    some = sorted(turns, key=turns.__getitem__)
    if len(some) < MIN_PICTURES or turns[some[-1]] - turns[some[0]] < MIN_TURN:
        return None
    home = places[some[len(some) // 2]]
    placed = [(cutout.of(frames[row]), pose_between(home, places[row])) for row in some]
    body = None
    for _ in range(2):  # by the points' poses, and by its own
        good = [(picture, pose) for picture, pose in placed if pose is not None]
        if len(good) < MIN_PICTURES:
            return None
        body = _mean_of(home, cutout, [picture for picture, _ in good], [pose for _, pose in good])
        if body is None:
            return None
        placed = [(picture, lay_onto(body, picture, pose)) for picture, pose in good]
    return body


def pose_between(home: Points, points: Points) -> Array | None:
    """Return the similarity, shape (3, 3), from points (N, 2) [px] to others; None with fewer than two."""
    one, other = (np.asarray(places[:, 0] + 1j * places[:, 1], np.complex128) for places in (home, points))
    both = np.isfinite(one) & np.isfinite(other)
    if both.sum() < 2:
        return None
    (turn,), (shift,) = similarities(one, other[None], both[None])
    return np.array([[turn.real, -turn.imag, shift.real], [turn.imag, turn.real, shift.imag], [0, 0, 1.0]])


def _mean_of(home: Points, cutout: Cutout, pictures: list[Image], poses: list[Array]) -> BodyPicture | None:
    """Turn cutouts back by their poses, shape (3, 3) each, and average them where they agree."""
    # A film keeps what stands still as it is, its noise as well: many pictures of one attitude count as one.
    turn = np.round(np.array([np.arctan2(pose[1, 0], pose[0, 0]) for pose in poses]) / ATTITUDE_STEP)
    _, same, count = np.unique(turn, return_inverse=True, return_counts=True)
    share = 1 / (count[same] * len(count))
    mean, spread = _mean_and_spread(map(_turned_back, pictures, poses), share)
    _, usual = _mean_and_spread(pictures, share)
    agree = cv2.morphologyEx(
        (spread < AGREEMENT * usual).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)
    )
    mask = np.asarray(cv2.erode(agree, np.ones((3, 3), np.uint8)) > 0, np.bool_)
    mask[:3], mask[-3:], mask[:, :3], mask[:, -3:] = False, False, False, False
    if mask.sum() < MIN_PIXELS:
        return None
    slope = np.stack([cv2.Scharr(mean, cv2.CV_32F, *axis)[mask] / 32 for axis in ((1, 0), (0, 1))], axis=1)
    most = np.argsort(-(slope**2).sum(axis=1))[:MAX_PIXELS]
    slope, bright, places = slope[most], mean[mask][most], np.argwhere(mask)[most, ::-1].astype(np.float64)
    weight = (slope**2).sum(axis=1).astype(np.float64) + 1e-6
    middle = np.average(places, axis=0, weights=weight)
    variance, axes = np.linalg.eigh(np.cov((places - middle).T, aweights=weight))
    lengths = np.sqrt(np.maximum(variance, 0.0))
    if lengths[0] < MIN_SPREAD:
        return None
    corners = middle + (np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]]) * lengths) @ axes.T
    unit = float(lengths[1])
    (x, y), (across, down) = ((places - middle) / unit).T.astype(np.float32), slope.T
    columns = [
        across,
        across * x,
        across * y,
        down,
        down * x,
        down * y,
        bright - bright.mean(),
        np.ones_like(bright),
    ]
    slopes = np.asarray(np.stack(columns, axis=1), np.float32)
    return BodyPicture(home, cutout, places, bright, corners, unit, slopes)


def _mean_and_spread(pictures: Iterable[Image], share: Array) -> tuple[Image, Image]:
    """Return the mean of pictures (h, w) with weights (n,), and their smoothed standard deviation [grey levels]."""
    sums = [np.float32(0.0), np.float32(0.0)]
    for picture, weight in zip(pictures, share.astype(np.float32), strict=True):
        some = weight * (picture - MIDDLE_GREY)
        sums = [sums[0] + some, sums[1] + some * (picture - MIDDLE_GREY)]
    variance = np.maximum(sums[1] - sums[0] ** 2, 0)
    spread = cv2.GaussianBlur(np.sqrt(variance), (0, 0), 2.0)
    return np.asarray(sums[0] + MIDDLE_GREY, np.float32), np.asarray(spread, np.float32)


def _turned_back(picture: Image, pose: Array) -> Image:
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    size = picture.shape[::-1]
    return np.asarray(
        cv2.warpAffine(picture, pose[:2], size, flags=flags, borderMode=cv2.BORDER_REPLICATE), np.float32
    )


def lay_onto(body: BodyPicture, picture: Image, rough: Array) -> Array | None:
    """Return the affine pose that lays the board onto a picture, shape (3, 3); None where it is not to be seen.

    Args:
        body: The board.
        picture: A cutout [grey levels], shape (h, w).
        rough: The pose roughly, of places in the cutout [px], shape (3, 3).
    """
    pose, middle = rough, body.corners.mean(axis=0)
    rest, scale = np.zeros(1, np.float32), 1.0
    for _ in range(MAX_ROUNDS):
        there = project(pose, body.places).astype(np.float32)
        seen = cv2.remap(
            picture, there[None, :, 0], there[None, :, 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        rest = np.asarray(seen, np.float32).ravel() - body.bright
        rest -= np.median(rest[::4])
        scale = max(1.4826 * float(np.median(np.abs(rest[::4]))), 1.0)
        weighted = body.slopes * (1 / (1 + (rest / (2.5 * scale)) ** 2) ** 2)[:, None]
        normal = (weighted.T @ body.slopes).astype(np.float64)
        normal += np.diag(1e-6 * np.diag(normal) + 1e-9)
        step = np.linalg.solve(normal, (weighted.T @ rest).astype(np.float64))
        change, shift = step[[[1, 2], [4, 5]]] / body.unit, step[[0, 3]]
        back = np.eye(3)
        back[:2, :2] -= change
        back[:2, 2] = change @ middle - shift
        before, pose = pose, pose @ back
        here = project(pose, body.corners)
        if float(np.abs(here - project(rough, body.corners)).max()) > MAX_CORRECTION:
            return None
        if float(np.abs(here - project(before, body.corners)).max()) < CONVERGED:
            break
    return pose if float(np.mean(np.abs(rest) < 5 * max(scale, 2.0))) > MIN_TRUST else None
