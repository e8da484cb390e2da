"""How far a shaking camera has shifted a picture."""

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.types import Picture

COMPARED_WIDTH = 320
"""Width of the pictures that are compared [px]."""
MAX_SHIFT = 0.05
"""Largest shift that is believed, as a share of the picture's width."""


def camera_shift(first: Picture, other: Picture) -> Array:
    """How far a shaking camera has shifted a picture [px], shape (2,)."""
    scale = max(1, first.shape[1] // COMPARED_WIDTH)
    small = [picture[::scale, ::scale].astype(np.float32) for picture in (first, other)]
    window = cv2.createHanningWindow(small[0].shape[::-1], cv2.CV_32F)
    shift, _ = cv2.phaseCorrelate(small[0], small[1], window)
    moved = scale * np.array(shift)
    return moved if np.abs(moved).max() < MAX_SHIFT * first.shape[1] else np.zeros(2)
