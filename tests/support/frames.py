"""Frames of a film from pictures, as a decoder would hold them."""

import cv2
import numpy as np
import numpy.typing as npt

from sysid.video.film.frames import Frame


def frame_of(number: int, time: float, picture: npt.NDArray[np.uint8]) -> Frame:
    """Return a frame of a picture, shape (h, w) grey or (h, w, 3) in the order blue, green, red."""
    colour = picture if picture.ndim == 3 else cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
    height, width = (side + side % 2 for side in picture.shape[:2])
    odd = height - picture.shape[0], width - picture.shape[1]
    even = cv2.copyMakeBorder(colour, 0, odd[0], 0, odd[1], cv2.BORDER_REPLICATE)
    planes = cv2.cvtColor(even, cv2.COLOR_BGR2YUV_I420)
    blue, red = planes[height:].reshape(2, height // 2, width // 2)
    return Frame(number, time, planes[: picture.shape[0], : picture.shape[1]], (blue, red))
