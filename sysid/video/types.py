"""Arrays that all rooms of the film share."""

import numpy as np
import numpy.typing as npt

Complex = npt.NDArray[np.complex128]
"""Places in a picture, x + i y with y down."""
Picture = npt.NDArray[np.uint8]
"""A picture: brightness, shape (height, width), or colour as OpenCV holds it, (height, width, 3) in the order blue, green, red."""
Image = npt.NDArray[np.float32]
"""Brightness or a function of it, pixel by pixel, shape (height, width) or with more axes behind."""
Points = npt.NDArray[np.float32]
"""Points in pictures [px], shape (..., 2): half the memory of double precision."""
Mask = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.intp]
"""Numbers of frames."""
Box = tuple[int, int, int, int]
"""Left, top, right and bottom [px]."""
