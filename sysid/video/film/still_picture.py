"""How far a shaking camera has shifted a picture."""

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.frames import Picture

SMALL = 320
"""Width of the pictures that are compared [px]."""
FARTHEST = 0.05
"""Largest shift that is believed, in widths of the picture."""


def camera_shift(first: Picture, other: Picture) -> Array:
    """How far a shaking camera has shifted a picture [px], shape (2,)."""
    scale = max(1, first.shape[1] // SMALL)
    small = [picture[::scale, ::scale].astype(np.float32) for picture in (first, other)]
    window = cv2.createHanningWindow(small[0].shape[::-1], cv2.CV_32F)
    shift, _ = cv2.phaseCorrelate(small[0], small[1], window)
    moved = scale * np.array(shift)
    return moved if np.abs(moved).max() < FARTHEST * first.shape[1] else np.zeros(2)
