"""Points on straight edges to a hundredth of a pixel, and lines through them."""

from collections.abc import Sequence

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.frames import Frame

PIECES = 16
"""Points along an edge."""
MIN_CONTRAST = 10.0
"""Least step of brightness at an edge [grey levels]: three times the usual noise of a film."""


def find_steps(frame: Frame, ends: Array, reach: float, window: float) -> Array:
    """Move points evenly along edges onto the steps of brightness that rise across them within `reach` [px].

    Brightness rises along the normal (dy, -dx) of the way between the rough ends, shape (m, 2, 2) [px]. The window that weighs a
    step is given in widths of the step. A width of 1 is best against noise (matched filter). A wider one suffers less from the
    pixels' grid.

    Returns:
        Points, shape (m, PIECES, 2) [px]; NaN where there is no such step.
    """
    along = ends[:, None, 1] - ends[:, None, 0]
    length = np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-9)
    profiles = int(np.ceil(length.max() / PIECES))  # one each px: every pixel tells
    share = (np.arange(PIECES * profiles)[:, None] + 0.5) / (PIECES * profiles)
    feet = ends[:, None, 0] + share * along
    normal = along[..., ::-1] * [1, -1] / length
    offset = np.arange(-np.ceil(reach) - 1, np.ceil(reach) + 2)
    # One coordinate after the other: that takes a quarter of the time.
    start, away = (feet - frame.corner)[..., None], normal[..., None] * offset
    x, y = (np.float32(start[:, :, at] + away[:, :, at]).reshape(-1, len(offset)) for at in (0, 1))
    seen = cv2.remap(frame.picture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    each = np.asarray(seen, np.float32).reshape(len(ends), PIECES, profiles, -1)
    step = np.diff((np.ones(profiles, np.float32) @ each).astype(np.float64) / profiles, axis=2)
    place, rise = _steepest(step, offset[:-1] + 0.5, window)
    place = np.where((rise < MIN_CONTRAST) | (np.abs(place) > reach), np.nan, place)
    return feet.reshape(len(ends), PIECES, profiles, 2).mean(axis=2) + place[..., None] * normal


def _steepest(step: Array, offset: Array, window: float) -> tuple[Array, Array]:
    """Return where brightness rises most [px], and by how much [grey levels], of steps (m, count, S), without the last axis.

    The centroid of the steps under a window about it is the true edge for any symmetric blur. A window draws the centroid to
    its middle by a share that is known; each round goes as much further.
    """
    smooth = step.copy()
    smooth[..., 1:-1] = (step[..., :-2] + 2 * step[..., 1:-1] + step[..., 2:]) / 4
    place, top = offset[np.argmax(smooth, axis=-1)], smooth.max(axis=-1)
    near = np.abs(offset - place[..., None]) <= 4
    rise = (np.maximum(step - 0.1 * top[..., None], 0) * near).sum(axis=-1)
    # One width for all of an edge: that of a normal distribution as high. No lens is sharper than half a pixel.
    usual = np.median(rise / np.maximum(top, 1e-9), axis=-1)
    width = np.maximum(window * usual / np.sqrt(2 * np.pi), 0.5)[..., None, None]
    rising = np.maximum(step, 0)
    for _ in range(3):
        weight = rising * np.exp(-0.5 * ((offset - place[..., None]) / width) ** 2)
        drawn = (weight * offset).sum(axis=-1) / np.maximum(weight.sum(axis=-1), 1e-9)
        place = place + (1 + window**-2) * (drawn - place)
    return place, rise


def corners(pieces: Sequence[Array]) -> Array:
    """Return where lines through the points of m edges cross, each with the one before it [px], shape (m, 2)."""
    lines = [cv2.fitLine(edge.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.001).ravel() for edge in pieces]
    a, first = np.split(np.array(lines, np.float64), 2, axis=1)
    b, second = np.roll(a, 1, axis=0), np.roll(first, 1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    gap = second - first
    share = (gap[:, 0] * b[:, 1] - gap[:, 1] * b[:, 0]) / np.where(np.abs(cross) < 1e-9, np.nan, cross)
    return first + share[:, None] * a
