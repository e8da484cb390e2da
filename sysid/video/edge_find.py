"""Edges across the deck, found all over a film, and what they turn about."""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.edge_slope import PARALLEL, normals, segments, sides_of, slope_of, still_there
from sysid.video.still_picture import camera_shift
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
        return pivot + (self.ends - pivot) @ rotation(self.turn)


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
    shift = np.eye(2) - np.array([rotation(-angle) for angle in turn])
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


def rotation(turn: float) -> Array:
    """Return the matrix that turns column vectors by an angle [rad], clockwise in a picture."""
    return np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
