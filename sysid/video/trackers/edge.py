"""The straight edges of a bare body: lines that turn about one point.

A line has the normal n and the distance ρ from the origin. It belongs to a body that turns about q if ρ = h + q·n for all turns. There h is the
distance of the edge from q. The line segments of pictures from all over the film vote for h and q; what stands still or
is carried along keeps no such distance. In the mean of the pictures turned back about q, only the body is sharp: its segments are the
edges. From then on they are searched in each frame over turn and shift, and measured to a hundredth of a pixel.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.background import SMALL_SIDE
from sysid.video.film.frames import Frame, box_about, halved
from sysid.video.film.reel import Reel
from sysid.video.film.survey import Survey
from sysid.video.pose.angle import AngleTrack
from sysid.video.pose.camera_state import READOUT, CameraState, spread_by
from sysid.video.pose.prior import ATTITUDE_STEP, BODY_FLOOR, POINT_FLOOR
from sysid.video.pose.rectify import attitude_share, rectify, smear, unwrap
from sysid.video.pose.view import View
from sysid.video.trackers._base import Target, Tracker, level_angle
from sysid.video.trackers._edge_profile import PIECES, find_steps
from sysid.video.types import Complex, Image, Picture, Rows

MAX_TURN = np.radians(45.0)
"""Largest turn that is looked for [rad]: decks and pendulum rods of a free decay stay within it."""


@dataclass(frozen=True, slots=True)
class Edges:
    """Edges of a body when it is level."""

    pivot: complex
    """The point that they turn about in the picture [px]."""
    ends: Complex
    """Ends of each edge from there [px], shape (E, 2); in the order in which brightness rises to the left of the way."""
    shown: float = 0.0
    """Usual change of brightness along the edges [grey levels/px]."""

    def at(self, turn: Array, shift: Complex) -> Complex:
        """Return the ends [px], shape (n, E, 2), at turns [rad] and shifts [px], both of shape (n,)."""
        return self.pivot + shift[:, None, None] + np.exp(1j * turn)[:, None, None] * self.ends


@dataclass(frozen=True, slots=True)
class Small:
    """A picture, halved until it is small."""

    picture: Picture
    """Brightness, shape (h, w)."""
    corner: complex
    """Place of its first pixel in the film, as if the camera had not moved [px]."""
    times: int
    """Pixels of the film in one of it."""

    def lines(self) -> Complex:
        """Return the ends of line segments as `Edges` has them [px], shape (L, 2)."""
        detector: Any = cv2.createLineSegmentDetector()  # its stubs do not know that it may find none
        found = detector.detect(self.picture)[0]
        if found is None:
            return np.zeros((0, 2), complex)
        ends = np.asarray(found, np.float64).reshape(-1, 2, 2) @ [1, 1j]
        return np.asarray(self.corner + self.times * ends, np.complex128)

    def slopes(self) -> tuple[Image, Image]:
        """Return the change of brightness along rows and down columns [grey levels/px], shape (h, w)."""
        smooth = cv2.GaussianBlur(self.picture, (0, 0), 1.0)
        across, down = (cv2.Scharr(smooth, cv2.CV_32F, *axis, scale=1 / 32) for axis in ((1, 0), (0, 1)))
        return np.asarray(across, np.float32), np.asarray(down, np.float32)


def small_of(frame: Frame) -> Small:
    """Return the brightness of a frame, halved until it is small."""
    small, times = halved(frame.picture, SMALL_SIDE)
    return Small(small, complex(*(np.array(frame.corner) + (times - 1) / 2 - frame.shift)), times)


def find_edges(look: Survey) -> Edges | None:
    """Return the edges of the body that turns in some pictures of a film; None without any."""
    every = [small_of(frame.cut(look.box)) for frame in look.frames]
    lines = [one.lines() for one in every]
    picture = np.repeat(np.arange(len(lines)), [len(one) for one in lines])
    best, most = None, 0.0
    for pivot, turns, rows in _common_pivots(np.concatenate(lines), picture, np.reshape(look.box, (2, 2))):
        _, some = np.unique(
            np.round(turns / (2 * ATTITUDE_STEP)), return_index=True
        )  # each attitude counts once
        ends = _edges_in(_turned_back([every[row] for row in rows[some]], pivot, turns[some]))
        seen = len(some) * float(np.abs(ends[:, 1] - ends[:, 0]).sum())
        if seen > most:
            best, most = Edges(pivot, ends - pivot), seen
    if best is None:
        return None
    follower = EdgeFollower(best)
    return replace(best, shown=float(np.median([follower.search(frame)[2] for frame in look.frames])))


def _common_pivots(lines: Complex, picture: Rows, box: Array) -> Iterator[tuple[complex, Array, Rows]]:
    """Yield pivots [px] about which one line in many pictures turns, these turns [rad], shape (m,), and pictures, shape (m,).

    Random sample consensus (Fischler and Bolles, 1981). Each attitude counts once, so that a line that stands still does not win.
    Lines have their ends [px], shape (L, 2), and their pictures' numbers, shape (L,). The pivot lies in the box with these corners [px],
    shape (2, 2), or within its size beside it.
    """
    way = lines[:, 1] - lines[:, 0]
    polarity = np.sign(way.real)
    turn, length = np.angle(way * polarity), np.abs(way)
    design = np.stack([np.ones(len(lines)), -np.sin(turn), np.cos(turn)], axis=1)
    distance = (lines[:, 0] * np.exp(-1j * turn)).imag
    attitude = np.round((turn + MAX_TURN) / (2 * ATTITUDE_STEP)).astype(int)
    low, high = 2 * box[0] - box[1], 2 * box[1] - box[0]
    for seed, side in product(range(4), (1.0, -1.0)):
        rng, best, found = np.random.default_rng(seed), 0.0, None
        own = np.flatnonzero((polarity == side) & (np.abs(turn) < MAX_TURN))
        own = own[np.lexsort((-length[own], picture[own]))]  # a picture shows its longest line that agrees
        for _ in range(400 if len(own) > 4 else 0):
            three = rng.choice(own, 3, replace=False, p=length[own] / length[own].sum())
            if np.ptp(turn[three]) < 4 * ATTITUDE_STEP or abs(np.linalg.det(design[three])) < 1e-6:
                continue
            model = np.linalg.solve(design[three], distance[three])
            if np.any(model[1:] < low) or np.any(model[1:] > high):
                continue
            near = own[np.abs(design[own] @ model - distance[own]) < 3.0]
            near = near[np.unique(picture[near], return_index=True)[1]]
            most = np.zeros(attitude[own].max() + 1)
            np.maximum.at(most, attitude[near], length[near])
            if most.sum() > best:
                best, found = float(most.sum()), near
        if found is not None:
            (_, x, y), *_ = np.linalg.lstsq(design[found], distance[found], rcond=None)
            yield complex(x, y), turn[found], picture[found]


def _turned_back(some: list[Small], pivot: complex, turns: Array) -> Small:
    """Return the mean of pictures, each turned back about a pivot [px] by its turn [rad]: what turns is sharp in it."""
    total = np.zeros(some[0].picture.shape, np.float32)
    for one, turn in zip(some, turns, strict=True):
        to = (pivot - one.corner) / one.times  # where the pivot is, in the first picture and in this one
        at = (pivot - some[0].corner) / one.times
        back = np.exp(1j * turn)
        off = to - back * at
        move = np.array([[back.real, -back.imag, off.real], [back.imag, back.real, off.imag]])
        flags, border = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, cv2.BORDER_REPLICATE
        total += cv2.warpAffine(one.picture, move, total.shape[::-1], flags=flags, borderMode=border)
    return replace(some[0], picture=np.asarray(total / len(some), np.uint8))


def _edges_in(mean: Small) -> Complex:
    """Return the ends of the longest level lines of a picture [px], shape (E, 2); parts of one line are joined."""
    found: list[Complex] = []
    lines = mean.lines()
    for line in lines[np.argsort(-np.abs(lines[:, 1] - lines[:, 0]))]:
        way, middle = line[1] - line[0], line.mean()
        if abs(way.imag) > np.sin(2 * ATTITUDE_STEP) * abs(way):
            continue
        for number, other in enumerate(found):
            if (
                way.real * (other[1] - other[0]).real > 0
                and abs((middle - other.mean()).imag) < 2 * mean.times
            ):
                both = np.concatenate([line, other])
                ends = both[[np.argmin(both.real), np.argmax(both.real)]]
                found[number] = ends if way.real > 0 else ends[::-1]
                break
        else:
            if not found or 2 * abs(way) > abs(found[0][1] - found[0][0]):
                found.append(line)
    return np.array(found, complex).reshape(-1, 2)


@dataclass(slots=True)
class EdgeFollower:
    """Follows the edges: a search over turn and shift in each frame, then the points on them."""

    edges: Edges
    _turn: float = 0.0
    _step: float = 0.0
    _lost: bool = True

    @property
    def points(self) -> int:
        """Number of points."""
        return PIECES * len(self.edges.ends)

    def update(self, frame: Frame) -> Array | None:
        """Return the points of the edges [px], shape (N, 2), NaN where one is not seen; None where most are not."""
        turn, shift, shown = self.search(frame)
        points, self._lost, was_lost = np.zeros((0, 2)), True, self._lost
        if shown < self.edges.shown / 3:
            return None
        for reach in (6.0, 3.0):
            ends = self.edges.at(np.array([turn]), np.array([shift]))[0]
            points = find_steps(frame, np.stack([ends.real, ends.imag], axis=-1), reach, 1.0)
            way = ends[:, 1] - ends[:, 0]
            unit = way * np.sign(way.real) / np.abs(way)
            across = unit.conj()[:, None] * (points @ [1, 1j] - ends.mean(axis=1)[:, None])
            along = across.real + (unit.conj() * (ends.mean(axis=1) - ends.mean())).real[:, None]
            seen = np.isfinite(across)
            if seen.mean() < 0.4:
                return None
            line = np.stack([along[seen], across.imag[seen]], axis=1).astype(np.float32)
            run, rise, x, y = cv2.fitLine(line, cv2.DIST_WELSCH, 0, 0.01, 0.001).ravel().tolist()
            slope, height = rise / run, y - x * rise / run
            if np.mean(np.abs(across.imag - height - slope * along) < 2.0) < 0.4:
                return None
            turn += slope
            shift += 1j * height * np.exp(1j * turn)
        self._step = 0.0 if was_lost else turn - self._turn
        self._turn, self._lost = turn, False
        return points.reshape(-1, 2)

    def search(self, frame: Frame) -> tuple[float, complex, float]:
        """Return the turn [rad] and the shift [px] at which the edges show best, and the change of brightness there."""
        reach, middle = (MAX_TURN, 0.0) if self._lost else (MAX_TURN / 3, self._turn + self._step)
        moved = complex(*frame.shift)
        turns = middle + np.arange(-reach, reach, ATTITUDE_STEP / 2)
        ends = self.edges.at(turns, np.full(len(turns), moved)).ravel()
        small = small_of(frame.cut(box_about(np.stack([ends.real, ends.imag], axis=1), 30)))
        turn, down = (
            one.ravel() for one in np.meshgrid(turns, small.times * np.arange(-6.0, 7.0, 2.0), indexing="ij")
        )
        shift = 1j * down * np.exp(1j * turn)
        ends = self.edges.at(turn, shift)
        way = ends[..., 1] - ends[..., 0]
        place = ends[..., :1] + (np.arange(24) + 0.5) / 24 * way[..., None]
        inside = (place - small.corner) / small.times
        x, y = (part.reshape(len(turn), -1).astype(np.float32) for part in (inside.real, inside.imag))
        across, down = (cv2.remap(one, x, y, cv2.INTER_LINEAR).reshape(place.shape) for one in small.slopes())
        normal = (-1j * way / np.abs(way))[..., None]
        score = np.maximum(across * normal.real + down * normal.imag, 0).mean(axis=(1, 2))
        best = int(np.argmax(score))
        # The median is the score of any line across the picture.
        return float(turn[best]), complex(moved + shift[best]), float(score[best] - np.median(score))


@dataclass(frozen=True, slots=True)
class EdgeFit:
    """How a body turned, by points on its edges."""

    angle: Array
    """Turn [rad], shape (n,), 0 where the edges are level."""
    variance: Array
    """Its variance for the scatter of the points [rad²], shape (n,)."""
    weight: Array
    """Weight of each point, shape (n, M)."""
    rest: Array
    """Distance of each point from where it should be [px], shape (n, M)."""


def fit_edges(z: Complex) -> EdgeFit:
    """Find the turn of a body by points on its edges [px], shape (n, M), NaN where not seen, which keep their height along the edge.

    Edges at other depths turn about other points of the picture, so each has a place of its own in each frame.
    """
    seen = np.isfinite(z)
    place, weight, height = np.where(seen, z, 0), seen.astype(float), np.zeros(z.shape[1])
    # The median slope between any two points of an edge ignores what a part of it has lent (Theil, 1950; Sen, 1968).
    first, second = np.triu_indices(PIECES, 1)
    each = z.reshape(len(z), -1, PIECES)
    slopes = np.angle((each[..., second] - each[..., first]) ** 2).reshape(len(z), -1) / 2
    angle, good = np.zeros(len(z)), np.isfinite(slopes).any(axis=1)
    angle[good] = np.nanmedian(slopes[good], axis=1)
    # Of two parts of an edge that lie side by side, one is believed at first: both have its slope, their mean has another.
    off = (z * np.exp(-1j * angle)[:, None]).imag.reshape(each.shape)
    middle = np.isfinite(off).sum(axis=2, keepdims=True) // 2
    off = np.abs(off - np.take_along_axis(np.sort(off, axis=2), middle, axis=2)).reshape(z.shape)
    weight = np.nan_to_num(1 / (1 + (off / (2 * np.nanmedian(off) + POINT_FLOOR)) ** 2) ** 2)
    along = rest = variance = np.zeros(0)
    # Points on something else lose their weight one by one, as the median distance falls.
    for _ in range(24):
        turned: Complex = np.exp(-1j * angle)[:, None] * place
        turned = turned - _middle(turned, weight)
        share = weight * attitude_share(angle, ATTITUDE_STEP)[:, None] + 1e-12
        height = np.average(
            turned.imag + _middle(np.broadcast_to(height, z.shape), weight), axis=0, weights=share
        )
        off = turned.imag - height
        along, off = turned.real, off - _middle(off, weight)
        lever = np.maximum((weight * along**2).sum(axis=1), 1e-9)
        step = (weight * along * off).sum(axis=1) / lever
        angle = angle + step
        rest = np.where(seen, off - step[:, None] * along, 0.0)
        scale = 1.4826 * float(np.median(np.abs(rest[seen])))
        usual = np.sqrt(
            np.average(np.minimum(np.abs(rest), 3 * scale) ** 2, axis=0, weights=share * seen + 1e-12)
        )
        usual = np.maximum(usual, max(scale, POINT_FLOOR))
        # A point counts by its own scatter, and less where it is off in one frame.
        weight = seen * (usual.min() / usual) ** 2 / (1 + (rest / (2 * usual)) ** 2) ** 2
        noise = (weight * rest**2).sum(axis=1) / np.maximum(weight.sum(axis=1) - 2, 1.0)
        variance = np.maximum(noise, POINT_FLOOR**2) / np.maximum((weight * along**2).sum(axis=1), 1e-9)
    # Neighbours err alike, as the wall behind them and compression have it: fewer independent points.
    pieces = (np.sqrt(weight) * rest).reshape(len(z), -1, PIECES)
    alike = float(
        np.clip((pieces[..., 1:] * pieces[..., :-1]).sum() / max((pieces**2).sum(), 1e-9), 0.0, 0.9)
    )
    count = weight.sum(axis=1) / np.maximum((weight * along**2).sum(axis=1), 1e-9)
    variance = variance * (1 + alike) / (1 - alike) + BODY_FLOOR**2 * count / pieces.shape[1]
    # One slope for all edges, each with a height of its own.
    total = weight.sum(axis=0)[None] + 1e-9
    along = np.average(along, axis=0, weights=weight + 1e-9)[None]
    along, height = along - _middle(along, total), height - _middle(height[None], total)
    level = np.arctan((total * along * height).sum() / (total * along**2).sum())
    return EdgeFit(angle + level, variance, weight, rest)


def _middle(values: Any, weight: Array) -> Any:
    """Return the mean of the points of each edge, for each point, both of shape (n, M)."""
    edges = len(values), -1, PIECES
    total = (weight * values).reshape(edges).sum(axis=2) / np.maximum(weight.reshape(edges).sum(axis=2), 1e-9)
    return np.repeat(total, PIECES, axis=1)


def fit_turn(view: View, matrix: Array, before: CameraState) -> AngleTrack:
    """Return the turn of the edges as a camera along the axis sees it.

    Lines across the axis show neither its direction nor focal length nor read-out: these stay as they are known beforehand. The
    camera matrix [px] has shape (3, 3).
    """

    def fit_at(x: Array) -> EdgeFit:
        return fit_edges(rectify(view.points + x[READOUT] * view.shear, matrix, x))

    fit = fit_at(before.value)
    unknown = spread_by(
        before.value, before.covariance, fit.angle, lambda x: fit_at(x).angle, view.time(before.readout), view.share, READOUT
    )  # fmt: skip
    trusted = fit.weight.sum(axis=1)
    wrong = trusted < 0.4 * float(np.median(trusted))
    angle = np.where(wrong, np.nan, fit.angle)
    own = np.sqrt(np.where(wrong, np.nan, fit.variance + smear(angle) ** 2))
    noise = float(np.sqrt(np.average(fit.rest**2, weights=fit.weight)))
    lost = int((wrong & np.isfinite(view.points).any(axis=(1, 2))).sum())
    return AngleTrack(
        unwrap(angle), np.hypot(own, np.sqrt(unknown)), before, noise, lost, np.array([1 + 0j]), own
    )


def _find(reel: Reel) -> Target | None:
    edges = find_edges(reel.look)
    if edges is None:
        return None
    count = len(edges.ends)
    lengths = ", ".join(f"{length:.0f}" for length in np.abs(edges.ends[:, 1] - edges.ends[:, 0]))
    unseen = (
        "an edge does not show from where the camera looks: it is taken to look along the board's axis to within 5 degrees "
        "(--camera-angle)"
    )
    return Target(
        follower=EdgeFollower(edges),
        what="the deck's edge",
        why=f"{count} straight edge{'s' if count > 1 else ''} ({lengths} px long)",
        solve=fit_turn,
        zero=partial(level_angle, direction=1 + 0j, symmetry=2),
        zero_note="where the edge is level in the picture",
        joined=tuple((point, point + 1) for point in range(PIECES * count) if (point + 1) % PIECES),
        direction_from="",
        shows_body=False,
        warnings=(unseen,) if reel.options.camera_angle is None else (),
    )


TRACKER = Tracker(
    rank=3,
    last_resort=True,
    find=_find,
    not_found="no straight edge that turns is seen{where}. Give its region with --roi LEFT TOP WIDTH HEIGHT, or put two stickers on it",
)
