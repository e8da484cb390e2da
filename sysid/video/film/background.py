"""The background: patches followed against the first frame, whether the camera moves, and cuts.

In each frame the picture decides whether the background stands still or moves as a camera that turns would show it. Patches where
something else moves are then left out, and the others give the camera's motion.
"""

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video.film.camera import Lens
from sysid.video.film.frames import Frame, halved
from sysid.video.film.shake import MIN_PATCHES, Shake, find_shake, fit_rotations, rays, still
from sysid.video.types import Mask, Picture, Points

SMALL_SIDE = 640
"""Longer side of the pictures in which motion is looked for and patches are followed [px]: a patch is found to 0.05 of these."""
WINDOW, PATCHES = 21, 48
"""Side of a patch [px of the small picture], and most patches."""
MIN_QUALITY = 1e-4
"""Least eigenvalue of the second moments of brightness at a patch, in OpenCV's unit: sensor noise of 3 grey levels has this."""
LIKENESS = 0.5
"""Correlation above which two pictures show the same [1]: neighbouring frames one scene, cells a marker, two frames a patch that stands still."""
TURN_STD = np.radians(1.0)
"""Standard deviation of the turn of a camera held by hand about its line of sight [rad]; a body turns by several times as much."""
IDENTITY = np.eye(3)
COST = np.log1p(np.arange(256)).astype(np.float32)
"""Negative log-likelihood of a difference of brightness [grey levels]: a heavy tail, so that moving things count little."""


@dataclass(slots=True)
class Background:
    """Patches all over the picture, compared with the first frame: they do not drift."""

    lens: Lens
    stands: bool = False
    """The user says that the camera stands still."""
    _first: Picture = field(default_factory=lambda: np.zeros((0, 0), np.uint8))
    """The first frame, small and in grey."""
    _before: Picture | None = None
    _anchors: Points = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """Middles of the patches in the first frame [px of the small picture], shape (m, 2)."""
    _beside: Mask = field(default_factory=lambda: np.zeros(0, np.bool_))
    """Patches beside the body; all until it is known where the body moves."""
    _seen: list[Points] = field(default_factory=list)
    """Places in each frame [px], each (m, 2); NaN where a patch is not found."""
    _gains: list[float] = field(default_factory=list)
    _poses: list[Array] = field(default_factory=list)
    """The background's motion since the first frame [px of the small picture], homogeneous, each (3, 3)."""

    def update(self, frame: Frame) -> Array:
        """Take in the next frame; return the shift of the picture's middle since the first one [px], shape (2,).

        Raises:
            SysidError: The picture changes all at once.
        """
        small, scale = halved(frame.picture, SMALL_SIDE)
        if self._before is None:
            self._first = small
            self._anchors = np.zeros((0, 2), np.float32) if self.stands else _corners(small)
            self._beside = np.ones(len(self._anchors), np.bool_)
        elif _is_cut(self._before, small):
            raise SysidError(
                f"the whole picture changes at {frame.time:.2f} s (frame {frame.index}): a cut. "
                "Give one uncut take; trim the film first."
            )
        self._before = small
        self._gains.append(_gain(small, self._first))
        small = np.asarray(cv2.convertScaleAbs(small, alpha=self._gains[-1]), np.uint8)
        self._seen.append(self._follow(small) * scale + (scale - 1) / 2)
        self._poses.append(self._likelier(small, scale))
        middle = np.array(small.shape[::-1]) / 2
        x, y, z = self._poses[-1] @ np.append(middle, 1.0)
        return scale * (np.array([x, y]) / z - middle)

    def pose(self, number: int) -> tuple[Array, float]:
        """Return the background's motion since the first frame [px of the small picture], shape (3, 3), and the light's loss.

        Both are of one frame; the second is the factor that makes it as bright as the first one.
        """
        return self._poses[number], self._gains[number]

    def leave_out(self, moving: Mask) -> None:
        """Stop following patches that reach into pixels that move, shape (height, width) [px]."""
        scale = moving.shape[0] // self._first.shape[0]
        reach = 2 * scale * WINDOW
        near = cv2.boxFilter(moving.astype(np.uint8), -1, (reach, reach), normalize=False) > 0
        x, y = (scale * self._anchors.T).astype(int)
        self._beside = np.asarray(~near[y, x], np.bool_)

    def shake(self, first: int, count: int) -> Shake:
        """Return the camera's motion in some frames, of which the first one has this number, against the first one of the film."""
        seen = np.array(self._seen[first : first + count])[:, self._beside]
        usual = np.isfinite(seen[..., 0]).mean(axis=0) > 0.5
        if self.stands or usual.sum() < MIN_PATCHES:
            return still(count, self.lens.matrix, found=self.stands)
        home, seen = (
            self.lens.straighten(one) for one in (self._seen[0][self._beside][usual], seen[:, usual])
        )
        return find_shake(home, seen, self.lens.matrix)

    def _follow(self, small: Picture) -> Points:
        """Find the patches, shape (m, 2) [px of the small picture]; NaN where one is not found."""
        places = np.full_like(self._anchors, np.nan)
        some = self._beside
        start = self._anchors[some]
        if len(start):
            last = self._poses[-1] if self._poses else IDENTITY
            guess = cv2.perspectiveTransform(start[None], last)[0]
            flow: Any = cv2.calcOpticalFlowPyrLK  # its stubs do not know the type of points
            moved, good, _ = flow(
                self._first, small, start, guess, winSize=(WINDOW, WINDOW), maxLevel=1, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
                criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.01),
            )  # fmt: skip
            near = np.abs(moved - guess).max(axis=1) < WINDOW
            places[some] = np.where((good.ravel() > 0)[:, None] & near[:, None], moved, np.nan)
        return places

    def _likelier(self, small: Picture, scale: int) -> Array:
        """Return the motion on which most patches of the last frame agree if it is likelier than none.

        The median over the corners of the picture decides: a body reaches into one of them at most. Before a plain wall the
        motion of the body itself would explain the whole picture better than none.
        """
        good = self._beside & np.isfinite(self._seen[-1][:, 0])
        if good.sum() < MIN_PATCHES:
            return IDENTITY
        lens = self.lens
        home, seen = (
            rays(lens.straighten(places[good]), lens.matrix) for places in (self._seen[0], self._seen[-1])
        )
        turn = fit_rotations(home, seen[None])[0][0]
        middle = (1 / scale - 1) / 2
        matrix = np.array([[1 / scale, 0, middle], [0, 1 / scale, middle], [0, 0, 1]]) @ lens.matrix
        found = matrix @ turn @ np.linalg.inv(matrix)
        size, flags = small.shape[::-1], cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        shown = cv2.warpPerspective(np.ones_like(small), found, size, flags=flags)
        back = cv2.warpPerspective(small, found, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        # Means of 5x5 pixels: interpolation takes no noise away from them.
        first, *both = (cv2.blur(one, (5, 5)) for one in (self._first, small, back))
        none, moved = (cv2.LUT(cv2.absdiff(one, first), COST) for one in both)
        height, width = (side // 4 for side in small.shape)
        gains = [
            cv2.mean(none[rows, columns] - moved[rows, columns], shown[rows, columns])[0]
            for rows in (slice(height), slice(-height, None))
            for columns in (slice(width), slice(-width, None))
        ]
        blocks = 4 * height * width / 16**2  # a film holds blocks of 16x16 pixels, whose errors are one
        aside = float(turn[1, 0]) / TURN_STD
        return found if np.median(gains) * blocks > 1.5 * np.log(blocks) + aside**2 / 2 else IDENTITY


def _gain(picture: Picture, other: Picture) -> float:
    """Return the factor that makes a picture as bright as another one: the median, as something that passes changes some pixels."""
    return float(np.median((other[::8, ::8] + 1.0) / (picture[::8, ::8] + 1.0)))


def _corners(small: Picture) -> Points:
    """Return patches all over a picture in grey [px], shape (m, 2): the best ones that lie as far apart as in a grid."""
    smooth, border = cv2.GaussianBlur(small, (0, 0), 1.0), np.zeros_like(small)
    border[WINDOW:-WINDOW, WINDOW:-WINDOW] = 1  # a patch there is not whole
    apart = float(np.sqrt(small.size / PATCHES))
    quality = MIN_QUALITY / max(float(cv2.cornerMinEigenVal(smooth, 7).max()), MIN_QUALITY)
    corners_in: Any = cv2.goodFeaturesToTrack  # its stubs do not know that it may find none
    found = corners_in(smooth, PATCHES, quality, apart, mask=border, blockSize=7)
    return np.zeros((0, 2), np.float32) if found is None else found.reshape(-1, 2)


def _is_cut(before: Picture, now: Picture) -> bool:
    if cv2.norm(before, now, cv2.NORM_L1) < 12 * now.size:  # the search below takes long
        return False
    height, width = (side // 5 for side in now.shape)  # a camera that pans shows most of it again
    inner = now[height:-height, width:-width]
    return float(cv2.matchTemplate(before, inner, cv2.TM_CCOEFF_NORMED).max()) < LIKENESS
