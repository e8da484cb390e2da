"""Straight edges to a hundredth of a pixel: brightness profiles across them, and a robust line."""

from dataclasses import dataclass

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.frames import Frame
from sysid.video.types import Picture

PIECES = 16
"""Points along an edge that are told apart."""
PROFILES = 4
"""Profiles that make one of them."""


@dataclass(frozen=True, slots=True)
class Edges:
    """Lines through m edges in one picture."""

    ends: Array
    """The given ends of each edge, moved onto it [px], shape (m, 2, 2)."""
    contrast: Array
    """Brightness step along the edge's normal, median over its profiles [grey levels], shape (m,)."""
    scatter: Array
    """Standard deviation of the profiles' edge positions about the line [px], shape (m,)."""
    used: Array
    """Share of the profiles that support the line, shape (m,)."""


def find_edges(picture: Picture, ends: Array, reach: float, *, count: int = 24) -> Edges:
    """Move edges onto the brightness steps nearby.

    Each profile's position is the centroid of its gradient where it has the wanted sign (dark on the
    right when walking from the first end to the second is a positive step to the left): for any
    symmetric blur, motion blur included, that is the true edge.

    Args:
        picture: Grey picture.
        ends: Where the edges roughly are [px], shape (m, 2, 2); brightness grows along the normal
            (dy, -dx) of the direction from first to second end.
        reach: How far the edges may be off, to either side [px].
        count: Profiles an edge.
    """
    share = np.linspace(0.1, 0.9, count)
    normal, profile, offset = _profiles(picture, ends, share, reach)
    position, contrast = _centroid(np.diff(profile, axis=2), offset)
    return _lines(ends, normal, share, position, contrast)


def find_pieces(frame: Frame, ends: Array, reach: float, faintest: float) -> Array:
    """Move points evenly along edges onto the brightness steps nearby, up or down, each as it finds it.

    Args:
        frame: A frame in grey.
        ends: Where the edges roughly are [px], shape (m, 2, 2).
        reach: How far they may be off, to either side [px].
        faintest: Step of brightness that a point takes [grey levels].

    Returns:
        Shape (m, PIECES, 2) [px]; NaN where there is no such step.
    """
    share = (np.arange(PIECES * PROFILES) + 0.5) / (PIECES * PROFILES)
    normal, profile, offset = _profiles(frame.picture, ends - frame.corner, share, reach)
    step = np.diff(profile.reshape(len(ends), PIECES, PROFILES, -1).mean(axis=2), axis=2)
    (up, rise), (down, fall) = _centroid(step, offset), _centroid(-step, offset)
    place = np.where(np.maximum(rise, fall) < faintest, np.nan, np.where(rise > fall, up, down))
    place = np.where(np.abs(place) <= reach, place, np.nan)
    share = share.reshape(PIECES, PROFILES).mean(axis=1)
    feet = ends[:, None, 0] + share[None, :, None] * (ends[:, None, 1] - ends[:, None, 0])
    return feet + place[..., None] * normal[:, None]


def _profiles(picture: Picture, ends: Array, share: Array, reach: float) -> tuple[Array, Array, Array]:
    """Brightness across edges (m, 2, 2).

    Returns:
        Their normals, shape (m, 2); the brightness at some shares along them, shape (m, count, k + 1); and
        how far along the normal the middles between its samples are [px], shape (k,).
    """
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = along / np.maximum(length, 1e-9)
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1)
    offset = np.arange(-np.ceil(reach) - 1, np.ceil(reach) + 2)
    feet = ends[:, None, 0] + share[None, :, None] * (ends[:, None, 1] - ends[:, None, 0])
    samples = (feet[:, :, None] + offset[None, None, :, None] * normal[:, None, None]).astype(np.float32)
    m, count = len(ends), len(share)
    profile = cv2.remap(
        picture,
        samples[..., 0].reshape(m * count, -1),
        samples[..., 1].reshape(m * count, -1),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    ).reshape(m, count, -1)
    return normal, profile.astype(np.float64), offset[:-1] + 0.5


def _centroid(step: Array, offset: Array) -> tuple[Array, Array]:
    """Centroid of the positive steps around the strongest one [px], and their sum, each (m, count)."""
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


def _lines(ends: Array, normal: Array, share: Array, position: Array, contrast: Array) -> Edges:
    """Fit offset = a + b·share to every edge's profiles by reweighted least squares (Cauchy weights)."""
    strong = _middle(contrast)
    base = np.isfinite(position) & (contrast > 0.4 * strong[:, None])
    place = np.where(base, position, 0.0)
    weight = base / (1 + ((place - _middle(place)[:, None]) / 3.0) ** 2)
    centred = share - 0.5
    powers = np.array([np.ones(len(share)), centred, centred**2]).T
    intercept = slope = np.zeros(len(ends))
    spread = np.full(len(ends), np.inf)
    square = place
    for _ in range(3):
        zeroth, first, second = (weight @ powers).T
        mean, moment = ((weight * place) @ powers[:, :2]).T
        determinant = np.maximum(zeroth * second - first**2, 1e-12)
        intercept = (mean * second - moment * first) / determinant
        slope = (moment * zeroth - mean * first) / determinant
        square = (place - intercept[:, None] - slope[:, None] * centred) ** 2
        spread = np.sqrt((weight * square).sum(axis=1) / np.maximum(zeroth, 1e-9)) + 0.02
        weight = base / (1 + square / (6.25 * spread[:, None] ** 2))
    moved = np.array([intercept - slope / 2, intercept + slope / 2]).T[..., None] * normal[:, None]
    supported = base & (square < np.maximum(3 * spread[:, None], 0.5) ** 2)
    return Edges(ends + moved, strong, spread, supported.mean(axis=1))


def _middle(values: Array) -> Array:
    """Median along the second axis; numpy's own takes ten times as long for a few numbers."""
    return np.sort(values, axis=1)[:, values.shape[1] // 2]


def corners(edges: Edges) -> Array:
    """Intersect each edge with the one before it in the cycle [px], shape (m, 2)."""
    first, second = edges.ends, np.roll(edges.ends, 1, axis=0)
    a, b = first[:, 1] - first[:, 0], second[:, 1] - second[:, 0]
    gap = second[:, 0] - first[:, 0]
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    share = (gap[:, 0] * b[:, 1] - gap[:, 1] * b[:, 0]) / np.where(np.abs(cross) < 1e-9, np.nan, cross)
    return first[:, 0] + share[:, None] * a
