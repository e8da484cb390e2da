"""The straight edges of a bare body: lines that turn about one point.

A line has the normal n and the distance ρ from the origin. It belongs to a body that turns about q if ρ = h + q·n for all turns, with the
distance h of the edge from q. The lines of pictures from all over the film vote for h and q; what stands still or
is carried along keeps no such distance. From then on the body's edges are searched in each frame over turn and shift, and
measured to a hundredth of a pixel.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.background import SMALL_SIDE
from sysid.video.film.frames import Frame, halved
from sysid.video.film.reel import Reel
from sysid.video.film.survey import Survey
from sysid.video.pose.angle import AngleTrack
from sysid.video.pose.camera_state import READOUT, CameraState, rate_of, spread_by
from sysid.video.pose.pose import attitude_share
from sysid.video.pose.prior import BODY_FLOOR, POINT_FLOOR
from sysid.video.pose.rectify import rectify, smear, unwrap
from sysid.video.pose.view import View
from sysid.video.trackers._base import Target, Tracker, level_angle
from sysid.video.trackers._edge_profile import PIECES, find_steps
from sysid.video.types import Box, Complex, Image, Rows

MAX_TURN = np.radians(45.0)
"""Largest turn that is looked for [rad]: decks and pendulum rods of a free decay stay within it."""
TURN_BIN = np.radians(1.0)
"""Turns that are told apart when lines are looked for [rad]."""
LINES = 4
"""Lines that one picture may vote for, of each polarity; and edges that are followed at most."""


@dataclass(frozen=True, slots=True)
class Edges:
    """Edges of a body when it is level."""

    pivot: Array
    """The point that they turn about in the picture [px], shape (2,)."""
    ends: Array
    """Ends of each edge from there [px], shape (E, 2, 2); in the order in which brightness rises to the left of the way."""
    shown: float = 0.0
    """Usual change of brightness along the edges [grey levels/px]."""

    @property
    def length(self) -> float:
        """Length of all edges [px]."""
        return float(np.abs(np.diff(self.ends[..., 0])).sum())

    def at(self, turn: Array, shift: Array) -> Array:
        """Return the ends [px], shape (..., E, 2, 2), at turns of shape (n,) [rad] and shifts of shape (n, 2) [px]."""
        cos, sin = np.cos(turn)[..., None, None], np.sin(turn)[..., None, None]
        x, y = self.ends[..., 0], self.ends[..., 1]
        turned = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
        return turned + self.pivot + shift[..., None, None, :]


@dataclass(frozen=True, slots=True)
class Slopes:
    """Change of brightness across a small picture."""

    across: Image
    """Along its rows and down its columns [grey levels/px], shape (h, w)."""
    down: Image
    corner: Array
    """Left and top in the film [px], shape (2,)."""
    times: int
    """Pixels of the film in one of it."""

    def along(self, place: Array, normal: Array) -> Array:
        """Return the change along normals [grey levels/px], shape (n, m), at places in the film [px], both of shape (n, m, 2)."""
        x, y = np.moveaxis((place - self.corner - (self.times - 1) / 2) / self.times, -1, 0).astype(
            np.float32
        )
        rows = x.reshape(len(x), -1), y.reshape(len(y), -1)
        parts = (cv2.remap(one, *rows, cv2.INTER_LINEAR).reshape(x.shape) for one in (self.across, self.down))
        return np.asarray(sum(part * normal[..., axis] for axis, part in enumerate(parts)), np.float64)


def slopes_of(frame: Frame) -> Slopes:
    """Return the change of brightness in a frame, halved until it is small."""
    small, times = halved(frame.picture, SMALL_SIDE)
    smooth = cv2.GaussianBlur(small, (0, 0), 1.0)
    across, down = (
        np.asarray(cv2.Scharr(smooth, cv2.CV_32F, *axis, scale=1 / 32), np.float32)
        for axis in ((1, 0), (0, 1))
    )
    return Slopes(across, down, np.array(frame.corner, float), times)


def find_edges(look: Survey) -> Edges | None:
    """Return the edges of the body that turns in some pictures of a film; None without any."""
    every = [slopes_of(frame.cut(look.box)) for frame in look.frames]
    shifts = np.array([frame.shift for frame in look.frames])
    moving = _without_still(every, shifts)
    lines = [_lines(one, shift) for one, shift in zip(moving, shifts, strict=True)]
    picture = np.repeat(np.arange(len(lines)), [len(one) for one in lines])
    found: list[Edges] = []
    for pivot, turns, rows in _common_pivots(np.concatenate(lines), picture, look.box):
        _, some = np.unique(np.round(turns / (2 * TURN_BIN)), return_index=True)  # each attitude counts once
        ends = _ends([every[row] for row in rows[some]], pivot + shifts[rows[some]], turns[some], look.box)
        if len(ends):
            found.append(Edges(pivot, ends))
    some = list(zip(look.frames, moving, strict=True))[::2]

    def shown(edges: Edges) -> float:
        follower = EdgeFollower(edges)
        return edges.length * sum(follower.search(frame, slopes)[2] for frame, slopes in some)

    best = max(found, key=shown, default=None)
    if best is None:
        return None
    follower = EdgeFollower(best)
    return replace(best, shown=float(np.median([follower.search(frame)[2] for frame in look.frames])))


def _without_still(every: Sequence[Slopes], shifts: Array) -> list[Slopes]:
    """Return the change of brightness without what most pictures share: lines that stand still, and the body where it rests."""
    found: list[dict[str, Image]] = [{} for _ in every]
    for name in ("across", "down"):
        parts = [getattr(one, name) for one in every]
        moves = [np.column_stack([np.eye(2), (shift - shifts[0]) / every[0].times]) for shift in shifts]
        size, flags = parts[0].shape[::-1], cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        usual = np.median(
            [cv2.warpAffine(one, move, size, flags=flags) for one, move in zip(parts, moves, strict=True)],
            axis=0,
        )
        for row, (one, move) in enumerate(zip(parts, moves, strict=True)):
            still = cv2.warpAffine(usual, move, size, flags=cv2.INTER_LINEAR)
            # The rest of a line that a camera turns a little is a share of it.
            rest = np.maximum(np.abs(one) - 1.5 * cv2.dilate(np.abs(still), np.ones((3, 3), np.uint8)), 0)
            found[row][name] = np.copysign(np.minimum(rest, np.abs(one)), one).astype(np.float32)
    return [replace(one, **parts) for one, parts in zip(every, found, strict=True)]


def _lines(moving: Slopes, shift: Array) -> Array:
    """Return the lines in a picture, shifted by the camera: turn [rad], distance from the origin [px], votes and polarity; shape (L, 4)."""
    across, down, corner, times = moving.across, moving.down, moving.corner - shift, moving.times
    size = np.hypot(across, down)
    rows, columns = np.nonzero(size > max(4.0, float(np.quantile(size, 0.98))))
    if len(rows) == 0:
        return np.zeros((0, 4))
    x, y, amount = across[rows, columns], down[rows, columns], size[rows, columns]
    polarity = np.where(y > 0, 1.0, -1.0)
    turn = np.arctan2(-polarity * x, polarity * y)
    place = times * np.stack([columns, rows], axis=1) + (times - 1) / 2 + corner
    middle = times * np.array(across.shape[::-1]) / 2 + corner
    distance = np.sum((place - middle) * np.stack([-np.sin(turn), np.cos(turn)], axis=1), axis=1)
    reach = float(np.hypot(*(times * np.array(across.shape)))) / 2
    bins = (round(2 * MAX_TURN / TURN_BIN), round(reach / times))
    found: list[Array] = []
    for way in (1.0, -1.0):
        own = polarity == way
        votes, *edges = np.histogram2d(
            turn[own], distance[own], bins, ((-MAX_TURN, MAX_TURN), (-reach, reach)), weights=np.minimum(amount[own], np.median(amount))
        )  # fmt: skip
        votes = cv2.GaussianBlur(votes, (0, 0), 1.0)
        peak = (votes == cv2.dilate(votes, np.ones((9, 9)))) & (votes > 0)
        at = np.argwhere(peak)
        at = at[np.argsort(-votes[peak])[:LINES]]
        angle, off = (edge[at[:, axis]] + np.diff(edge)[0] / 2 for axis, edge in enumerate(edges))
        off = off + middle[0] * -np.sin(angle) + middle[1] * np.cos(angle)
        found.append(np.stack([angle, off, votes[tuple(at.T)], np.full(len(at), way)], axis=1))
    return np.concatenate(found)


def _common_pivots(lines: Array, picture: Rows, box: Box) -> Iterator[tuple[Array, Array, Rows]]:
    """Yield pivots [px] about which one line in many pictures turns, these turns [rad], shape (m,), and pictures, shape (m,).

    Random sample consensus (Fischler and Bolles, 1981). Each attitude counts once, so that a line that stands still does not win.

    Args:
        lines: The lines of all pictures as `_lines` returns them, shape (L, 4).
        picture: Number of the picture of each, shape (L,).
        box: The part that moves [px]; the pivot lies there or within its size beside it.
    """
    turn, distance, votes, polarity = lines.T
    design = np.stack([np.ones(len(lines)), -np.sin(turn), np.cos(turn)], axis=1)
    attitude = np.round((turn + MAX_TURN) / (2 * TURN_BIN)).astype(int)
    low, high = np.reshape(box, (2, 2))
    for seed, way in product(range(4), (1.0, -1.0)):
        rng, best, found = np.random.default_rng(seed), 0.0, None
        own = np.flatnonzero(polarity == way)
        own = own[np.lexsort((-votes[own], picture[own]))]  # a picture shows its strongest line that agrees
        for _ in range(400 if len(own) > 4 else 0):
            three = rng.choice(own, 3, replace=False)
            if np.ptp(turn[three]) < 4 * TURN_BIN or abs(np.linalg.det(design[three])) < 1e-6:
                continue
            model = np.linalg.solve(design[three], distance[three])
            if np.any(model[1:] < 2 * low - high) or np.any(model[1:] > 2 * high - low):
                continue
            near = own[np.abs(design[own] @ model - distance[own]) < 3.0]
            near = near[np.unique(picture[near], return_index=True)[1]]
            most = np.zeros(attitude.max() + 1)
            np.maximum.at(most, attitude[near], votes[near])
            if most.sum() > best:
                best, found = float(most.sum()), near
        if found is not None:
            model, *_ = np.linalg.lstsq(design[found], distance[found], rcond=None)
            yield model[1:], turn[found], picture[found]


def _ends(every: list[Slopes], pivots: Array, turns: Array, box: Box) -> Array:
    """Return the ends of the edges about the pivot [px], shape (E, 2, 2): where three of four pictures step alike."""
    unit = every[0].times
    corners = np.array([[box[x], box[y]] for x in (0, 2) for y in (1, 3)]) - pivots[0]
    radius = float(np.linalg.norm(corners, axis=1).max())
    x = np.arange(-radius, radius, 4 * unit)
    y = np.arange(-radius, radius, unit)
    shown: list[Array] = []
    for one, pivot, turn in zip(every, pivots, turns, strict=True):
        cos, sin = np.cos(turn), np.sin(turn)
        place = np.stack([cos * x - sin * y[:, None], sin * x + cos * y[:, None]], axis=-1) + pivot
        shown.append(one.along(place, np.broadcast_to([-sin, cos], place.shape)))
    # Each attitude counts once; the quarter and three quarters agree in sign where nearly all pictures step alike.
    low, high = np.quantile(shown, [0.25, 0.75], axis=0)
    alike = np.where(low > 0, low, np.where(high < 0, high, 0.0))
    alike = cv2.blur(alike, (5, 1))
    found: list[Array] = []
    left = np.abs(alike).sum(axis=1)
    strongest = left.max()
    while len(found) < LINES and left.max() > 0.4 * strongest > 0:
        row = int(np.argmax(left))
        line = np.abs(alike[max(row - 1, 0) : row + 2].sum(axis=0))
        on = (
            np.flatnonzero(line > 0.4 * np.quantile(line[line > 0], 0.8))
            if (line > 0).any()
            else np.zeros(0, int)
        )
        run = max(np.split(on, np.flatnonzero(np.diff(on) > 2) + 1), key=len)
        left[max(row - 2, 0) : row + 3] = 0
        if len(run) < 5:
            continue
        begin, end = x[run[0]] + 4 * unit, x[run[-1]] - 4 * unit
        ends = np.array([[begin, y[row]], [end, y[row]]])
        found.append(ends[::-1] if alike[row, run].sum() > 0 else ends)
    return np.array(found)


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
        points, self._lost, was_lost = np.zeros(0), True, self._lost
        if shown < self.edges.shown / 3:
            return None
        for reach in (6.0, 3.0):
            place = self.edges.at(np.array(turn), shift)
            points = find_steps(frame, place, reach, 1.0)
            along, off = _from_line(points, place)
            seen = np.isfinite(off)
            if seen.mean() < 0.4:
                return None
            line = np.stack([along[seen], off[seen]], axis=1).astype(np.float32)
            across, down, x, y = cv2.fitLine(line, cv2.DIST_WELSCH, 0, 0.01, 0.001).ravel().tolist()
            slope, height = down / across, y - x * down / across
            if np.mean(np.abs(off - height - slope * along) < 2.0) < 0.4:
                return None
            turn += slope
            shift = shift + height * np.array([-np.sin(turn), np.cos(turn)])
        self._step = 0.0 if was_lost else turn - self._turn
        self._turn, self._lost = turn, False
        return points.reshape(-1, 2)

    def search(self, frame: Frame, slopes: Slopes | None = None) -> tuple[float, Array, float]:
        """Return the turn [rad] and the shift, shape (2,) [px], at which the edges show best, and the change of brightness there."""
        reach = MAX_TURN if self._lost else MAX_TURN / 3
        middle = 0.0 if self._lost else self._turn + self._step
        slopes = slopes or slopes_of(frame.cut(self._box(frame, middle, reach)))
        turns = middle + np.arange(-reach, reach, TURN_BIN / 2)
        across = slopes.times * np.arange(-6.0, 7.0, 2.0)
        turn, down = (one.ravel() for one in np.meshgrid(turns, across, indexing="ij"))
        normal = np.stack([-np.sin(turn), np.cos(turn)], axis=-1)
        ends = self.edges.at(turn, frame.shift + down[:, None] * normal)
        share = (np.arange(24)[:, None] + 0.5) / 24
        places = ends[:, :, None, 0] + share * (ends[:, :, None, 1] - ends[:, :, None, 0])
        way = np.sign(self.edges.ends[:, 0, 0] - self.edges.ends[:, 1, 0])
        seen = way[:, None] * slopes.along(places, np.broadcast_to(normal[:, None, None], places.shape))
        score = np.maximum(seen, 0).mean(axis=(1, 2))
        best = int(np.argmax(score))
        # The median is the score of any line across the picture.
        return (
            float(turn[best]),
            frame.shift + down[best] * normal[best],
            float(score[best] - np.median(score)),
        )

    def _box(self, frame: Frame, middle: float, reach: float) -> Box:
        ends = self.edges.at(
            middle + np.linspace(-reach, reach, 9), np.broadcast_to(frame.shift, (9, 2))
        ).reshape(-1, 2)
        left, top = (ends.min(axis=0) - 30).astype(int).tolist()
        right, bottom = (ends.max(axis=0) + 30).astype(int).tolist()
        return left, top, right, bottom


def _from_line(points: Array, ends: Array) -> tuple[Array, Array]:
    """Return points (E, PIECES, 2) along the edges from their common middle, and across them, downwards [px], both flat."""
    way = ends[:, 1] - ends[:, 0]
    way = way * np.sign(way[:, :1]) / np.linalg.norm(way, axis=1, keepdims=True)
    off = points - ends.mean(axis=1)[:, None]
    normal = np.stack([-way[:, 1], way[:, 0]], axis=1)
    along = np.einsum("epk,ek->ep", points - ends.mean(axis=(0, 1)), way)
    return along.ravel(), np.einsum("epk,ek->ep", off, normal).ravel()


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


def fit_edges(z: Complex, start: Array) -> EdgeFit:
    """Find the turn of a body by points on its edges: every point keeps its height above the pivot, whatever the turn.

    Args:
        z: Points in each frame from about their pivot [px], shape (n, M); NaN where not seen.
        start: The turn roughly [rad], shape (n,).
    """
    seen = np.isfinite(z)
    place, angle, pivot = np.where(seen, z, 0), start.copy(), np.zeros(z.shape[1], complex)
    weight, height = seen.astype(float), np.zeros(z.shape[1])
    along = rest = variance = np.zeros(0)
    # Points on something else lose their weight one by one, as the median distance falls.
    for _ in range(24):
        turned: Complex = np.exp(-1j * angle)[:, None] * (place - pivot)
        share = weight * attitude_share(angle, TURN_BIN)[:, None] + 1e-12
        height = np.average(turned.imag - _mean(turned.imag - height, weight), axis=0, weights=share)
        along = turned.real - _mean(turned.real, weight)
        off = turned.imag - height
        off = off - _mean(off, weight)
        lever = np.maximum((weight * along**2).sum(axis=1), 1e-9)
        step = (weight * along * off).sum(axis=1) / lever
        angle = angle + step
        pivot = pivot + _pivots(off, angle, share)
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
    total = (weight.sum(axis=0) + 1e-9).reshape(-1, PIECES)
    along, height = (
        np.average(along, axis=0, weights=weight.sum(axis=1) + 1e-9).reshape(-1, PIECES),
        height.reshape(-1, PIECES),
    )
    along, height = along - _mean(along, total), height - _mean(height, total)
    level = np.arctan((total * along * height).sum() / (total * along**2).sum())
    return EdgeFit(angle + level, variance, weight, rest)


def _pivots(off: Array, angle: Array, share: Array) -> Complex:
    """Return by how much the pivot of each point's edge is off [px], shape (M,): the body's far end turns about another place.

    Args:
        off: Distances of points from where they should be across their edges [px], shape (n, M).
        angle: Turns [rad], shape (n,).
        share: Weights, shape (n, M).
    """
    each = share.reshape(len(off), -1, PIECES)
    mean = (off.reshape(each.shape) * each).sum(axis=2) / np.maximum(each.sum(axis=2), 1e-9)
    lever = np.stack([-np.sin(angle), np.cos(angle), np.ones(len(angle))], axis=1)
    found = np.zeros(each.shape[1], complex)
    for edge, weight in enumerate(each.sum(axis=2).T):
        normal = lever.T @ (weight[:, None] * lever) + 1e-3 * weight.sum() * np.diag([1.0, 1.0, 0.0])
        x, y, _ = np.linalg.solve(normal, lever.T @ (weight * mean[:, edge]))
        found[edge] = complex(x, y)
    return np.repeat(found - found.mean(), PIECES)


def _mean(values: Array, weight: Array) -> Array:
    return (weight * values).sum(axis=1, keepdims=True) / np.maximum(weight.sum(axis=1, keepdims=True), 1e-9)


def fit_turn(view: View, matrix: Array, before: CameraState, *, pivot: Array) -> AngleTrack:
    """Return the turn of the edges as a camera along the axis sees it.

    Lines across the axis show neither its direction nor focal length nor read-out: these stay as they are known beforehand.

    Args:
        view: Points along the edges.
        matrix: Camera matrix [px], shape (3, 3).
        before: Prior knowledge of camera and lens.
        pivot: The point that the edges turn about in the picture [px], shape (2,).
    """
    time = view.time(before.readout)

    def fit_at(value: Array) -> EdgeFit:
        z = rectify(view.points, matrix, value) - rectify(pivot[None], matrix, value)
        start = _rough_turn(z)
        moved = np.zeros(z.shape, complex)
        if value[READOUT]:  # an edge does not show its motion along itself: the turn about the pivot does
            moved = 1j * rate_of(time, start)[:, None] * z * np.nan_to_num(view.late * value[READOUT])
        return fit_edges(z - moved, start)

    fit = fit_at(before.value)
    unknown = spread_by(
        before.value, before.covariance, fit.angle, lambda x: fit_at(x).angle, time, view.share, READOUT
    )
    trusted = fit.weight.sum(axis=1)
    wrong = trusted < 0.4 * float(np.median(trusted))
    angle = np.where(wrong, np.nan, fit.angle)
    own = np.sqrt(np.where(wrong, np.nan, fit.variance + smear(angle) ** 2))
    noise = float(np.sqrt(np.average(fit.rest**2, weights=fit.weight)))
    lost = int((wrong & np.isfinite(view.points).any(axis=(1, 2))).sum())
    return AngleTrack(
        unwrap(angle), np.hypot(own, np.sqrt(unknown)), before, noise, lost, np.array([1 + 0j]), own
    )


def _rough_turn(z: Complex) -> Array:
    """Return the median slope between points half an edge apart [rad], shape (n,), in frames without one that of their neighbours."""
    edges = z.reshape(len(z), -1, PIECES)
    half = edges[..., PIECES // 2 :] - edges[..., : PIECES // 2]
    half = np.where(np.nanmedian(half.real, axis=(0, 2), keepdims=True) < 0, -half, half).reshape(len(z), -1)
    good = np.isfinite(half).any(axis=1)
    slope = np.full(len(z), np.nan)
    slope[good] = np.nanmedian(np.angle(half[good]), axis=1)
    return np.interp(np.arange(len(z)), np.flatnonzero(good), slope[good]) if good.any() else np.zeros(len(z))


def _find(reel: Reel) -> Target | None:
    edges = find_edges(reel.look)
    if edges is None:
        return None
    count = len(edges.ends)
    lengths = ", ".join(f"{abs(right - left):.0f}" for left, right in edges.ends[..., 0])
    unseen = (
        "an edge does not show from where the camera looks: it is taken to look along the board's axis to within 5 degrees "
        "(--camera-angle)"
    )
    return Target(
        follower=EdgeFollower(edges),
        what="the deck's edge",
        why=f"{count} straight edge{'s' if count > 1 else ''} ({lengths} px long)",
        solve=partial(fit_turn, pivot=edges.pivot),
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
