"""What moves in a film, from small pictures of it."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.frames import Frame, halved, in_colour
from sysid.video.types import Box, Image, Mask, Picture

SMALL_SIDE = 640
"""Longer side of the pictures in which motion is looked for, and patches of the background are followed [px]."""
MAX_SHAKE = 0.05
"""Share of the picture's long side by which a camera may shake; one that moves further pans."""
MIN_CHANGE = 18
"""Change of brightness that counts as motion [grey levels]."""
MIN_AREA = 40
"""Least area of what moves [px of the small picture]."""
MIN_REGION = 16
"""Least width and height of a region that the user gives [px]."""
BOX_MARGIN = 10
"""What is added to what moves, on each side [px]."""


@dataclass(frozen=True, slots=True)
class Survey:
    """What a first look shows."""

    frames: tuple[Frame, ...]
    """Some, spread over what was looked at, the first one first."""
    box: Box
    """Left, top, right and bottom [px] of where something moves, as far as the user wants it to be looked at."""
    moving: Mask
    """Pixels in which something changes, as large as the picture."""

    @property
    def kept(self) -> Box:
        """What was kept of the box in the frames [px]: of a large film less, if it moves further later on."""
        return self.frames[0].within(self.box)


@dataclass(slots=True)
class Motion:
    """How far each pixel of small pictures changes; shake of the camera is no motion."""

    _low: Picture = field(default_factory=lambda: np.array(255, np.uint8))
    """Least and most that each pixel has shown, in colour, shape (h, w, 3)."""
    _high: Picture = field(default_factory=lambda: np.array(0, np.uint8))
    _shape: tuple[int, ...] = ()
    _furthest: float = 0.0
    """How far the camera went [px of the small picture]."""

    def add(self, frame: Frame, pose: Array) -> None:
        """Take in one more whole frame, and where the camera's shake has put the first one in it [px], shape (2, 3)."""
        self._shape = frame.picture.shape
        bright, times = halved(frame.picture, SMALL_SIDE)
        small = in_colour(bright, [halved(one, SMALL_SIDE)[0] for one in frame.chroma])
        self._furthest = max(self._furthest, float(np.abs(frame.shift).max()) / times)
        still = _held(small, pose / [1, 1, times], np.broadcast_to(self._low, small.shape))
        self._low, self._high = np.minimum(self._low, still), np.maximum(self._high, still)

    @property
    def _change(self) -> Image:
        """Range of each pixel of the small picture [grey levels], shape (h, w)."""
        blue, green, red = cv2.split(cv2.subtract(self._high, self._low))
        return cv2.max(cv2.max(blue, green), red).astype(np.float32)

    def mask(self, within: Box | None) -> Mask:
        """Return which pixels of the whole picture change, shape (height, width), inside a box [px] if there is one."""
        return _moving(self._change, self._shape, within)

    @property
    def pans(self) -> bool:
        """Whether most of the picture changes, and the camera went far or nothing stands out."""
        everywhere = float(np.median(self._change)) > MIN_CHANGE
        return everywhere and (self._furthest > MAX_SHAKE * SMALL_SIDE or not self.mask(None).any())


def box_around(mask: Mask, margin: int) -> Box:
    """Return left, top, right and bottom [px] of what is set, shape (height, width), and a margin as far as the picture reaches."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        max(int(columns[0]) - margin, 0),
        max(int(rows[0]) - margin, 0),
        min(int(columns[-1]) + margin, mask.shape[1]),
        min(int(rows[-1]) + margin, mask.shape[0]),
    )


def _held(small: Picture, pose: Array, other: Picture) -> Picture:
    """Put a small picture onto the first one, which is in it at a pose, if that is more than noise and no pan; what it does not show is another one's."""
    height, width = small.shape[:2]
    corners = np.array([[0, 0, 1], [width, 0, 1], [0, height, 1], [width, height, 1]])
    if not 0.05 < np.abs(corners @ pose.T - corners[:, :2]).max() < 2 * MAX_SHAKE * SMALL_SIDE:
        return small
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    held = cv2.warpAffine(small, pose, (width, height), other.copy(), flags, cv2.BORDER_TRANSPARENT)
    return np.asarray(held, np.uint8)


def _moving(change: Image, shape: tuple[int, ...], box: Box | None) -> Mask:
    """Threshold the range of each pixel; keep the largest patch, in a box, what is a fifth as large or more, and what lies among these."""
    amount = cv2.GaussianBlur(change, (0, 0), 1.5)
    level = max(MIN_CHANGE, 3 * float(np.median(amount)))
    mask = cv2.morphologyEx((amount > level).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    mask = cv2.dilate(mask, np.ones((5, 5), np.uint8))
    if box is not None:
        left, top, right, bottom = np.round(np.array(box) * amount.shape[1] / shape[1]).astype(int)
        inside = np.zeros_like(mask)
        inside[top:bottom, left:right] = 1
        mask = mask * inside
    count, labels, stats, centres = cv2.connectedComponentsWithStats(mask)
    areas = stats[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < MIN_AREA:
        return np.zeros(shape, bool)
    low, size = stats[1:, :2], stats[1:, 2:4]
    large = areas >= areas.max() / 5
    # A sticker on a plain deck moves by itself: nothing joins its path to that of the deck's edges.
    among = (centres[1:] > low[large].min(axis=0)) & (centres[1:] < (low + size)[large].max(axis=0))
    kept = np.concatenate([[False], large | (among.all(axis=1) & (areas > MIN_AREA))]).astype(np.uint8)
    return cv2.resize(kept[np.asarray(labels, np.intp)], shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
