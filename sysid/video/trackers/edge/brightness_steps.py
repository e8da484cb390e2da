"""Steps of brightness in the pictures of a film: what edges are made of."""

from dataclasses import dataclass

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.frames import Frame, halved
from sysid.video.types import Box, Image

STEPS_SIDE = 640
"""Longer side of the pictures in which edges are looked for [px]."""
MAX_SLOPE = 8.0
"""Slope of brightness beyond which more is no better [grey levels/px]: the deck's end against its own upper side
tells as much as against a bright wall."""
ATTITUDE_STEP = np.radians(3.0)
"""Turns within this are one attitude [rad]."""
MOVING_RATIO = 1.5
"""Ratio by which what is seen in one picture must be stronger than what is seen there in all of them."""


@dataclass(frozen=True, slots=True)
class Steps:
    """Slopes of brightness in one picture, made small."""

    slopes: Image
    """To the right and down [grey levels/px], shape (h, w, 2)."""
    scale: float
    """Its pixels in one of the film."""
    corner: tuple[int, int] = (0, 0)
    """Left and top of the picture in the film's [px]."""

    @property
    def amount(self) -> Image:
        """How steep they are [grey levels/px], shape (h, w)."""
        return np.asarray(np.abs(self.slopes.view(np.complex64)[..., 0]), np.float32)

    def here(self, place: Array) -> Array:
        """Return where the small picture shows places of the film, both [px], shape (m, 2) or with more axes before."""
        return (place - self.corner + 0.5) * self.scale - 0.5

    def across(self, place: Array, turn: Array) -> Array:
        """Slope of brightness across lines [grey levels/px], of the shape of `place` without its last axis.

        Args:
            place: Places in the picture [px], shape (m, 2) or with more axes before.
            turn: Slopes of the lines there [rad], a shape that broadcasts with the result's.
        """
        x, y = np.moveaxis(self.here(place).astype(np.float32).reshape(-1, place.shape[-2], 2), -1, 0)
        seen = cv2.remap(self.slopes, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        right, down = np.moveaxis(seen.reshape(place.shape), -1, 0)
        return np.asarray(np.cos(turn) * down - np.sin(turn) * right, np.float64)

    def on_grid(self, pivot: Array, x: Array, y: Array, turn: float) -> Image:
        """Return the slope of brightness across the rows of a grid that is turned about a pivot [grey levels/px], shape (Y, X).

        Args:
            pivot: What it is turned about [px], shape (2,).
            x: Evenly spaced places across, from the pivot [px], shape (X,).
            y: The same down, shape (Y,).
            turn: Turn of the grid [rad].
        """
        cosine, sine = np.cos(turn), np.sin(turn)
        turning = self.scale * np.array([[cosine, -sine], [sine, cosine]])
        begin = self.here(pivot) + turning @ (x[0], y[0])
        move = np.hstack([turning * (x[1] - x[0], y[1] - y[0]), begin[:, None]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpAffine(
            self.slopes, move, (len(x), len(y)), flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(cv2.transform(seen, np.array([[-sine, cosine]])), np.float32)


def turned(place: Array, turn: Array | float) -> Array:
    """Turn places [px], shape (..., 2), about the origin, clockwise in the picture.

    Args:
        place: [px], shape (..., 2).
        turn: [rad], of a shape that broadcasts with places' axes but the last, as shape (m,) with (m, 2).
    """
    z = (place[..., 0] + 1j * place[..., 1]) * np.exp(1j * np.asarray(turn))
    return np.stack([z.real, z.imag], axis=-1)


def scale_of(box: Box) -> float:
    """Return how small pictures of a box [px] are made for edges to be looked for in them, their pixels in one of the film."""
    return min(1.0, STEPS_SIDE / max(box[2] - box[0], box[3] - box[1]))


def steps_of(frame: Frame, scale: float) -> Steps:
    """Return the slopes of brightness [grey levels/px] in a frame, made small."""
    dark, times = halved(frame.picture, round(2 * scale * max(frame.picture.shape)))
    ratio = scale * times
    small = cv2.resize(dark, None, fx=ratio, fy=ratio) if scale < 1 else dark
    smooth = cv2.GaussianBlur(small.astype(np.float32), (0, 0), 1.0)
    slopes = cv2.merge([cv2.Scharr(smooth, cv2.CV_32F, *axis, scale=1 / 32) for axis in ((1, 0), (0, 1))])
    return Steps(np.asarray(slopes, np.float32), scale, frame.corner)


def leave_out_still(every: list[Steps], shifts: Array) -> None:
    """Take those steps of brightness out that are in all pictures: they would coincide if nothing turned.

    Args:
        every: Of each picture.
        shifts: How far each is shifted by a camera that shakes [px], shape (n, 2).
    """
    moves = [
        np.array([[1, 0, one.scale * x], [0, 1, one.scale * y]])
        for one, (x, y) in zip(every, shifts, strict=True)
    ]
    shape = every[0].slopes.shape[:2]
    size, least = shape[::-1], np.full(shape, np.inf, np.float32)
    for one, move in zip(every, moves, strict=True):
        amount = cv2.dilate(one.amount, np.ones((3, 3), np.uint8))
        still = cv2.warpAffine(
            amount, move, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
        )
        least = np.minimum(least, still)
    least = np.maximum(MOVING_RATIO * least, np.float32(1e-3))
    for one, move in zip(every, moves, strict=True):
        there = cv2.warpAffine(least, move, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        one.slopes.view(np.complex64)[..., 0] *= np.clip(one.amount / there - 1, 0, 1)
