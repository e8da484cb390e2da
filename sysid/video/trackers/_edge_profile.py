"""Straight edges to a hundredth of a pixel: points where brightness steps across them, and lines through these."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.frames import Frame
from sysid.video.pose.prior import SAME_PICTURE

PIECES = 16
"""Points along an edge that are told apart."""
MIN_WIDTH = 0.5
"""Least standard deviation of a step of brightness: no lens is sharper than its pixels [px]."""
MIN_APART, HALO = 2.0, 0.3
"""Distance of a step that rises and one that falls below which neither shows where it is [px], and how much of the stronger one the other
must be: where it is less it is the halo by which cameras sharpen an edge."""
ROUNDS = 3
"""Times that a step is looked for about where it was found."""
ALL_OF_A_STEP = 2.0
"""Window that takes in next to all of a step, in widths of it [1]: straight lines between pixels keep that step's sum, and so its place.
They skew a step by a wave of its place in the grid, which a narrower window shows: it takes cubics."""
DISTURBED, DISTURBED_SHARE = 3.0, 0.3
"""Error of the brightness at a step [grey levels]: what compression and the pixels' grid leave, and this share of how much brightness changes
beside the step. Over its height, in grey levels a pixel, it is an error of place. In 26 films 2 to 4 grey levels do as well."""
STEP_SIDE, BESIDE = 2.0, 1.6
"""How far a step reaches to either side, and from where on other changes of brightness are counted [px]."""
HARMONICS = np.array([1, 2])
"""Waves a pixel by which its grid moves a step."""
USUAL_ALIASING, USUAL_BEND = 0.05, 0.02
"""Standard deviations of what the pixels' grid does to the place of a step, and of what else bends an edge [px]."""


def beside_line(bends: Array, share: Array) -> Array:
    """Return how far beside the line between their ends edges are at some shares of their length, shape (m, p) [px].

    Args:
        bends: The same at the middle of each piece [px], shape (m, PIECES).
        share: From the left end on [1], shape (p,).
    """
    middles = (np.arange(PIECES) + 0.5) / PIECES
    return np.array([np.interp(share, middles, one) for one in bends])


def find_steps(
    frame: Frame,
    ends: Array,
    reach: float,
    faintest: float,
    window: float,
    ways: tuple[int, ...] = (1,),
    bends: Array | None = None,
) -> tuple[Array, Array]:
    """Move points evenly along edges onto the brightness steps nearby that rise across them.

    Args:
        frame: A frame.
        ends: Where the edges roughly are [px], shape (m, 2, 2); brightness is to rise along the normal (dy, -dx) of
            the way from first to second end.
        reach: How far they may be off, to either side [px].
        faintest: Step of brightness that a point takes [grey levels].
        window: Width of what tells where a step is, in widths of the step: 1 is best against noise, more where contrast leaves that
            small beside what the pixels' grid does to an edge along it.
        ways: 1 for steps that rise, -1 for those that fall.
        bends: How far beside the line between the ends each piece is, against the normal [px], shape (m, PIECES).

    Returns:
        Points, shape (ways, m, PIECES, 2) [px], NaN where there is no such step; and how far each may be off since brightness changes beside
        the step, too, shape (ways, m, PIECES) [px].
    """
    along = ends[:, None, 1] - ends[:, None, 0]
    length = np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-9)
    profiles = int(np.ceil(length.max() / PIECES))  # one each px: every pixel tells
    share = (np.arange(PIECES * profiles)[:, None] + 0.5) / (PIECES * profiles)
    feet = ends[:, None, 0] + share * along
    normal = along[..., ::-1] * [1, -1] / length
    if bends is not None:
        feet = feet - beside_line(bends, share[:, 0])[..., None] * normal
    offset = np.arange(-np.ceil(reach) - 1, np.ceil(reach) + 2)
    # One coordinate after the other: that takes a quarter of the time.
    start, away = (feet - frame.corner)[..., None], normal[..., None] * offset
    x, y = (np.float32(start[:, :, at] + away[:, :, at]).reshape(-1, len(offset)) for at in (0, 1))
    between = cv2.INTER_LINEAR if window >= ALL_OF_A_STEP else cv2.INTER_CUBIC
    seen = cv2.remap(frame.picture, x, y, between, borderMode=cv2.BORDER_REPLICATE)
    each = np.asarray(seen, np.float32).reshape(len(ends), PIECES, profiles, -1)
    profile = (np.ones(profiles, np.float32) @ each).astype(np.float64) / profiles
    step, offset = np.array(ways)[:, None, None, None] * np.diff(profile, axis=2), offset[:-1] + 0.5
    place, rise = _steepest(step, offset, window)
    faint = (rise < faintest) | (np.abs(place) > reach)
    if len(ways) > 1:
        blended = np.ptp(np.where(faint, np.nan, place), axis=0) < MIN_APART
        faint |= blended & (HALO * rise < rise.min(axis=0))
    doubt = _disturbance(step, np.abs(offset - place[..., None]))
    place = np.where(faint, np.nan, place)
    return feet.reshape(len(ends), PIECES, profiles, 2).mean(axis=2) + place[..., None] * normal, doubt


def _disturbance(step: Array, away: Array) -> Array:
    """How far steps may be found beside where they are, by what else changes near them [px], shape (..., m, count).

    Args:
        step: Changes of brightness from sample to sample [grey levels], shape (..., m, count, S).
        away: How far these are from where the step is found [px], of the same shape.
    """
    height = (step * (away <= STEP_SIDE)).sum(axis=-1)
    beside = (np.abs(step) * (away > BESIDE)).sum(axis=-1)
    return np.hypot(DISTURBED, DISTURBED_SHARE * beside) / np.maximum(height, 1.0)


def _steepest(step: Array, offset: Array, window: float) -> tuple[Array, Array]:
    """Where brightness rises most [px], and by how much, each of the shape of steps (..., m, count, S) without its last axis.

    That is the centroid of the steps under a window about it: for any symmetric blur the true edge, and, if it is as wide as they
    are, what a step of that width fits best in white noise. One that takes in all of the step takes in much more of it. A window beside
    the step draws the centroid there by its share, which is known: each round goes as much farther.
    """
    smooth = step.copy()
    smooth[..., 1:-1] = (step[..., :-2] + 2 * step[..., 1:-1] + step[..., 2:]) / 4
    place, top = offset[np.argmax(smooth, axis=-1)], smooth.max(axis=-1)
    near = np.abs(offset - place[..., None]) <= 4
    rise = (np.maximum(step - 0.1 * top[..., None], 0) * near).sum(axis=-1)
    # One width for all of an edge: that of a normal distribution as high.
    usual = np.sort(rise / np.maximum(top, 1e-9), axis=-1)[..., PIECES // 2 - 1 : PIECES // 2 + 1]
    width = window * usual.mean(axis=-1, keepdims=True) / np.sqrt(2 * np.pi)
    rising, sharp = np.maximum(step, 0), -0.5 / np.maximum(width, MIN_WIDTH)[..., None] ** 2
    for _ in range(ROUNDS):
        weight = rising * np.exp(sharp * (offset - place[..., None]) ** 2)
        drawn = weight @ offset / np.maximum(weight.sum(axis=-1), 1e-9)
        place = place + (1 + window**-2) * (drawn - place)
    return place, rise


@dataclass(slots=True)
class Aliasing:
    """What the pixels' grid does to the place of an edge, learned from edges that ought to be straight.

    Pixels gather light, and a camera holds that through a tone curve and sharpens it. Samples one pixel apart are too few for such a step:
    the centroid errs by waves of its place in the grid, one and two a pixel. All points of an edge that is nearly level err alike, so that it
    seems to turn as it moves; one at a slant bows by the same waves, which shows how large they are in this film, whatever the curve.
    """

    _gram: Array = field(default_factory=lambda: np.diag([*[USUAL_ALIASING**-2.0] * 2 * len(HARMONICS), 0.0]))
    """Products of the waves' cosines, sines and the distance from a straight line [px], weighed by the latter's scatter, shape (5, 5)."""
    _learned_at: Array = field(default_factory=lambda: np.array(np.inf))
    """Where the edges were that it was last learned from [px]."""

    def learn(self, pieces: Array, ends: Array) -> None:
        """Take in points along m edges [px], shape (m, PIECES, 2), and these edges' ends; a picture that stays the same tells nothing new."""
        if np.abs(ends - self._learned_at).max() < SAME_PICTURE:
            return
        self._learned_at = ends
        normal, waves = _grid_waves(pieces, ends)
        for columns in np.concatenate([waves, pieces @ normal[..., None]], axis=-1):
            seen = np.isfinite(columns).all(axis=1)
            line = np.linalg.qr(np.vander(np.arange(len(seen)), 2)[seen])[0]
            bent = columns[seen] - line @ (line.T @ columns[seen])
            self._gram += bent.T @ bent / (np.mean(bent[:, -1] ** 2) + USUAL_BEND**2)

    def taken_from(self, pieces: Array, ends: Array) -> Array:
        """Return the points where they would be without it, shape (m, PIECES, 2) [px]."""
        normal, waves = _grid_waves(pieces, ends)
        amount = np.linalg.solve(self._gram[:-1, :-1], self._gram[:-1, -1:])
        return pieces - waves @ amount * normal[:, None]


def _grid_waves(pieces: Array, ends: Array) -> tuple[Array, Array]:
    """Return unit vectors along which brightness rises, shape (m, 2), and cosines and sines of the place in the grid, shape (m, PIECES, 4)."""
    along = ends[:, 1] - ends[:, 0]
    normal = along[:, ::-1] * [1, -1] / np.linalg.norm(along, axis=1, keepdims=True)
    across = np.eye(2)[np.argmax(np.abs(normal), axis=1)] * np.sign(normal)  # rows or columns of pixels
    place, rise = pieces @ across[..., None], (along * across).sum(axis=1)[:, None, None] / PIECES
    waves = np.exp(2j * np.pi * place * HARMONICS) * np.sinc(rise * HARMONICS)  # a piece's mean
    return normal, np.concatenate([waves.real, waves.imag], axis=-1)


def corners(pieces: Sequence[Array]) -> Array:
    """Return where lines through the points of m edges cross, each with the one before it [px], shape (m, 2)."""
    lines = [cv2.fitLine(edge.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.001).ravel() for edge in pieces]
    a, first = np.split(np.array(lines, np.float64), 2, axis=1)
    b, second = np.roll(a, 1, axis=0), np.roll(first, 1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    gap = second - first
    share = (gap[:, 0] * b[:, 1] - gap[:, 1] * b[:, 0]) / np.where(np.abs(cross) < 1e-9, np.nan, cross)
    return first + share[:, None] * a
