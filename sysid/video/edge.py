"""The deck's own straight edges, where there is neither mark nor texture.

Its edges across the axis are parallel and turn together, whichever end and whichever side of the deck they
bound. The deck's long sides do not, nor do lines of the background: what several edges agree on is the deck.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from sysid.roll import Array
from sysid.video.edge_slope import (
    PARALLEL,
    normals,
    segments,
    sides_of,
    slope_of,
    still_there,
)
from sysid.video.frames import Frame, Picture, grey
from sysid.video.still_picture import camera_shift
from sysid.video.straight_edge import find_edges
from sysid.video.survey import Survey

SHORTEST = 40
"""Shortest edge that is followed [px]."""
MOST = 8
"""Edges that are followed at most."""
PICTURES = 40
"""Pictures in which edges are looked for."""
FAINTEST = 12.0
"""Least contrast of an edge [grey levels]."""
ATTITUDE = np.radians(5.0)
"""Turn of the deck from which on its edges are not where they were."""
STAYS = 0.4
"""Share of the other attitudes in which a line may be where it was and still be the deck's."""
ALIKE = 25.0
"""Difference of brightness up to which two lines may be the same edge [grey levels]."""
PAIRS = 4
"""Pairs of lines from different attitudes that are needed to tell the pivot."""
COMPARED = 120
"""Lines that are compared at most to find the pivot."""
FAR = 0.3
"""Share of its support that a pivot a quarter of the board's width from the middle of the level deck loses."""
GRID = 15
"""Pivots across and down that are tried first."""
NEAR = 0.02
"""Distance at which two lines, turned back, are one, as a share of the width of what moves."""
PIVOTS = 0.04
"""How far the pivots of edges at different depths are apart, as a share of the width of what moves."""
CLOSE = np.radians(np.arange(-3.0, 3.5, 0.5))
"""Turns that are searched about the rough one."""
TOGETHER = np.radians(2.0)
"""An edge that turns by so much more or less than the others is another line."""
CORRELATION = 6.0
"""Length along an edge over which errors are alike: compression works in blocks of 8 or 16 pixels."""


@dataclass(frozen=True, slots=True)
class Edges:
    """Edges of the deck, found in several pictures, as they would be in the first."""

    ends: Array
    """Both ends of each [px], the brighter side above the line from the first to the second, shape (E, 2, 2)."""
    sides: Array
    """Brightness above and below [grey levels], shape (E, 2)."""
    turn: Array
    """Turn since the first picture of the picture in which each was found [rad], shape (E,)."""
    pivot: Array
    """What they turn about [px], shape (2,)."""
    pivot_std: float
    """Standard deviation of that [px]."""


@dataclass(frozen=True, slots=True)
class _Line:
    """A line of one picture that may be an edge of the deck."""

    score: float
    ends: Array
    """Both ends, freed of the camera's shake [px], shape (2, 2)."""
    sides: Array
    turn: float

    def back(self, pivot: Array) -> Array:
        """Return the ends as they would be in the first picture."""
        return pivot + (self.ends - pivot) @ _rotation(self.turn)


def find_deck_edges(look: Survey, slopes: Array) -> Edges:
    """Return edges across the deck, the best first.

    As the deck turns, one of its edges is lost in front of a wheel and another comes out against the wall, so
    that edges are looked for in pictures from all over the film.

    Args:
        look: Pictures of the film.
        slopes: Rough slope of the lines across the deck in each frame [rad].
    """
    shifts = [camera_shift(look.pictures[0], other) for other in look.pictures]
    slope = slopes[list(look.indices)]
    found: list[_Line] = []
    for number in range(0, len(look.pictures), max(1, len(look.pictures) // PICTURES)):
        dark = look.pictures[number]
        ends = segments(dark, look.box, SHORTEST)
        ends = ends[np.abs(slope_of(ends) - slope[number]) < PARALLEL]
        if not len(ends):
            continue
        sides = sides_of(dark, ends)
        ends = np.where((sides[:, 0] < sides[:, 1])[:, None, None], ends[:, ::-1], ends)
        sides = -np.sort(-sides, axis=1)
        step = sides[:, 0] - sides[:, 1]
        others = np.flatnonzero(np.abs(slope - slope[number]) > ATTITUDE)
        there = still_there(
            step, ends - shifts[number], [look.pictures[k] for k in others], [shifts[k] for k in others]
        )
        # What stays where it is while the deck turns is behind it.
        stays = there.mean(axis=0) if len(others) else np.zeros(len(ends))
        score = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) * np.minimum(step, 60.0)
        for line in np.flatnonzero((step > FAINTEST) & (stays <= STAYS)):
            middle = ends[line].mean(axis=0)
            short = middle + 0.8 * (ends[line] - middle) - shifts[number]
            found.append(_Line(float(score[line]), short, sides[line], float(slope[number] - slope[0])))
    # From as high as the deck, its long sides and its ends are one line at rest, and several when it is tilted.
    rest = float(np.median(slope - slope[0]))
    tilted = [line for line in found if abs(line.turn - rest) > ATTITUDE]
    level = [line.ends.mean(axis=0) for line in found if abs(line.turn - rest) <= ATTITUDE]
    middle = np.median(level, axis=0) if level else np.array(look.box).reshape(2, 2).mean(axis=0)
    found = tilted if len(tilted) > 1 else found
    pivot, spread = _pivot(found, look.box, middle)
    size = NEAR * (look.box[2] - look.box[0])
    kept: list[_Line] = []
    for line in sorted(found, key=lambda line: -line.score):
        if len(kept) < MOST and not any(_same(line, other, pivot, 2 * size) for other in kept):
            kept.append(line)
    return Edges(
        np.array([line.back(pivot) for line in kept]).reshape(-1, 2, 2),
        np.array([line.sides for line in kept]).reshape(-1, 2),
        np.array([line.turn for line in kept]),
        pivot,
        spread,
    )


def _pivot(lines: list[_Line], box: tuple[int, int, int, int], middle: Array) -> tuple[Array, float]:
    """Return the point about which lines of different pictures turn into one another, and its deviation [px].

    Two attitudes tell it in one direction only, so that it is looked for near the middle of the level deck.
    """
    lines = sorted(lines, key=lambda line: -line.score)[:COMPARED]
    ends = np.array([line.ends for line in lines]).reshape(-1, 2)
    (left, top), (right, bottom) = (ends.min(axis=0), ends.max(axis=0)) if len(ends) else (box[:2], box[2:])
    size = max(right - left, bottom - top)
    one, other = np.triu_indices(len(lines), 1)
    turn = np.array([line.turn for line in lines])
    sides = np.array([line.sides for line in lines]).reshape(-1, 2)
    alike = np.abs(sides[one] - sides[other]).max(axis=1) < ALIKE
    pair = (np.abs(turn[one] - turn[other]) > ATTITUDE) & alike
    one, other = one[pair], other[pair]
    if len(one) < PAIRS:
        return middle, size / 4
    score = np.sqrt([line.score for line in lines])
    home = np.array([line.back(middle) for line in lines])
    normal, places = normals(home), home.mean(axis=1)
    # Turned back about another pivot, a line is shifted by (1 - R) of how far that is from the middle.
    shift = np.eye(2) - np.array([_rotation(-angle) for angle in turn])
    near = NEAR * size
    best, reach, count = middle, np.array([right - left, bottom - top]) / 2, GRID
    for _ in range(3):  # all over the board, then twice a finer grid about the best
        grid = np.linspace(-1, 1, count)
        pivots = best + np.array(np.meshgrid(reach[0] * grid, reach[1] * grid)).reshape(2, -1).T
        back = places + np.einsum("lij,pj->pli", shift, pivots - middle)
        gap = np.sum((back[:, one] - back[:, other]) * normal[one], axis=2)
        far = np.sum((pivots - middle) ** 2, axis=1) / (size / 4) ** 2
        support = np.exp(-((gap / near) ** 2) / 2) @ (score[one] * score[other])
        best = pivots[int(np.argmax(support - FAR * support.max() * far))]
        reach, count = 2 * reach / GRID, 7
    return best, 2 * near


def _same(one: _Line, other: _Line, pivot: Array, size: float) -> bool:
    """Whether two lines, turned back, are one edge: side by side, overlapping, and alike in brightness."""
    home = other.back(pivot)
    along = home[1] - home[0]
    length = float(np.linalg.norm(along))
    along = along / length
    offset = (one.back(pivot) - home[0]) @ np.array([along[1], -along[0]])
    places = np.sort((one.back(pivot) - home[0]) @ along)
    overlap = min(places[1], length) - max(places[0], 0.0)
    alike = float(np.abs(one.sides - other.sides).max()) < ALIKE
    return abs(float(offset.mean())) < size and overlap > 0.3 * (places[1] - places[0]) and alike


@dataclass(slots=True)
class EdgeTracker:
    """Follows edges across the deck: a search about the rough turn, a shift for each, then profiles across them.

    A line shows where it is across itself only, so the ends would slide along the edge. They are carried
    by a turn about a pivot instead, which is learned on the way: for a line n·x = c turning about p,
    c = n·p + h in every frame.
    """

    edges: Edges
    slopes: Array
    """Rough slope of the lines across the deck in each frame [rad]."""
    box: tuple[int, int, int, int]
    deviations: list[Array] = field(default_factory=list)
    """Standard deviation of the edges' directions in each frame [rad], each (E,); NaN where one is not seen."""
    _drift: float = 0.0
    """How far the edges were from where the pivots put them in the last frame: a camera that is held shakes [px]."""
    _lost: int = 0
    _sides: Array = field(init=False)
    _contrast: Array = field(init=False)
    _information: Array = field(init=False)
    _moment: Array = field(init=False)

    def __post_init__(self) -> None:
        """Expect the edges where they were found, about the pivot that the pictures showed."""
        pivot, spread = self.edges.pivot, self.edges.pivot_std
        height = np.sum(self._normals(0.0) * (self.starts[:, 0] - pivot), axis=1)
        count = len(self.starts)
        self._information = np.tile(np.eye(3) / spread**2, (count, 1, 1))
        self._moment = np.column_stack([np.tile(pivot, (count, 1)), height]) / spread**2
        for edge, turn in enumerate(self.edges.turn):  # where it was found, it is known to be
            row = np.append(self._normals(float(turn))[edge], 1.0)
            there = pivot + (self.starts[edge, 0] - pivot) @ _rotation(float(turn)).T
            self._information[edge] += np.outer(row, row) / 4.0**2
            self._moment[edge] += row * (row[:2] @ there) / 4.0**2
        self._sides = self.edges.sides.copy()
        self._contrast = self.edges.sides[:, 0] - self.edges.sides[:, 1]

    @property
    def starts(self) -> Array:
        """Both ends of each edge as they would be in the first frame [px], shape (E, 2, 2)."""
        return self.edges.ends

    @property
    def points(self) -> int:
        """Both ends of each edge; only the line through them means anything."""
        return 2 * len(self.starts)

    def update(self, frame: Frame) -> Array | None:
        """Return both ends of each edge [px], shape (2E, 2), NaN where one is not seen; None where none is."""
        dark = grey(frame.picture)
        turn = float(self.slopes[frame.index] - self.slopes[0])
        ends, deviation = self._fit(dark, self._search(dark, turn + CLOSE))
        along, before = ends[:, 1] - ends[:, 0], self.starts[:, 1] - self.starts[:, 0]
        turns = np.angle((along @ [1, 1j]) / (before @ [1, 1j]))
        agreed = _agreed(turns, deviation)
        if agreed is None:
            self._lost += 1
            self.deviations.append(np.full(len(ends), np.nan))
            return None
        self._lost = 0
        self._learn(dark, ends, turns, agreed)
        self.deviations.append(np.where(agreed, deviation, np.nan))
        return np.where(agreed[:, None, None], ends, np.nan).reshape(-1, 2)

    def _learn(self, dark: Picture, ends: Array, turns: Array, good: npt.NDArray[np.bool_]) -> None:
        """Learn brightness and pivots from the edges that are seen."""
        sides = sides_of(dark, np.where(good[:, None, None], ends, self.starts))
        step = sides[:, 0] - sides[:, 1]
        self._contrast = np.where(good, 0.95 * self._contrast + 0.05 * step, self._contrast)
        self._sides = np.where(good[:, None], 0.95 * self._sides + 0.05 * sides, self._sides)
        information, moment = self._pivots()
        off: list[float] = []
        for edge in np.flatnonzero(good):
            normal = self._normals(float(turns[edge]))[edge]
            row = np.append(normal, 1.0)
            off.append(float(normal @ ends[edge, 0] - row @ np.linalg.solve(information[edge], moment[edge])))
            self._information[edge] += np.outer(row, row) / 2.0**2
            self._moment[edge] += row * (normal @ ends[edge, 0]) / 2.0**2
        self._drift = float(np.median(off))

    def _normals(self, turn: float) -> Array:
        """Unit vectors towards the brighter side of each edge, turned, shape (E, 2)."""
        return normals(self.starts) @ _rotation(turn).T

    def _search(self, dark: Picture, turns: Array) -> Array:
        """Best places of the edges at some turns: bright and dark sides as they were before.

        One turn for all: the one at which most of them, by length, look as they did.
        """
        total = -0.25 * ((turns - turns.mean()) / np.ptp(turns)) ** 2
        length = np.linalg.norm(self.starts[:, 1] - self.starts[:, 0], axis=1)
        best = np.zeros((len(self.starts), len(turns), 2, 2))
        information, moment = self._pivots()
        for edge in range(len(self.starts)):
            match, best[edge] = self._search_one(dark, edge, turns, information[edge], moment[edge])
            # One that is hidden says nothing, rather than no.
            total = total + length[edge] / length.sum() * np.maximum(match, 0.0)
        return best[:, int(np.argmax(total))]

    def _pivots(self) -> tuple[Array, Array]:
        """Information on each edge's pivot and height: its own, and about the pivot what all have learned."""
        cross, own = self._information[:, :2, 2], self._information[:, 2, 2]
        shared = (self._information[:, :2, :2] - cross[:, :, None] * cross[:, None] / own[:, None, None]).sum(
            axis=0
        )
        pull = (self._moment[:, :2] - cross * (self._moment[:, 2] / own)[:, None]).sum(axis=0)
        apart = (PIVOTS * (self.box[2] - self.box[0])) ** 2 * np.eye(2)
        spread = np.linalg.inv(np.linalg.inv(shared) + apart)
        information, moment = self._information.copy(), self._moment.copy()
        information[:, :2, :2] += spread
        moment[:, :2] += spread @ np.linalg.solve(shared, pull)
        return information, moment

    def _search_one(
        self, dark: Picture, edge: int, turns: Array, information: Array, moment: Array
    ) -> tuple[Array, Array]:
        """How well an edge matches at each turn, shape (T,), and where, shape (T, 2, 2)."""
        covariance = np.linalg.inv(information)
        learned = covariance @ moment
        pivot, height = learned[:2], learned[2]
        start = self.starts[edge]
        ends: list[Array] = []
        penalty: list[Array] = []
        for turn in turns:
            normal = self._normals(turn)[edge]
            row = np.append(normal, 1.0)
            reach = min(3.0 * float(np.sqrt(row @ covariance @ row)) + 6.0 + 2.0 * self._lost, 40.0)
            shifts = np.arange(-reach, reach + 0.5, 1.5)
            turned = pivot + (start - pivot) @ _rotation(turn).T
            turned = turned + (normal @ pivot + height + self._drift - normal @ turned[0]) * normal
            ends.append(turned + shifts[:, None, None] * normal)
            penalty.append(0.25 * (shifts / reach) ** 2)
        places = np.concatenate(ends)
        sides = sides_of(dark, places)
        alike = np.min(np.abs(sides - self._sides[edge]), axis=1)
        score = (sides[:, 0] - sides[:, 1] - 1.5 * alike) / max(
            self._contrast[edge], FAINTEST
        ) - np.concatenate(penalty)
        begin = np.cumsum([0, *(len(each) for each in ends)])
        top = [a + int(np.argmax(score[a:b])) for a, b in pairwise(begin)]
        return np.minimum(score[top], 1.0), places[top]

    def _fit(self, dark: Picture, ends: Array) -> tuple[Array, Array]:
        """Move edges onto what is seen nearby; return their ends and the directions' deviations, NaN where there is none."""
        edges = None
        for reach in (4.0, 3.0):
            edges = find_edges(dark, ends, reach, count=40)
            ends = np.where(np.isfinite(edges.ends), edges.ends, ends)
        assert edges is not None
        lost = np.asarray(~np.isfinite(edges.ends).all(axis=(1, 2)) | (edges.used < 0.4), np.bool_)
        lost |= ~(edges.contrast >= np.maximum(8.0, 0.35 * self._contrast))
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        independent = np.maximum(edges.used * 0.8 * length / CORRELATION, 3.0)
        deviation = np.hypot(edges.scatter, 0.05) * np.sqrt(12 / independent) / (0.8 * length)
        return ends, np.where(lost, np.nan, deviation)


def _agreed(turns: Array, deviation: Array) -> npt.NDArray[np.bool_] | None:
    """Tell which edges agree on one turn with most of the others, by weight; None where none is seen."""
    seen = np.asarray(np.isfinite(deviation), np.bool_)
    if not seen.any():
        return None
    weight = np.where(seen, 1 / np.where(seen, deviation, 1.0) ** 2, 0.0)
    weight = np.minimum(weight, 3 * np.median(weight[seen]))  # one alone does not outvote two
    apart = np.abs(np.angle(np.exp(1j * (turns[:, None] - turns))))
    near = (apart < TOGETHER) & seen & seen[:, None]
    return np.asarray(near[int(np.argmax(near @ weight))], np.bool_)


def _rotation(turn: float) -> Array:
    return np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
