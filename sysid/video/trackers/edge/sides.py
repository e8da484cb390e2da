"""Where a deck's axis vanishes: its long sides run towards that place at any attitude.

A line along the axis of a turning body keeps its direction. So in pictures it runs through one and the same place, wherever on the
body it lies and however that is turned; the middle of the picture would be there if the camera looked along the axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.trackers.edge.brightness_steps import ATTITUDE_STEP, MAX_SLOPE, Steps, turned
from sysid.video.types import Mask, Rows

OWN = np.radians(8.0)
"""Lines nearer than this to the direction of the deck's end are its own [rad]."""
NEAR_CORNER = 0.08
"""How near to a corner of the deck's end the line of a side runs, as a share of the end's length."""
CELL, ALWAYS = 3.0, 0.7
"""What steps in the same place, so many pixels of the small pictures wide, in more than this share of the attitudes stands still, though
the board hid it in some."""
REACH, COUNT = 0.35, 29
"""How far beside the picture's middle the place is looked for, in longer sides of the picture (20 degrees), and tries across [1]."""
CANDIDATES = 6
"""Places that are looked at closely."""
ALIKE = 3
"""Pictures of one attitude that are looked at: a deck at rest shows nothing else again and again."""
MAX_STEPS = 6000
"""Steps of brightness that are used at most."""
WIDTHS = np.radians([3.0, 3.0, 2.0, 2.0, 2.0, 2.0])
"""Angles by which lines that count half miss the place, round by round [rad]."""
MOST_ATTITUDES = 0.35
"""Quantile of the attitudes, as a share of them, that tells how many lines run to a place in most of them."""
MIN_LINES, MIN_MOST = 6.0, 0.5
"""Steps a picture, of each side, that must run there in most attitudes, and as a share of those in the best one: wheels and a
horizon that shakes agree on a place in some attitudes only."""
LEAD = 2.0
"""How many times as many run there as, of all others, to any one place: eleven films of long sides show 2.4 or more, eight without them
up to 1.6."""


@dataclass(frozen=True, slots=True)
class Lines:
    """Steps of brightness that may be a long side's, in all pictures."""

    place: Array
    """Where they are [px], shape (m, 2)."""
    normal: Array
    """Directions across them [1], shape (m, 2)."""
    group: Rows
    """Twice the number of the attitude in which each is seen, and 1 more at the right side, shape (m,)."""
    pictures: Array
    """Pictures of each attitude, less those that were left out [1], shape (A,)."""
    near: float
    """Distance below which no direction is told [px]."""

    def missed(self, there: Array) -> tuple[Array, Array]:
        """Return by what angle lines miss a place (2,) [rad], and how far away it is [px], both of shape (m,)."""
        way = there - self.place
        away = np.maximum(np.hypot(*way.T), 1e-9)
        return (self.normal * way).sum(axis=1) / away, away

    def trust(self, there: Array, width: float) -> Array:
        """Return how well lines run to a place (2,) [px], from 0 to 1: half where they miss it by about `width` [rad]; shape (m,)."""
        angle, away = self.missed(there)
        return (away > self.near) / (1 + (angle / width) ** 2) ** 2

    def mean(self, values: Array) -> Array:
        """Return sums of values (m,) [1] over what a picture shows of the left and right side in each attitude, shape (A, 2)."""
        both = np.bincount(self.group, values, minlength=2 * len(self.pictures))
        return both.reshape(-1, 2) / self.pictures[:, None]

    def both(self, there: Array, width: float, of: Array | float = 1.0) -> Array:
        """Return how many lines of both sides, weighted by `of` (m,), run to a place (2,) [px] in each attitude, shape (A,)."""
        return np.sqrt(self.mean(of * self.trust(there, width)).prod(axis=1))

    def nearer(self, there: Array, width: float) -> Array:
        """Return the place [px] to which those lines run best that run about there, shape (2,)."""
        weight = (
            self.trust(there, width)
            / self.pictures[self.group // 2]
            / np.maximum(self.missed(there)[1], 1.0) ** 2
        )
        weighed = self.normal * weight[:, None]
        pull = weighed.T @ (self.normal * (self.place - there)).sum(axis=1)
        return there + np.linalg.solve(weighed.T @ self.normal + 1e-12 * np.eye(2), pull)


def axis_vanishes_at(
    every: Sequence[Steps], pivots: Array, ends: Array, turns: Array, size: Array
) -> Array | None:
    """Return the place that the deck's long sides run to [px], shape (2,); None where they do not show.

    Args:
        every: Steps of brightness in n pictures, without those that stand still.
        pivots: What the deck's end turns about in each [px], shape (n, 2).
        ends: Left and right end of its edges when they are level [px], from the pivot, shape (E, 2, 2).
        turns: Slope of the edges in each picture [rad], shape (n,).
        size: Width and height of the film [px], shape (2,).
    """
    lines = _lines(every, pivots, ends, turns)
    if len(lines.place) < MIN_LINES * len(every):
        return None
    sides = REACH * float(size.max()) * np.linspace(-1, 1, COUNT)
    tried = (size - 1) / 2 + np.stack(np.meshgrid(sides, sides), -1)
    few = replace(lines, place=lines.place[::3], normal=lines.normal[::3], group=lines.group[::3])
    score = np.array(
        [[np.sqrt(few.both(there, WIDTHS[0])).mean() for there in row] for row in tried], np.float32
    )
    tops = np.where(score == cv2.dilate(score, np.ones((3, 3))), score, 0).ravel()
    places = tried.reshape(-1, 2)[np.argsort(-tops)[:CANDIDATES]]
    for width in WIDTHS:
        places = np.array([lines.nearer(there, width) for there in places])
    both = np.array([lines.both(there, WIDTHS[-1]) for there in places])
    shown = np.quantile(both, MOST_ATTITUDES, axis=1)
    best = int(np.argmax(shown))
    others = 1 - lines.trust(places[best], WIDTHS[-1])
    rival = max(np.quantile(lines.both(there, WIDTHS[-1], others), MOST_ATTITUDES) for there in places)
    least = max(MIN_LINES, MIN_MOST * float(both[best].max()), LEAD * float(rival))
    return None if shown[best] < least else places[best]


def _lines(every: Sequence[Steps], pivots: Array, ends: Array, turns: Array) -> Lines:
    """Return the steps of brightness whose lines run past a corner of the deck's end; all else as in `axis_vanishes_at`."""
    _, attitude = np.unique(np.round(turns / ATTITUDE_STEP), return_inverse=True)
    some = np.concatenate([np.flatnonzero(attitude == one)[:ALIKE] for one in range(attitude.max() + 1)])
    pictures = np.bincount(attitude[some])
    found = [every[row].steepest(MAX_SLOPE / 2) for row in some]
    row = np.repeat(some, [len(place) for place, _ in found])
    place, normal = (np.concatenate(each) for each in zip(*found, strict=True))
    place, turn = place - pivots[row], turns[row]
    still = _in_most(np.floor(place * every[0].scale / CELL), attitude[row], len(pictures))
    near = NEAR_CORNER * float(np.ptp(ends[..., 0]))
    own = np.abs(normal[:, 1] * np.cos(turn) - normal[:, 0] * np.sin(turn)) > np.cos(OWN)
    way = turned(ends[:, :, None], turn) - place
    past = (np.abs((way * normal).sum(axis=-1)) < near) & (np.hypot(way[..., 0], way[..., 1]) > 1.5 * near)
    side, which = np.nonzero(past.any(axis=0) & ~own & ~still)
    thinned = 1 + len(which) // MAX_STEPS
    side, which = side[::thinned], which[::thinned]
    group = 2 * attitude[row[which]] + side
    return Lines(place[which] + pivots[0], normal[which], group, pictures / thinned, near)


def _in_most(cell: Array, attitude: Rows, attitudes: int) -> Mask:
    """Return of which of m steps of brightness the cell, shape (m, 2) [1], holds one in most attitudes."""
    if not len(cell):
        return np.zeros(0, np.bool_)
    column, row = (cell - cell.min(axis=0)).astype(int).T
    code = column + (column.max() + 1) * row
    steps = np.bincount(attitudes * code + attitude, minlength=attitudes * (code.max() + 1))
    return np.asarray((steps.reshape(-1, attitudes) > 0).mean(axis=1)[code] > ALWAYS, np.bool_)
