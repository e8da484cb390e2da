"""A first look through a clip: what moves in it, from a few dozen frames."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from sysid.errors import SysidError
from sysid.video.film.frames import Clip, Frame, grey
from sysid.video.types import Picture

SURVEY_FRAMES = 40
"""Frames that are looked at, spread over the clip."""
SURVEY_BYTES = 60_000_000
"""Bytes of full pictures that are kept at most, in grey."""
SURVEY_SIDE = 480
"""Long side of the pictures in which motion is looked for [px]."""
MIN_CHANGE = 18.0
"""Change of brightness that counts as motion [grey levels]."""


@dataclass(frozen=True, slots=True)
class Survey:
    """What a first look shows."""

    first: Frame
    pictures: tuple[Picture, ...]
    """Grey pictures spread over the clip."""
    box: tuple[int, int, int, int]
    """Left, top, right and bottom [px] of where something moves, or what the user gave."""
    moving: npt.NDArray[np.bool_]
    """Pixels in which something changes, as large as the picture."""
    indices: tuple[int, ...] = ()
    """Number of the frame of each of the pictures."""


def survey(clip: Clip, roi: tuple[int, int, int, int] | None) -> Survey:
    """Look through a clip and find where it moves.

    Raises:
        SysidError: Nothing moves, or the region of interest lies outside the picture.
    """
    given = None if roi is None else box_of(clip, roi)
    every = max(1, clip.announced // SURVEY_FRAMES) if clip.announced else 5
    scale = min(1.0, SURVEY_SIDE / max(clip.width, clip.height))
    keep = max(6, min(SURVEY_FRAMES, SURVEY_BYTES // (clip.width * clip.height)))
    first: Frame | None = None
    start: Picture | None = None
    low = high = np.zeros(0, np.float32)
    pictures: list[Picture] = []
    indices: list[int] = []
    for number, frame in enumerate(clip.frames(every)):
        dark = grey(frame.picture)
        if number % max(1, SURVEY_FRAMES // keep) == 0 and len(pictures) < keep:
            pictures.append(dark)
            indices.append(frame.index)
        small = np.asarray(
            cv2.resize(frame.picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8
        )
        if first is None or start is None:
            first, start = frame, np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), np.uint8)
            low = high = small.astype(np.float32)
        still = _held(small, start)
        low, high = np.minimum(low, still), np.maximum(high, still)
    if first is None:
        raise SysidError(f"{clip.path}: no frame can be decoded. Copy the file again from the camera.")
    moving = _moving(high - low, first.picture.shape[:2], given)
    if given is not None and roi is not None:
        if not moving.any() and _moving(high - low, first.picture.shape[:2], None).any():
            raise SysidError(
                f"{clip.path}: what moves is all outside --roi {' '.join(map(str, roi))}. Give the region in which the "
                f"board moves (left, top, width and height in px of {clip.width}x{clip.height}), or leave it out."
            )
        return Survey(first, tuple(pictures), given, moving, tuple(indices))
    rows, columns = np.flatnonzero(moving.any(axis=1)), np.flatnonzero(moving.any(axis=0))
    if not len(rows) and float(np.median((high - low).max(axis=2))) > MIN_CHANGE:
        raise SysidError(
            f"{clip.path}: the whole picture moves: the camera pans, zooms or is carried. Put it on a tripod, and film from "
            "before the release until the board rests."
        )
    if not len(rows):
        raise SysidError(
            f"{clip.path}: nothing moves in it. Is the board in the picture? Film the whole release, or give the "
            "region of the board with --roi LEFT TOP WIDTH HEIGHT."
        )
    margin = 10
    box = (int(columns[0]) - margin, int(rows[0]) - margin, int(columns[-1]) + margin, int(rows[-1]) + margin)
    return Survey(first, tuple(pictures), _inside(box, clip), moving, tuple(indices))


def box_of(clip: Clip, roi: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    """Turn left, top, width, height into left, top, right, bottom.

    Raises:
        SysidError: The region is empty or outside the picture.
    """
    left, top, width, height = roi
    if (
        width < 16
        or height < 16
        or left < 0
        or top < 0
        or left + width > clip.width
        or top + height > clip.height
    ):
        raise SysidError(
            f"--roi {left} {top} {width} {height}: left, top, width and height in px, at least 16x16, inside the "
            f"picture of {clip.width}x{clip.height}."
        )
    return left, top, left + width, top + height


def _inside(box: tuple[int, int, int, int], clip: Clip) -> tuple[int, int, int, int]:
    return max(box[0], 0), max(box[1], 0), min(box[2], clip.width), min(box[3], clip.height)


def _held(small: Picture, start: Picture) -> npt.NDArray[np.float32]:
    """Shift a small picture onto the first one, so that a shaking camera does not count as motion.

    Before a plain wall, what moves in the picture looks like a shift: one that makes the whole less alike is none.
    """
    dark = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY).astype(np.float32)
    window = cv2.createHanningWindow((small.shape[1], small.shape[0]), cv2.CV_32F)
    shift, _ = cv2.phaseCorrelate(start.astype(np.float32), dark, window)
    if max(abs(shift[0]), abs(shift[1])) > 0.05 * SURVEY_SIDE:
        return small.astype(np.float32)
    move = np.array([[1, 0, -shift[0]], [0, 1, -shift[1]]])
    held = cv2.warpAffine(
        small, move, (small.shape[1], small.shape[0]), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    unlike = [cv2.absdiff(grey(np.asarray(one, np.uint8)), start) for one in (small, held)]
    plain, shifted = (float(np.minimum(one, MIN_CHANGE).mean()) for one in unlike)
    return np.asarray(held if shifted < plain else small, np.float32)


def _moving(
    change: npt.NDArray[np.float32], shape: tuple[int, ...], box: tuple[int, int, int, int] | None
) -> npt.NDArray[np.bool_]:
    """Threshold the range of each pixel; keep the largest patch, in a box, and what is a fifth as large or more."""
    amount = cv2.GaussianBlur(change.max(axis=2), (0, 0), 1.5)
    level = max(MIN_CHANGE, 3 * float(np.median(amount)))
    mask = cv2.morphologyEx((amount > level).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    mask = cv2.dilate(mask, np.ones((5, 5), np.uint8))
    if box is not None:
        left, top, right, bottom = np.round(np.array(box) * amount.shape[1] / shape[1]).astype(int)
        inside = np.zeros_like(mask)
        inside[top:bottom, left:right] = 1
        mask = mask * inside
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    areas = stats[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < 40:
        return np.zeros(shape, bool)
    large = 1 + np.flatnonzero(areas >= areas.max() / 5)
    kept = np.isin(labels, large).astype(np.uint8)
    return cv2.resize(kept, shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
