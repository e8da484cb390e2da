"""Registration of the whole body: every pixel that turns with the board tells its turn, not a few points alone.

What was followed says roughly how the board moved. Pictures from all over the film, turned back by that, agree where
there is board and differ where there is none: their mean is what the board looks like, with little noise, and where they
agree is the board. Each picture of the film is then laid onto that mean by least squares of the brightness, for six
numbers of an affine motion (Lucas and Kanade, 1981; the gradients are the mean's own, as Baker and Matthews, 2004), with
weights that ignore hands and shine. Four points of the board at these places stand for it from then on.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from sysid.roll import Array
from sysid.video.film.frames import Clip, grey
from sysid.video.film.survey import Survey
from sysid.video.film.track import Track
from sysid.video.types import Mask, Picture

Image = npt.NDArray[np.float32]

MAX_SIDE = 480
"""Longer side of the board's picture; larger ones are made smaller [px]."""
BLUR = 0.8
"""Standard deviation of the smoothing before gradients are taken [px]."""
ATTITUDE_STEP = np.radians(1.0)
"""Turns this far apart are different attitudes: the outermost pixels are a pixel or two apart."""
AGREEMENT = 0.5
"""Spread of a pixel in pictures turned back, over its spread as filmed, up to which it is the board's."""
MIN_PIXELS = 400
"""Fewer pixels are no body."""
MIN_SPREAD = 4.0
"""Least standard deviation of the body's pixels about their middle, across its narrow side [px]."""
MAX_ROUNDS = 6
CONVERGED = 2e-3
"""Rounds end where the points move by less [px]."""
MAX_CORRECTION = 4.0
"""A picture in which the points end further from where they were followed is not believed [px]."""
MIN_TRUST = 0.35
"""Share of the pixels that must agree with the mean in a picture that is believed."""


@dataclass(frozen=True, slots=True)
class BodyPicture:
    """What the board looks like, at the attitude of a home picture."""

    home: int
    """Row of the track that is home."""
    mean: Image
    """Its brightness, smoothed, shape (height, width)."""
    mask: Mask
    """Which pixels are the board's."""
    scale: float
    """Its pixels in one of the film."""
    corner: Array
    """Where its first pixel is in the home picture [px], shape (2,)."""
    points: Array
    """Four points of the board in the home picture [px], shape (4, 2)."""
    slopes: Image
    """Change of brightness with each of the six numbers, gain and offset, at the board's pixels, shape (m, 8)."""
    unit: float
    """Length by which places are divided, so that all numbers are of one size [px]."""

    def matrix(self, pose: Array) -> Array:
        """Return the affine map (2, 3) from its pixels to the film's, for a pose from home to the film, shape (2, 3)."""
        to_home = np.array(
            [[1 / self.scale, 0, self.corner[0]], [0, 1 / self.scale, self.corner[1]], [0, 0, 1]]
        )
        # Pixels are squares: those made of several have their middle between them.
        to_home[:2, 2] += (1 / self.scale - 1) / 2
        return np.asarray(pose @ to_home)


def picture_of_body(look: Survey, track: Track) -> BodyPicture | None:
    """Return what turns with the points of a track, or None where that is too little.

    Args:
        look: Pictures from all over the film.
        track: Points that were followed, two or more.
    """
    rows = [int(np.searchsorted(track.index, index)) for index in look.indices]
    known = [
        (picture, row)
        for picture, row, index in zip(look.pictures, rows, look.indices, strict=True)
        if row < len(track.index) and track.index[row] == index and poses_of(track, row, row) is not None
    ]
    if len(known) < 5:
        return None
    turns = np.array([_turn(track, known[0][1], row) for _, row in known])
    home = known[int(np.argsort(turns)[len(turns) // 2])][1]
    pairs = [(picture, poses_of(track, home, row)) for picture, row in known]
    placed = [(picture, pose) for picture, pose in pairs if pose is not None]
    if len(placed) < 5 or np.ptp(turns) < np.radians(1.0):
        return None
    body = _mean_of(home, [picture for picture, _ in placed], [pose for _, pose in placed], look)
    if body is None:
        return None
    refined = [(picture, lay_onto(body, picture, pose)) for picture, pose in placed]
    good = [(picture, pose) for picture, pose in refined if pose is not None]
    if len(good) < 5:
        return None
    return _mean_of(home, [picture for picture, _ in good], [pose for _, pose in good], look)


def poses_of(track: Track, home: int, row: int) -> Array | None:
    """Return the similarity (2, 3) that takes the points of one frame to those of another; None with fewer than two."""
    one, other = (track.points[number].astype(np.float64) @ np.array([1, 1j]) for number in (home, row))
    both = np.isfinite(one) & np.isfinite(other)
    if both.sum() < 2:
        return None
    weight = both.astype(np.float64)
    one, other = np.where(both, one, 0), np.where(both, other, 0)
    turn, shift = 1 + 0j, 0j
    for _ in range(4):  # many points hold a few that slip
        a, b = np.average(one, weights=weight), np.average(other, weights=weight)
        turn = np.vdot(weight * (one - a), other - b) / max(float(weight @ np.abs(one - a) ** 2), 1e-9)
        shift = b - turn * a
        weight = both / (1 + (np.abs(other - turn * one - shift) / 1.0) ** 2)
    return np.array([[turn.real, -turn.imag, shift.real], [turn.imag, turn.real, shift.imag]])


def _turn(track: Track, home: int, row: int) -> float:
    pose = poses_of(track, home, row)
    return 0.0 if pose is None else float(np.arctan2(pose[1, 0], pose[0, 0]))


def _mean_of(row: int, pictures: list[Picture], poses: list[Array], look: Survey) -> BodyPicture | None:
    """Turn pictures back and average them where they agree."""
    left, top, right, bottom = look.box
    scale = min(1.0, MAX_SIDE / max(right - left, bottom - top))
    size = (max(8, round(scale * (right - left))), max(8, round(scale * (bottom - top))))
    none = np.zeros((0, 0), np.float32)
    corner = np.array([left, top], np.float64)
    raw = BodyPicture(row, none, np.zeros((0, 0), np.bool_), scale, corner, np.zeros((4, 2)), none, 1.0)
    home = np.array([[1.0, 0, 0], [0, 1, 0]])
    back = np.stack(
        [_turned_back(raw, picture, pose, size) for picture, pose in zip(pictures, poses, strict=True)]
    )
    still = np.stack([_turned_back(raw, picture, home, size) for picture in pictures])
    # A film keeps what stands still as it is, its noise as well: many pictures of one attitude count as one.
    turn = np.round(np.array([np.arctan2(pose[1, 0], pose[0, 0]) for pose in poses]) / ATTITUDE_STEP)
    _, same, count = np.unique(turn, return_inverse=True, return_counts=True)
    share = (1 / count[same]).astype(np.float32)
    means = [np.average(each, axis=0, weights=share) for each in (back, still)]
    spread, usual = (
        cv2.GaussianBlur(np.sqrt(np.average((each - mean) ** 2, axis=0, weights=share)), (0, 0), 2.0)
        for each, mean in zip((back, still), means, strict=True)
    )
    agree = (spread < AGREEMENT * usual).astype(np.uint8)
    agree = cv2.erode(
        cv2.morphologyEx(agree, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)), np.ones((3, 3), np.uint8)
    )
    mask = np.asarray(agree > 0, np.bool_)
    mask[:3], mask[-3:], mask[:, :3], mask[:, -3:] = False, False, False, False
    if mask.sum() < MIN_PIXELS:
        return None
    mean = np.asarray(means[0], np.float32)
    right_slope, down_slope = (cv2.Scharr(mean, cv2.CV_32F, *axis) / 32 for axis in ((1, 0), (0, 1)))
    strength = np.hypot(right_slope, down_slope)[mask]
    rows, columns = np.nonzero(mask)
    place = np.stack([columns, rows], axis=1).astype(np.float64)
    weight = strength.astype(np.float64) ** 2 + 1e-6
    middle = np.average(place, axis=0, weights=weight)
    axes = np.linalg.eigh(np.cov((place - middle).T, aweights=weight))
    lengths = np.sqrt(np.maximum(axes.eigenvalues, 0.0))
    if lengths[0] < MIN_SPREAD:
        return None
    signs = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]])
    corners = middle + (signs * lengths) @ axes.eigenvectors.T
    unit = float(lengths[1])
    x, y = ((place - middle) / unit).T.astype(np.float32)
    right_slope, down_slope, bright = right_slope[mask], down_slope[mask], mean[mask]
    slopes = np.stack(
        [right_slope, right_slope * x, right_slope * y, down_slope, down_slope * x, down_slope * y,
         bright - bright.mean(), np.ones_like(bright)], axis=1,
    )  # fmt: skip
    points = corner + (corners + 0.5) / scale - 0.5
    return BodyPicture(row, mean, mask, scale, corner, points, np.asarray(slopes, np.float32), unit)


def _turned_back(body: BodyPicture, picture: Picture, pose: Array, size: tuple[int, int]) -> Image:
    if body.scale < 1:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.4 / body.scale), np.uint8)
    turned = cv2.warpAffine(
        picture.astype(np.float32), body.matrix(pose), size, flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    return np.asarray(cv2.GaussianBlur(turned, (0, 0), BLUR), np.float32)


def lay_onto(body: BodyPicture, picture: Picture, pose: Array) -> Array | None:
    """Return the affine pose (2, 3) from home that lays the board onto a picture; None where it is not to be seen.

    Args:
        body: The board.
        picture: A picture of the film, in grey.
        pose: The pose roughly.
    """
    size, first = body.mean.shape[::-1], pose
    home = np.hstack([body.points, np.ones((4, 1))])
    middle = (body.points.mean(axis=0) - body.corner + 0.5) * body.scale - 0.5
    rest = np.zeros(0)
    scale = 0.0
    for _ in range(MAX_ROUNDS):
        rest = _turned_back(body, picture, pose, size)[body.mask] - body.mean[body.mask]
        rest -= np.median(rest)
        scale = max(1.4826 * float(np.median(np.abs(rest))), 1.0)
        weight = 1 / (1 + (rest / (2.5 * scale)) ** 2) ** 2
        weighted = body.slopes * weight[:, None]
        normal = (weighted.T @ body.slopes).astype(np.float64)
        step = np.linalg.solve(
            normal + np.diag(1e-6 * np.diag(normal) + 1e-9), (weighted.T @ rest).astype(np.float64)
        )
        change = np.array([[step[1], step[2]], [step[4], step[5]]]) / body.unit
        shift = (step[[0, 3]] - change @ middle) / body.scale
        # The step is in the mean's pixels about its first one: from there to the home picture's.
        origin = body.corner + (1 / body.scale - 1) / 2
        inverse = np.eye(3)
        inverse[:2, :2] -= change
        inverse[:2, 2] = -shift + change @ origin
        before = home @ pose.T
        pose = (np.vstack([pose, [0, 0, 1]]) @ inverse)[:2]
        moved = float(np.abs(home @ pose.T - before).max())
        if float(np.abs(home @ (pose - first).T).max()) > MAX_CORRECTION / min(body.scale, 1.0):
            return None
        if moved < CONVERGED:
            break
    trusted = float(np.mean(np.abs(rest) < 5 * max(scale, 2.0)))
    return pose if trusted > MIN_TRUST else None


def register(clip: Clip, look: Survey, track: Track) -> Track | None:
    """Return four points of the whole body, found in every frame in which a track knows roughly where it is.

    Args:
        clip: The film.
        look: Pictures from all over it.
        track: Points that were followed in it.
    """
    body = picture_of_body(look, track)
    if body is None:
        return None
    home = np.hstack([body.points, np.ones((4, 1))])
    rows = {int(index): row for row, index in enumerate(track.index)}
    points = np.full((len(track.time), 4, 2), np.nan, np.float32)
    for frame in clip.ahead():
        row = rows.get(frame.index)
        rough = None if row is None else poses_of(track, body.home, row)
        if row is None or rough is None:
            continue
        pose = lay_onto(body, grey(frame.picture), rough)
        if pose is not None:
            points[row] = home @ pose.T
    return replace(track, points=points)
