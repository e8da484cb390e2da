"""Straight edges to a hundredth of a pixel: points where brightness steps across them, and lines through these."""

from collections.abc import Sequence

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.frames import Frame

PIECES = 16
"""Points along an edge that are told apart."""
PROFILES = 4
"""Profiles that make one of them."""


def find_pieces(frame: Frame, ends: Array, reach: float, faintest: float) -> Array:
    """Move points evenly along edges onto the brightness steps nearby that rise across them.

    Args:
        frame: A frame.
        ends: Where the edges roughly are [px], shape (m, 2, 2); brightness is to rise along the normal (dy, -dx) of
            the way from first to second end.
        reach: How far they may be off, to either side [px].
        faintest: Step of brightness that a point takes [grey levels].

    Returns:
        Shape (m, PIECES, 2) [px]; NaN where there is no such step.
    """
    share = (np.arange(PIECES * PROFILES)[:, None] + 0.5) / (PIECES * PROFILES)
    along = ends[:, None, 1] - ends[:, None, 0]
    feet = ends[:, None, 0] + share * along
    normal = along[..., ::-1] * [1, -1] / np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-9)
    offset = np.arange(-np.ceil(reach) - 1, np.ceil(reach) + 2)
    samples = feet[:, :, None] - frame.corner + offset[:, None] * normal[:, :, None]
    x, y = np.moveaxis(samples.astype(np.float32).reshape(-1, len(offset), 2), 2, 0)
    seen = cv2.remap(frame.picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    profile = seen.astype(np.float64).reshape(len(ends), PIECES, PROFILES, -1).mean(axis=2)
    step, offset = np.diff(profile, axis=2), offset[:-1] + 0.5
    place, rise = _centroid(step, offset)
    place = np.where((rise < faintest) | (np.abs(place) > reach), np.nan, place)
    return feet.reshape(len(ends), PIECES, PROFILES, 2).mean(axis=2) + place[..., None] * normal


def _centroid(step: Array, offset: Array) -> tuple[Array, Array]:
    """Centroid of the positive steps around the strongest one [px], and their sum, each (m, count).

    For any symmetric blur, motion blur included, that is the true edge.
    """
    smooth = step.copy()
    smooth[..., 1:-1] = (step[..., :-2] + 2 * step[..., 1:-1] + step[..., 2:]) / 4
    peak = offset[np.argmax(smooth, axis=2)]
    top = smooth.max(axis=2)
    weight = np.maximum(step - 0.1 * top[..., None], 0)
    centre = peak
    for half_width in (4.0, 4.0):
        near = weight * (np.abs(offset - centre[..., None]) <= half_width)
        total = near.sum(axis=2)
        centre = np.where(total > 0, (near * offset).sum(axis=2) / np.maximum(total, 1e-9), np.nan)
    return centre, total


def corners(pieces: Sequence[Array]) -> Array:
    """Return where lines through the points of m edges cross, each with the one before it [px], shape (m, 2)."""
    lines = [cv2.fitLine(edge.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.001).ravel() for edge in pieces]
    a, first = np.split(np.array(lines, np.float64), 2, axis=1)
    b, second = np.roll(a, 1, axis=0), np.roll(first, 1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    gap = second - first
    share = (gap[:, 0] * b[:, 1] - gap[:, 1] * b[:, 0]) / np.where(np.abs(cross) < 1e-9, np.nan, cross)
    return first + share[:, None] * a
