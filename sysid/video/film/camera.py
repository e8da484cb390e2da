"""The camera's matrix and lens: from a file, from a film of a chessboard, or the guess that serves."""

import json
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from sysid.errors import SysidError
from sysid.files import regular
from sysid.roll import Array
from sysid.video.film.frames import SURVEY_FRAMES, Clip, open_clip
from sysid.video.options import is_film
from sysid.video.types import Points

Places = TypeVar("Places", Array, Points)
USUAL_FOCAL = 0.9
"""Focal length of a phone's main camera in film mode, over the long side of the picture (58 degrees)."""
FOCAL_SPREAD = 0.25
"""Standard deviation of its logarithm [1]: zoom, crop and stabilisation."""
CHESSBOARD = (9, 6)
"""Inner corners of the chessboard that is looked for."""


@dataclass(frozen=True, slots=True)
class Lens:
    """A pinhole camera with radial and tangential distortion, in OpenCV's convention."""

    matrix: Array
    """Camera matrix [px], shape (3, 3)."""
    distortion: Array
    """k1, k2, p1, p2, k3 ...; all zero where the lens is taken as straight."""
    known: bool
    """Whether it was calibrated."""
    note: str
    """Its source, for people."""

    def straighten(self, points: Places) -> Places:
        """Return points [px], shape (N, 2) or (n, N, 2), as a lens without distortion shows them; NaN stays NaN."""
        if not np.any(self.distortion):
            return points
        flat = points.reshape(-1, 1, 2).copy()
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-7)
        flat[:] = cv2.undistortPoints(flat, self.matrix, self.distortion, P=self.matrix, criteria=criteria)
        return flat.reshape(points.shape)


def lens_of(clip: Clip, calibration: Path | None) -> Lens:
    """Return the lens that a clip was filmed with; without calibration, a phone's usual one.

    Raises:
        SysidError: The calibration cannot be read, or belongs to another shape of picture.
    """
    if calibration is None:
        focal = USUAL_FOCAL * max(clip.width, clip.height)
        matrix = np.array([[focal, 0, (clip.width - 1) / 2], [0, focal, (clip.height - 1) / 2], [0, 0, 1]])
        return Lens(matrix, np.zeros(5), False, "not calibrated: a phone's usual one, without distortion")
    if is_film(calibration):
        matrix, distortion, size, note = _from_chessboard(calibration)
    else:
        matrix, distortion, size, note = _from_file(calibration)
    scale = clip.width / size[0]
    if abs(clip.height / size[1] / scale - 1) > 0.01:
        raise SysidError(
            f"{calibration}: it is for pictures of {size[0]}x{size[1]}, the film has {clip.width}x{clip.height}. "
            "Calibrate in the mode and attitude in which you film."
        )
    matrix = np.diag([scale, scale, 1.0]) @ matrix
    return Lens(matrix, distortion, True, note)


def _from_file(path: Path) -> tuple[Array, Array, tuple[int, int], str]:
    """Read JSON with our field names, or the YAML and XML that OpenCV's and ROS's calibrators write."""
    try:
        text = regular(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SysidError(f"{path}: cannot read the calibration ({error}).") from error
    try:
        if text.lstrip().startswith("{"):
            raw = json.loads(text)
            matrix = np.array(raw["camera_matrix"], float).reshape(3, 3)
            distortion = np.ravel(np.array(raw["distortion_coefficients"], float))
            size = int(raw["image_width"]), int(raw["image_height"])
        else:
            if not text.startswith(("%YAML", "<?xml")):
                text = "%YAML:1.0\n---\n" + text
            store = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
            matrix = np.asarray(store.getNode("camera_matrix").mat(), float).reshape(3, 3)
            distortion = np.ravel(np.asarray(store.getNode("distortion_coefficients").mat(), float))
            size = int(store.getNode("image_width").real()), int(store.getNode("image_height").real())
    except (KeyError, ValueError, TypeError, AttributeError, SystemError, cv2.error) as error:
        raise SysidError(
            f"{path}: not a calibration. Expected image_width, image_height, camera_matrix (3x3) and "
            "distortion_coefficients, as JSON or as OpenCV's YAML; or a film of a chessboard."
        ) from error
    if not (np.isfinite(matrix).all() and matrix[0, 0] > 0 and matrix[1, 1] > 0 and min(size) > 0):
        raise SysidError(
            f"{path}: the focal lengths or the picture's size are not positive. Calibrate again."
        )
    return matrix, distortion, size, f"from {path}"


def _from_chessboard(path: Path) -> tuple[Array, Array, tuple[int, int], str]:
    clip = open_clip(path)
    every = max(1, clip.announced // SURVEY_FRAMES)
    views: list[Points] = []
    for frame in islice(clip.frames(), 0, None, every):
        seen, corners = cv2.findChessboardCornersSB(frame.picture, CHESSBOARD)
        if seen and (not views or np.abs(corners - views[-1]).mean() > 0.01 * clip.width):
            views.append(np.asarray(corners, np.float32))
    if len(views) < 5:
        raise SysidError(
            f"{path}: a chessboard is seen in {len(views)} different attitudes; 5 are needed. Film a printed one "
            "(9x6 inner corners) slowly from all sides, filling the picture."
        )
    across, down = CHESSBOARD
    grid = np.zeros((across * down, 3), np.float32)
    grid[:, :2] = np.mgrid[0:across, 0:down].T.reshape(-1, 2)
    size = (clip.width, clip.height)
    error, matrix, distortion, _, _ = cv2.calibrateCamera(
        [grid] * len(views), views, size, np.eye(3), np.zeros(5)
    )
    note = f"from {len(views)} views of a {across}x{down} chessboard, {error:.2f} px"
    if error > 1.5:
        raise SysidError(
            f"{path}: the lens {note} off on average: the board is bent or the film blurred. Film it again."
        )
    return np.asarray(matrix, float), np.ravel(np.asarray(distortion, float)), size, note
