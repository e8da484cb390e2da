"""Patches all over the picture, followed from frame to frame: those that stand still show how the camera shakes; and cuts."""

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video.film.camera import Lens
from sysid.video.film.frames import Frame, halved
from sysid.video.film.shake import MIN_FRAMES_SEEN, MIN_PATCHES, Shake, find_shake, still
from sysid.video.film.survey import SMALL_SIDE
from sysid.video.types import Mask, Picture, Points

PATCH_GRID, CELL_PATCHES = (8, 6), 2
"""At most so many patches in each cell of a grid this wide and high: one may lie on the board."""
WINDOW, APART = 15, 9
"""Side of a patch, and how far apart two are [px of the small picture]."""
MIN_QUALITY = 1e-4
"""Least eigenvalue of brightness' second moments that is more than noise, in OpenCV's unit."""
MAX_STEP = 12
"""How far a patch may go otherwise than most from one frame to the next [px of the small picture]."""
SAME_MOTION = 1.0
"""Distance from the camera's motion within which a patch shows it [px]."""
CUT_CHANGE = 12.0
"""Mean change of brightness from frame to frame above which a cut is suspected [grey levels]."""
CUT_LIKENESS = 0.5
"""Correlation of two neighbouring frames, one shifted onto the other, below which the scene has been cut."""
MAX_GOING = 0.5
"""Correlation of a patch's steps with the board's turn from frame to frame above which it lies on the board, or in its shadow."""
MAX_ROUGHNESS = 2.0
"""A patch that jumps so many times as far from frame to frame as the few best ones shows noise."""


@dataclass(slots=True)
class Background:
    """Follows patches, always against the first frame, so that nothing drifts."""

    lens: Lens
    _first: Picture = field(default_factory=lambda: np.zeros((0, 0), np.uint8))
    """The first frame, small and in grey."""
    _before: Picture | None = None
    """The frame before."""
    _anchors: Points = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    """Middles of the patches in the first frame [px of the small picture], shape (m, 2)."""
    _beside: Mask = field(default_factory=lambda: np.zeros(0, np.bool_))
    """Which patches lie beside the board and are looked for; all as long as it is not known where it moves."""
    _seen: list[Points] = field(default_factory=list)
    """Places in each frame [px], each (m, 2); NaN where one is not found, or not looked for."""
    _went: Array = field(default_factory=lambda: np.zeros(2))
    """How far most patches had moved in the last frame [px]."""

    def update(self, frame: Frame) -> Array:
        """Take in one more frame; return how far most patches have moved since the first one [px], shape (2,).

        Raises:
            SysidError: The picture changes all at once.
        """
        small, scale = halved(frame.picture, SMALL_SIDE)
        if self._before is None:
            self._first, self._anchors = small, _corners(small)
            self._beside = np.ones(len(self._anchors), np.bool_)
        elif _is_cut(self._before, small):
            raise SysidError(
                f"the whole picture changes at {frame.time:.2f} s (frame {frame.index}): a cut. "
                "Give one uncut take; trim the film first."
            )
        self._before = small
        seen = self._follow(small, (self._went / scale).astype(np.float32))
        self._seen.append(seen * scale + (scale - 1) / 2)
        self._went = self.shift(-1)
        return self._went

    def shift(self, number: int) -> Array:
        """Return how far most patches have moved from the first frame to another one [px], shape (2,)."""
        moved = (self._seen[number] - self._seen[0])[self._beside]
        moved = np.sort(moved[np.isfinite(moved[:, 0])], axis=0)  # many times faster than numpy's median
        return moved[len(moved) // 2].astype(np.float64) if len(moved) >= MIN_PATCHES else np.zeros(2)

    def pose(self, number: int) -> Array:
        """Return what takes still places of the first frame to those in another one [px], shape (2, 3): a shift and a turn."""
        good = self._beside & np.isfinite(self._seen[number][:, 0])
        home, there = self._seen[0][good], self._seen[number][good]
        estimate: Any = cv2.estimateAffinePartial2D  # its stubs do not know that it may find nothing
        found = (
            estimate(home, there, ransacReprojThreshold=SAME_MOTION)[0] if len(home) >= MIN_PATCHES else None
        )
        return np.column_stack([np.eye(2), self.shift(number)]) if found is None else found

    def leave_out(self, spare: Mask) -> None:
        """Look no longer for patches that reach into the pixels in which the board moves, shape (height, width) [px]."""
        scale = spare.shape[0] // self._first.shape[0]
        reach = scale * (WINDOW + 4)  # and a little: it moves on
        near = cv2.boxFilter(spare.astype(np.uint8), -1, (reach, reach), normalize=False) > 0
        x, y = (scale * self._anchors.T).astype(int)
        self._beside = np.asarray(~near[y, x], np.bool_)

    def shake(self, first: int, turn: Array) -> Shake:
        """Return the motion of frames against the first of the film, by patches that neither move with the board nor hold but noise.

        Args:
            first: Number of the first of n frames.
            turn: The board's turn in them [rad], shape (n,).
        """
        matrix = self.lens.matrix
        focal, centre = float(matrix[0, 0]), complex(matrix[0, 2], matrix[1, 2])
        seen = np.array(self._seen[first : first + len(turn)])
        some = self._beside & _apart(seen, self._beside, turn)
        if some.sum() < MIN_PATCHES:
            return still(len(turn), focal, centre)
        home, there = (
            np.asarray(self.lens.straighten(places[..., some, :]) @ np.array([1, 1j]) - centre, np.complex128)
            for places in (self._seen[0], seen)
        )
        return find_shake(home, there, focal, centre, known=self.lens.known)

    def _follow(self, small: Picture, went: Points) -> Points:
        """Find patches near where most were last, shape (m, 2) [px of the small picture]; NaN where one is not found."""
        places = np.full_like(self._anchors, np.nan)
        some = self._beside  # told by another thread, some time
        start = self._anchors[some]
        if len(start):
            flow: Any = cv2.calcOpticalFlowPyrLK  # its stubs do not know the type of points
            moved, good, _ = flow(
                self._first, small, start, start + went, winSize=(WINDOW, WINDOW), maxLevel=1, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
                criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 15, 0.01),
            )  # fmt: skip
            near = np.abs(moved - start - went).max(axis=1) < MAX_STEP
            places[some] = np.where((good.ravel() > 0)[:, None] & near[:, None], moved, np.nan)
        return places


def _apart(seen: Points, some: Mask, turn: Array) -> Mask:
    """Return which of some patches, seen at (n, m, 2) [px], neither move with the board's turn (n,) [rad] nor hold but noise."""
    step = np.diff(seen, axis=0)
    found = np.asarray(np.isfinite(step).all(axis=2), np.bool_)
    some = some & (found.mean(axis=0) > MIN_FRAMES_SEEN)
    if not some.any():
        return some
    step = np.where(found[..., None], step, 0.0)
    size = np.sqrt((step**2).sum(axis=0)) * np.linalg.norm(np.diff(turn))
    going = np.abs(np.einsum("n,npa->pa", np.diff(turn), step)) / np.maximum(size, 1e-9)
    own = step - np.median(step[:, some], axis=1, keepdims=True)
    rough = np.median(np.abs(own).max(axis=2), axis=0)
    usual = np.sort(rough[some])[: 2 * MIN_PATCHES][-1]
    return some & (going.max(axis=1) < MAX_GOING) & (rough < MAX_ROUGHNESS * usual + 0.05)


def _corners(small: Picture) -> Points:
    """Return what can be followed best in each part of a picture in grey [px], shape (m, 2)."""
    smooth = cv2.GaussianBlur(small, (0, 0), 1.0)
    mask = (cv2.cornerMinEigenVal(smooth, 7) > MIN_QUALITY).astype(np.uint8)
    found: list[Points] = []
    corners_in: Any = cv2.goodFeaturesToTrack  # its stubs do not know that it may find none
    for top, bottom in zip(*_parts(small.shape[0], PATCH_GRID[1]), strict=True):
        for left, right in zip(*_parts(small.shape[1], PATCH_GRID[0]), strict=True):
            cell = slice(top, bottom), slice(left, right)
            best = corners_in(smooth[cell], CELL_PATCHES, 0.01, APART, mask=mask[cell])
            found += [] if best is None else [best.reshape(-1, 2) + np.array([left, top], np.float32)]
    return np.concatenate([np.zeros((0, 2), np.float32), *found])


def _parts(length: int, count: int) -> tuple[list[int], list[int]]:
    """Begin and end of so many parts [px], without a margin in which a patch is not whole."""
    edges = np.linspace(WINDOW, length - WINDOW, count + 1).astype(int).tolist()
    return edges[:-1], edges[1:]


def _is_cut(before: Picture, now: Picture) -> bool:
    if cv2.norm(before, now, cv2.NORM_L1) < CUT_CHANGE * now.size:
        return False
    height, width = (side // 5 for side in now.shape)  # a camera that pans shows most of it again
    inner = now[height:-height, width:-width]
    return float(cv2.matchTemplate(before, inner, cv2.TM_CCOEFF_NORMED).max()) < CUT_LIKENESS
