"""The deck's own straight edge, where there is neither mark nor texture."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from sysid.roll import Array
from sysid.video.frames import Frame, Picture, crop, grey
from sysid.video.rectify import longer, rectify, smear, unwrap
from sysid.video.straight_edge import find_edges
from sysid.video.survey import Survey
from sysid.video.turning import Turning
from sysid.video.unknowns import Unknowns, spread_by
from sysid.video.view import View

SHORTEST = 40
"""Shortest edge that is followed [px]."""
STEEPEST = np.radians(50)
"""An edge steeper than this is not across the deck."""
TURNS = np.radians(np.arange(-20, 20.5, 1.0))
"""Turns from the expected one that are searched."""
GAP = 2.0
"""Distance from a line at which brightness is read on its two sides [px]."""
SHAKEN = 5
"""Shift of the picture up to which a still edge is known again [px]."""
ELSEWHERE = 6.0
"""Distance from where the axis puts it that makes a line another one, in standard deviations (and 1 px)."""
CORRELATION = 6.0
"""Length along an edge over which errors are alike: compression works in blocks of 8 or 16 pixels."""


def find_edge(look: Survey) -> Array | None:
    """Return both ends [px] of the longest edge that moves, shape (2, 2), the brighter side above it."""
    dark = grey(look.first.picture)
    part, corner = crop(dark, look.box)
    segments: Any = cv2.createLineSegmentDetector().detect(cv2.GaussianBlur(part, (0, 0), 1.0))[0]
    best: tuple[float, Array] | None = None
    for segment in [] if segments is None else np.asarray(segments, np.float64).reshape(-1, 2, 2):
        ends = segment + corner
        along = ends[1] - ends[0]
        length = float(np.hypot(*along))
        slope = abs(np.arctan2(along[1], along[0]))
        if length < SHORTEST or min(slope, np.pi - slope) > STEEPEST:
            continue
        share = np.linspace(0.1, 0.9, 30)[:, None]
        places = np.round(ends[0] + share * along).astype(int)
        inside = np.clip(places, 0, np.array(dark.shape[1::-1]) - 1)
        moving = float(look.moving[inside[:, 1], inside[:, 0]].mean())
        contrast = _step(dark, ends[None])[0]
        if contrast < 0:
            ends = ends[::-1]
        here = [_still_there(other, ends) for other in look.pictures]
        changed = float(np.mean([abs(contrast) - there > 0.4 * abs(contrast) for there in here]))
        if moving < 0.35 or changed < 0.35:
            continue
        score = length * min(abs(contrast), 60.0) * changed**2
        if best is None or score > best[0]:
            best = score, ends
    if best is None:
        return None
    ends = best[1]
    middle = ends.mean(axis=0)
    return middle + 0.8 * (ends - middle)


@dataclass(slots=True)
class EdgeTracker:
    """Follows one straight edge: a search over turns and shifts, then the brightness profile across it.

    A line shows where it is across itself only, so the ends would slide along the edge. They are carried
    by a turn about a pivot instead, which is learned on the way: for a line n·x = c turning about p,
    c = n·p + h in every frame.
    """

    start: Array
    """Both ends in the first frame [px], shape (2, 2)."""
    box: tuple[int, int, int, int]
    deviations: list[float] = field(default_factory=list)
    """Standard deviation of the edge's direction in each frame [rad]; NaN where it is not seen."""
    _turn: float = 0.0
    _rate: float = 0.0
    _time: float | None = None
    _sides: Array | None = None
    _contrast: float = 0.0
    _information: Array = field(init=False)
    _moment: Array = field(init=False)

    def __post_init__(self) -> None:
        """Expect the pivot in the middle of what moves, to within half of its size."""
        left, top, right, bottom = self.box
        middle = np.array([(left + right) / 2, (top + bottom) / 2])
        spread = max(right - left, bottom - top) / 4
        height = self._normal(0.0) @ (self.start[0] - middle)
        self._information = np.diag([1, 1, 1]) / spread**2
        self._moment = self._information @ np.append(middle, height)

    @property
    def points(self) -> int:
        """Both ends; only the line through them means anything."""
        return 2

    def update(self, frame: Frame) -> Array | None:
        """Return both ends of the edge [px], shape (2, 2), or None where it is not seen."""
        interval = 0.0 if self._time is None else frame.time - self._time
        dark = grey(frame.picture)
        rough = self.start if self._time is None else self._search(dark, self._turn + self._rate * interval)
        ends = self._fit(dark, rough)
        if ends is None:
            self._rate = 0.0
            self.deviations.append(np.nan)
            return None
        along, before = ends[1] - ends[0], self.start[1] - self.start[0]
        turn = float(np.angle(complex(*along) / complex(*before)))
        self._rate = (turn - self._turn) / interval if interval > 0 else 0.0
        self._turn, self._time = turn, frame.time
        row = np.append(self._normal(turn), 1.0)
        self._information += np.outer(row, row) / 2.0**2
        self._moment += row * (self._normal(turn) @ ends[0]) / 2.0**2
        return ends

    def _normal(self, turn: float) -> Array:
        along = (self.start[1] - self.start[0]) / np.linalg.norm(self.start[1] - self.start[0])
        return _rotation(turn) @ np.array([along[1], -along[0]])

    def _search(self, dark: Picture, expected: float) -> Array:
        """Best place of the edge about the expected turn: bright and dark sides as they were before."""
        covariance = np.linalg.inv(self._information)
        pivot = (covariance @ self._moment)[:2]
        height = (covariance @ self._moment)[2]
        ends: list[Array] = []
        penalty: list[Array] = []
        for turn in expected + TURNS:
            normal = self._normal(turn)
            row = np.append(normal, 1.0)
            reach = min(3.0 * float(np.sqrt(row @ covariance @ row)) + 6.0, 40.0)
            shifts = np.arange(-reach, reach + 0.5, 1.5)
            turned = pivot + (self.start - pivot) @ _rotation(turn).T
            turned = turned + (normal @ pivot + height - normal @ turned[0]) * normal
            ends.append(turned + shifts[:, None, None] * normal)
            penalty.append(0.25 * (shifts / reach) ** 2 + 0.25 * ((turn - expected) / TURNS[-1]) ** 2)
        places = np.concatenate(ends)
        sides = _sides(dark, places)
        assert self._sides is not None
        alike = np.min(np.abs(sides - self._sides), axis=1)
        step = sides[:, 0] - sides[:, 1]
        return places[int(np.argmax(step - 1.5 * alike - self._contrast * np.concatenate(penalty)))]

    def _fit(self, dark: Picture, ends: Array) -> Array | None:
        edges = None
        for reach in (4.0, 3.0):
            edges = find_edges(dark, ends[None], reach, count=40)
            ends = edges.ends[0]
        assert edges is not None
        contrast, used, scatter = float(edges.contrast[0]), float(edges.used[0]), float(edges.scatter[0])
        first = self._sides is None
        if not np.isfinite(ends).all() or used < 0.4 or contrast < max(8.0, 0.35 * self._contrast):
            return None
        sides = _sides(dark, ends[None])[0]
        self._contrast = contrast if first else 0.95 * self._contrast + 0.05 * contrast
        self._sides = sides if self._sides is None else 0.95 * self._sides + 0.05 * sides
        length = float(np.linalg.norm(ends[1] - ends[0]))
        independent = max(used * 0.8 * length / CORRELATION, 3.0)
        self.deviations.append(float(np.hypot(scatter, 0.05) * np.sqrt(12 / independent) / (0.8 * length)))
        return ends


def fit_direction(view: View, matrix: Array, before: Unknowns, *, deviations: Sequence[float]) -> Turning:
    """Direction of an edge as seen along the axis.

    One line shows neither direction of the axis nor focal length nor read-out: they stay as they are
    known beforehand.

    Args:
        view: Both ends of the edge.
        matrix: Camera matrix [px], shape (3, 3).
        before: What is known of camera and lens.
        deviations: Standard deviation of each direction [rad], shape (n,).
    """

    def angle_at(value: Array) -> Array:
        z = rectify(view.all_points(value[3]), longer(matrix, value[2]), value[0], value[1])
        return np.angle(z[:, 1] - z[:, 0])

    wrong = _elsewhere(view.all_points(before.readout))
    angle = np.where(wrong, np.nan, angle_at(before.value))
    unknown = spread_by(before, angle, angle_at, view.share, view.time(before.readout))
    std = np.sqrt(np.asarray(deviations) ** 2 + smear(angle) ** 2 + unknown)
    std = np.where(np.isfinite(angle), std, np.nan)
    return Turning(
        unwrap(angle), std, before, float(np.nanmedian(deviations)), int(wrong.sum()), np.array([1 + 0j])
    )


def _elsewhere(points: Array) -> npt.NDArray[np.bool_]:
    """Frames in which another line was taken for the edge, which keeps its distance from the axis.

    For lines n·x = c that turn about p at the distance h, c = n·p + h; p and h by reweighted least squares.
    """
    along = points[:, 1] - points[:, 0]
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    place = np.sum(normal * points.mean(axis=1), axis=1)
    seen = np.isfinite(place)
    design = np.column_stack([normal, np.ones(len(normal))])[seen]
    weight = np.ones(len(design))
    off, limit = np.zeros(len(design)), np.inf
    for _ in range(10):
        root = np.sqrt(weight)[:, None]
        # A hair of damping: a deck that hardly turns does not show its axis.
        square = (design * root).T @ (design * root) + 1e-6 * np.eye(3)
        off = place[seen] - design @ np.linalg.solve(square, (design * root**2).T @ place[seen])
        spread = 1.4826 * float(np.median(np.abs(off))) + 0.1
        limit = ELSEWHERE * spread + 1.0
        weight = 1 / (1 + (off / (2 * spread)) ** 2) ** 2
    wrong = np.zeros(len(place), bool)
    wrong[seen] = np.abs(off) > limit
    return wrong


def _step(picture: Picture, ends: Array) -> Array:
    """Brightness above less below each line of `ends` (m, 2, 2) [grey levels], shape (m,)."""
    sides = _sides(picture, ends)
    return sides[:, 0] - sides[:, 1]


def _still_there(picture: Picture, ends: Array) -> float:
    """Largest contrast along the same line in another picture, within what a shaking camera moves it."""
    along = ends[1] - ends[0]
    normal = np.array([along[1], -along[0]]) / np.linalg.norm(along)
    shifts = np.arange(-SHAKEN, SHAKEN + 0.5)
    # Here the mean: a median jumps where the line crosses another edge in its middle.
    sides = _sides(picture, ends + shifts[:, None, None] * normal, middle=np.mean)
    return float(np.abs(sides[:, 0] - sides[:, 1]).max())


def _sides(picture: Picture, ends: Array, middle: Callable[..., Array] = np.median) -> Array:
    """Brightness on both sides of each line of `ends` (m, 2, 2) [grey levels], shape (m, 2)."""
    along = ends[:, 1] - ends[:, 0]
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    share = np.linspace(0.08, 0.92, 36)[None, :, None]
    line = ends[:, None, 0] + share * along[:, None]
    places = [(line + side * GAP * normal[:, None]).astype(np.float32) for side in (1, -1)]
    seen = [
        cv2.remap(picture, place[..., 0], place[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for place in places
    ]
    # The median along the line, so that something in front of a part of it does no harm.
    return np.stack([middle(side.astype(np.float64), axis=1) for side in seen], axis=1)


def _rotation(turn: float) -> Array:
    return np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
