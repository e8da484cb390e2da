"""Follows the edges of the deck's end, where there is neither mark nor texture."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from sysid.roll import Array
from sysid.video.film.frames import Frame
from sysid.video.trackers._edge_profile import PIECES, beside_line
from sysid.video.trackers.edge.brightness_steps import MAX_SLOPE, Steps, scale_of, steps_of, turned
from sysid.video.trackers.edge.far_end import DeckEnd
from sysid.video.trackers.edge.find import measured
from sysid.video.types import Box

EDGE_SAMPLES = 24
"""Points of an edge whose steps of brightness tell the rough turn."""
AVERAGED_SAMPLES = 4
"""Of these, how many neighbours must step alike."""
TURN_STEP = np.radians(1.5)
"""Steps of the turn that is looked for first [rad]."""
MAX_FRAME_TURN = np.radians(15.0)
"""Turn from frame to frame that is looked for first [rad]."""
MAX_TURN = np.radians(45.0)
"""Where the deck may be if it was not found there [rad]."""
MAX_SHIFT = 6.0
"""How far a shaking camera and soft trucks may shift the edges [px]."""
MARGIN = 16.0
"""What is looked at beside where the edges may be, in small pictures [px]."""
CONVERGED = 0.1
"""Edges are measured once more where that moves their ends by more than this [px]."""
EDGE_REACH = 2.5
"""Distance from where the deck's turn puts an edge within which it is looked for at last [px]."""
MIN_FITTING_SHARE = 0.35
"""Share of the edges' points that must lie where one turn puts them."""
FIT_SCALE = 0.6
"""Distance that counts half [px]."""


@dataclass(slots=True)
class EdgeFollower:
    """Follows edges that turn as one about one point: the turn that puts most of them on steps of brightness."""

    end: DeckEnd
    view: Box
    """Part of the pictures that is looked at [px]."""
    doubt: dict[int, Array] = field(init=False, default_factory=dict)
    """How far each point of a frame may be off for what is beside it there [px], shape (N,), by the frame's number."""
    _turn: float = field(init=False, default=0.0)
    _lost: bool = field(init=False, default=True)

    @property
    def points(self) -> int:
        """Points along all edges; they show where they are across them only."""
        return PIECES * len(self.end.ends)

    def update(self, frame: Frame) -> Array | None:
        """Return the points of the edges [px], shape (N, 2), NaN where one is not seen; None where few are."""
        frame = frame.cut(self.view)
        centre = (self.end.pivot + frame.shift)[:, None]
        turn, shift = self._search(frame, centre)
        points, doubt, fits = np.zeros(0), np.zeros(0), np.zeros(self.points, bool)
        radius = float(np.abs(self.end.ends).max())
        for reach in (2 * EDGE_REACH, EDGE_REACH, EDGE_REACH):
            points, level, doubt = measured(self.end, frame, frame.shift, turn, shift, reach)
            off = level[..., 1] - self.end.ends[:, :1, 1] - self.end.bends - shift
            more, further, fits = _line(level[..., 0].ravel(), off.ravel())
            turn, shift = turn + more, shift + further
            if reach == EDGE_REACH and abs(further) + abs(more) * radius < CONVERGED:
                break
        self._lost = fits.mean() < MIN_FITTING_SHARE
        if self._lost:
            return None
        self._turn, self.doubt[frame.index] = turn, doubt.ravel()
        return points.reshape(-1, 2)

    def _search(self, frame: Frame, centre: Array) -> tuple[float, float]:
        """Turn and shift across the edges at which they show best."""
        scale = scale_of(self.view)
        unit = 1 / scale
        reach = MAX_TURN if self._lost else MAX_FRAME_TURN
        middle = 0.0 if self._lost else self._turn
        turn, shift = middle, 0.0
        place = centre[:, None] + turned(self.end.ends[:, :, None], middle + np.linspace(-reach, reach, 5))
        left, top = (place.min(axis=(0, 1, 2)) - MARGIN * unit).astype(int).tolist()
        right, bottom = (place.max(axis=(0, 1, 2)) + MARGIN * unit).astype(int).tolist()
        steps = steps_of(frame.cut((left, top, right, bottom)), scale)
        for width, count, astray in (
            (reach, 1 + round(2 * reach / TURN_STEP), MAX_SHIFT),
            (np.radians(1.5), 9, 1.5),
        ):
            turns = turn + np.linspace(-width, width, count)
            shifts = shift + unit * np.linspace(-astray, astray, 9)
            score = self._score(steps, centre, turns, shifts)
            score = score - 0.1 * score.max() * ((turns - middle) / reach)[:, None] ** 2
            best = np.unravel_index(int(np.argmax(score)), score.shape)
            turn, shift = float(turns[best[0]]), float(shifts[best[1]])
        return turn, shift

    def _score(self, steps: Steps, centre: Array, turns: Array, shifts: Array) -> Array:
        """How much of the edges a picture shows at some turns and shifts, shape (T, S)."""
        share = np.linspace(0.0, 1.0, EDGE_SAMPLES)[:, None]
        line = self.end.ends[:, None, 0] + share * (self.end.ends[:, 1] - self.end.ends[:, 0])[:, None]
        line[..., 1] += beside_line(self.end.bends, share[:, 0])
        moved = line + shifts[:, None, None, None] * [0.0, 1.0]  # (S, E, P, 2)
        every = turns[:, None, None, None]
        step = steps.across(centre + turned(moved, every), every)
        step = step.reshape(*step.shape[:3], EDGE_SAMPLES // AVERAGED_SAMPLES, AVERAGED_SAMPLES).mean(axis=4)
        length = self.end.ends[:, 1, 0] - self.end.ends[:, 0, 0]
        return np.minimum(np.abs(step), MAX_SLOPE).mean(axis=3) @ length


def _line(along: Array, off: Array) -> tuple[float, float, npt.NDArray[np.bool_]]:
    """Robust line through distances from where edges should be: its slope, its height, and which points are on it."""
    seen = np.isfinite(off)
    x, y = np.where(seen, along, 0.0), np.where(seen, off, 0.0)
    slope = height = 0.0
    rest = y
    for scale in (2.0, 1.0, FIT_SCALE, FIT_SCALE):
        weight = seen / (1 + (rest / scale) ** 2) ** 2 + 1e-9
        weight /= weight.sum()
        mean, level = weight @ x, weight @ y
        slope = float((weight * (x - mean)) @ y / (weight @ (x - mean) ** 2 + 1e-9))
        height = float(level - slope * mean)
        rest = y - slope * x - height
    return slope, height, np.asarray(seen & (np.abs(rest) < 2 * FIT_SCALE), np.bool_)
