"""Motion in a film: the pixels that change, from small pictures."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.background import SMALL_SIDE
from sysid.video.film.frames import Frame, halved, in_colour
from sysid.video.types import Box, Image, Mask, Picture

MAX_SHAKE = 0.05
"""Share of the picture's long side by which a camera held by hand shakes; one that moves further pans."""
MIN_CHANGE = 18
"""Range of brightness that counts as motion [grey levels]: compression alone reaches 12 in films of 0.05 bit a pixel."""
MIN_AREA = 40
"""Least area of a moving region [px of the small picture], and of a dot [px]."""


@dataclass(frozen=True, slots=True)
class Survey:
    """The result of a first look."""

    frames: tuple[Frame, ...]
    """Some, spread over the frames that were looked at, the first one first."""
    box: Box
    """Left, top, right and bottom [px] of where something moves, inside the user's region."""
    moving: Mask
    """Pixels in which something changes, as large as the picture."""

    @property
    def kept(self) -> Box:
        """The part of the box that was kept in the frames [px]."""
        return self.frames[0].within(self.box)


@dataclass(slots=True)
class Motion:
    """Range of each pixel over small pictures, without the shake of the camera and changes of the light."""

    _low: Picture = field(default_factory=lambda: np.array(255, np.uint8))
    """Least and most that each pixel has shown, in colour, shape (h, w, 3)."""
    _high: Picture = field(default_factory=lambda: np.array(0, np.uint8))
    _shape: tuple[int, ...] = ()
    _went: list[float] = field(default_factory=list)
    """How far the camera has gone in each frame [px of the small picture]."""

    def add(self, frame: Frame, pose: Array, gain: float) -> None:
        """Take in the next whole frame, with the pose, shape (3, 3) [px], and the gain [1] of `Background.pose`."""
        self._shape = frame.picture.shape
        bright = halved(frame.picture, SMALL_SIDE)[0]
        small = in_colour(bright, [halved(one, SMALL_SIDE)[0] for one in frame.chroma])
        small = np.asarray(cv2.convertScaleAbs(small, alpha=gain), np.uint8)
        height, width = small.shape[:2]
        corners = np.array([[[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]]])
        went = float(np.abs(cv2.perspectiveTransform(corners, pose) - corners).max())
        self._went.append(went)
        if went:
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            hidden = np.broadcast_to(self._low, small.shape).copy()
            small = np.asarray(
                cv2.warpPerspective(small, pose, (width, height), hidden, flags, cv2.BORDER_TRANSPARENT),
                np.uint8,
            )
        self._low, self._high = np.minimum(self._low, small), np.maximum(self._high, small)

    def mask(self, within: Box | None) -> Mask:
        """Return which pixels of the whole picture change, shape (height, width), inside a box [px] if there is one."""
        blue, green, red = cv2.split(cv2.subtract(self._high, self._low))
        change = cv2.max(cv2.max(blue, green), red).astype(np.float32)
        return _moving(change, self._shape, within)

    @property
    def pans(self) -> bool:
        """Whether the background is further away than the shake of a hand in half of the frames."""
        return float(np.median(self._went)) > MAX_SHAKE * SMALL_SIDE


def box_around(mask: Mask, margin: int) -> Box:
    """Return left, top, right and bottom [px] of the pixels set, shape (height, width), and a margin inside the picture."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        max(int(columns[0]) - margin, 0),
        max(int(rows[0]) - margin, 0),
        min(int(columns[-1]) + margin, mask.shape[1]),
        min(int(rows[-1]) + margin, mask.shape[0]),
    )


def _moving(change: Image, shape: tuple[int, ...], box: Box | None) -> Mask:
    """Threshold the range of each pixel; keep the largest region in a box, those a fifth as large, and those among them."""
    amount = cv2.GaussianBlur(change, (0, 0), 1.5)
    # Most of the picture may move; a quarter that stands still shows the noise.
    level = max(MIN_CHANGE, 3 * float(np.quantile(amount, 0.25)))
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
