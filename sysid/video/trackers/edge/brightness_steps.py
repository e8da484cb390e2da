"""Steps of brightness in the pictures of a film: what edges are made of."""

from dataclasses import dataclass

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.frames import Frame, grey

STEPS_WIDTH = 640
"""Width of the pictures in which edges are looked for [px]."""
MOVING_RATIO = 1.5
"""Ratio by which what is seen in one picture must be stronger than what is seen there in all of them."""


@dataclass(frozen=True, slots=True)
class Steps:
    """Slopes of brightness in one picture, made small."""

    right: Array
    down: Array
    scale: float
    """Its pixels in one of the film."""
    corner: tuple[int, int] = (0, 0)
    """Left and top of the picture in the film's [px]."""

    def across(self, place: Array, turn: Array) -> Array:
        """Slope of brightness across lines [grey levels/px], of the shape of `place` without its last axis.

        Args:
            place: Places in the picture [px], shape (m, 2) or with more axes before.
            turn: Slopes of the lines there [rad], a shape that broadcasts with the result's.
        """
        there = (
            ((place - self.corner + 0.5) * self.scale - 0.5)
            .astype(np.float32)
            .reshape(-1, place.shape[-2], 2)
        )
        right, down = (
            cv2.remap(part, there[..., 0], there[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for part in (self.right, self.down)
        )
        shape = place.shape[:-1]
        return np.asarray(
            np.cos(turn) * down.reshape(shape) - np.sin(turn) * right.reshape(shape), np.float64
        )


def steps_of(frame: Frame) -> Steps:
    """Return the slopes of brightness [grey levels/px] in a frame, made small."""
    dark = grey(frame.picture)
    scale = min(1.0, STEPS_WIDTH / max(dark.shape))
    small = cv2.resize(dark, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else dark
    smooth = cv2.GaussianBlur(small.astype(np.float32), (0, 0), 1.0)
    right, down = (cv2.Scharr(smooth, cv2.CV_32F, *axis) / 32 for axis in ((1, 0), (0, 1)))
    return Steps(right, down, scale, frame.corner)


def without_still(every: list[Steps], shifts: Array) -> list[Steps]:
    """Return steps of brightness without those that are in all pictures: they would coincide if nothing turned.

    Args:
        every: Of each picture.
        shifts: How far each is shifted by a camera that shakes [px], shape (n, 2).
    """
    moves = [
        np.array([[1, 0, one.scale * x], [0, 1, one.scale * y]])
        for one, (x, y) in zip(every, shifts, strict=True)
    ]
    size = every[0].right.shape[::-1]
    least = np.full(every[0].right.shape, np.inf, np.float32)
    for one, move in zip(every, moves, strict=True):
        amount = cv2.dilate(np.hypot(one.right, one.down), np.ones((3, 3), np.uint8))
        still = cv2.warpAffine(
            amount, move, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
        )
        least = np.minimum(least, still)
    cleared: list[Steps] = []
    for one, move in zip(every, moves, strict=True):
        there = cv2.warpAffine(least, move, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        amount = np.hypot(one.right, one.down)
        moving = np.clip(amount / np.maximum(MOVING_RATIO * there, 1e-3) - 1, 0, 1)
        cleared.append(Steps(one.right * moving, one.down * moving, one.scale, one.corner))
    return cleared
