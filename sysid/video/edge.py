"""Follows the deck's own straight edges, where there is neither mark nor texture.

Its edges across the axis are parallel and turn together, whichever end and whichever side of the deck they
bound. The deck's long sides do not, nor do lines of the background: what several edges agree on is the deck.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from sysid.roll import Array
from sysid.video.edge_find import FAINTEST, Edges, rotation
from sysid.video.edge_slope import normals, sides_of
from sysid.video.frames import Frame, Picture, grey
from sysid.video.straight_edge import find_edges

PIVOTS = 0.04
"""How far the pivots of edges at different depths are apart, as a share of the width of what moves."""
CLOSE = np.radians(np.arange(-3.0, 3.5, 0.5))
"""Turns that are searched about the rough one."""
TOGETHER = np.radians(2.0)
"""An edge that turns by so much more or less than the others is another line."""
CORRELATION = 6.0
"""Length along an edge over which errors are alike: compression works in blocks of 8 or 16 pixels."""


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
            there = pivot + (self.starts[edge, 0] - pivot) @ rotation(float(turn)).T
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
        return normals(self.starts) @ rotation(turn).T

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
            turned = pivot + (start - pivot) @ rotation(turn).T
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
