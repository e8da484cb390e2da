"""The edges of the deck's end, and what they turn about: what stays where it is in pictures turned back.

Pictures are turned back by the slope of the lines in them, about a point. About the right one, the edges of the
deck's end coincide in all pictures; nothing else does, neither its long sides, which lead away from the camera, nor
the horizon.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.frames import Frame
from sysid.video.film.survey import Survey
from sysid.video.pose.pose import attitude_share
from sysid.video.trackers._edge_profile import PIECES, find_steps
from sysid.video.trackers.edge.body import fit_edges
from sysid.video.trackers.edge.brightness_steps import (
    ATTITUDE_STEP,
    MAX_SLOPE,
    Steps,
    leave_out_still,
    scale_of,
    steps_of,
    turned,
)
from sysid.video.trackers.edge.far_end import DeckEnd, with_far_end
from sysid.video.types import Box, Image, Mask, Rows

Grid = tuple[Array, Array]
"""Places across and down of a grid that turns with the deck, from its pivot [px]."""

MIN_LENGTH = 0.06
"""Shortest edge that is followed, as a share of the picture's width."""
MAX_EDGES = 4
"""Edges that are followed at most."""
STRAIGHT_LENGTH = 15
"""Length over which brightness must step alike, so that it is an edge rather than texture [px]."""
PIVOT_GRID = (9.0, 18.0)
"""How near to the pivot, across and down, pictures turned back begin to coincide, in small pictures [px]."""
GRID_ACROSS, GRID_DOWN = 3.0, 1.0
"""Steps of the grid that turns with the deck [px]."""
COARSER = 3
"""So many times coarser across is where only sharpness is judged [1]."""
CLEAR = 0.5
"""Share of the strongest from which on an edge tells the turn [1]."""
NEAR_TURNS = np.radians(np.linspace(-1.9, 1.9, 39))
"""Turns of a picture that are tried about the one that is known [rad]."""
MIN_STRENGTH = 0.2
"""Share of the best one's steps of brightness that an edge must show."""
TRIMMED_SHARE, BOX_MARGIN = 0.2, 0.4
"""Share of the steps of brightness that are left out at either end, and what is added again, in widths of the rest."""
MISSING_ATTITUDES = 0.35
"""Share of the attitudes in which an edge of the deck may be weaker than it counts: against a dark floor, say."""
MIN_ALONG_SHARE = 0.3
"""Share of what an edge shows at its best that it must show anywhere along it."""
MAX_TURN = np.radians(40.0)
"""Largest slope that is looked for [rad]."""
ALWAYS_THERE = 0.2
"""Quantile of the pictures that tells what lines are in nearly all of them: a share."""
HALF_RIDGE = 3
"""Half the width of the ridge that an edge is when all pictures are laid on each other, in steps of the grid."""
STRAIGHT_ON = np.array([0.0, 1e-6, 0.0])
"""What makes a ridge that is lost go on in its row."""
MIN_SPACING = 4
"""Distance of two edges [px]."""
MIN_CONTRAST = 8.0
"""Least contrast of an edge [grey levels]."""
LEARNED_WITHIN, LEAST_SHARE = np.radians([4.0, 8.0, 14.0, 22.0, 90.0, 90.0, 90.0]), 0.3
"""Turns from the usual one within which the edges are learned, round by round [rad], and share of the pictures that is taken at least."""
LEARNING_REACH = 3.0
"""Distance from where the edges are taken to be within which they are looked for then [px]."""
MAX_SPREAD, MIN_SEEN = 0.6, 0.4
"""A piece is of the edge if it is usually this near to where the body has it [px], in this share of the pictures or more."""
MIN_GOOD = 0.5
"""Share of an edge's pieces that must be of it."""
MAX_SLANT = np.radians(8.0)
"""Slope against level beyond which a ridge is no edge of the deck's end: the outline of a long side [rad]."""
MIDDLES = (np.arange(PIECES) + 0.5) / PIECES
"""Middles of the pieces, as shares of an edge's length."""


def find_deck_end(look: Survey) -> DeckEnd | None:
    """Return the edges of the deck's end in pictures of a film; None where there are none."""
    shifts = np.array([frame.shift - look.frames[0].shift for frame in look.frames])
    scale = scale_of(look.frames[0].box)
    every = [steps_of(frame, scale) for frame in look.frames]
    leave_out_still(every, shifts)
    slopes, width = _rough_slopes(every, look.kept), look.moving.shape[1]
    box = _usual_box(every, slopes, look.kept)
    if box is None or box[2] - box[0] < MIN_LENGTH * width:
        return None
    near = _found(look, every, shifts, slopes, box, anywhere=False)
    return near or _found(look, every, shifts, slopes, box, anywhere=True)


def _found(
    look: Survey, every: list[Steps], shifts: Array, turns: Array, box: tuple[float, float, float, float], *, anywhere: bool
) -> DeckEnd | None:  # fmt: skip
    """Return the edges in a box [px], by the rough turn of each picture [rad], shape (n,), or by that, of all, which shows most of what all have."""
    width, scale = look.moving.shape[1], every[0].scale
    left, top, right, bottom = box
    size = right - left
    unit = 1 / scale
    step = unit * np.array([GRID_ACROSS, GRID_DOWN])
    half = np.array([0.55, 0.2]) * size
    grid = _grid(half, step)
    pivot = np.array([left + right, top + bottom]) / 2
    reach = np.array([0.25 * size, 0.5 * (bottom - top)])
    steps = 2 * np.ceil(reach / (unit * np.array(PIVOT_GRID))).astype(int) + 1

    def shown_on(grid: Grid, *, signed: bool = False) -> Image:
        """How much of an edge each picture shows, turned back about the pivot."""
        each = zip(every, pivot + shifts, turns.tolist(), strict=True)
        shown = np.array([_shown(one, centre, turn, grid) for one, centre, turn in each])
        return shown if signed else np.abs(shown)

    for round_ in range(4):
        weight = np.sqrt(attitude_share(turns, ATTITUDE_STEP))
        weight /= weight.sum()
        sides = (np.linspace(-far, far, count) for far, count in zip(reach, steps, strict=True))
        tried = np.stack(np.meshgrid(*sides), -1).reshape(-1, 2)
        coarse = step * [COARSER, 1]
        aside = turned(tried[:, None], -turns) / coarse
        wide = _grid(half + coarse * (1 + np.ceil(np.abs(aside).max(axis=(0, 1)))), coarse)
        some = slice(None, None, 1 if round_ == 3 else 2)  # all of them at last
        pivot = pivot + tried[_sharpest(shown_on(wide)[some], weight[some], aside[:, some])]
        reach, steps = np.maximum(2 * reach / (steps - 1), unit), np.array([5, 5])
        turns = turns + _level(_mean(shown_on(grid), weight), np.radians(15.0 if round_ < 3 else 2.0))
        shown = shown_on(grid)
        mean = _mean(shown, weight)
        if round_ == 1 and anywhere:
            turns = np.array([
                _any_turn(one, centre, grid, mean) for one, centre in zip(every, pivot + shifts, strict=True)
            ])  # fmt: skip
            shown = shown_on(grid)
        turns = turns + _own_turns(shown, mean)
    shown = shown_on(grid, signed=True)
    means = {way: _in_most_attitudes(np.maximum(-way * shown, 0), turns) for way in (1, -1)}
    ends, bends, ways = _edges(means, *grid, MIN_LENGTH * width)
    if not len(ends):
        return None
    end = DeckEnd(np.tile(pivot, (len(ends), 1)), np.full(len(ends), np.inf), ends, ways, bends, turns)
    return _learned(end, every, look.frames, shifts)


def measured(
    end: DeckEnd, frame: Frame, shift: Array, turn: float, height: float, reach: float
) -> tuple[Array, Array, Array]:
    """Points of the edges in a frame where they are near a turn [rad] and height [px], both of shape (E, PIECES, 2) [px].

    In the picture, and from their pivots where the edges are level; NaN where there is none. And how far each may be off
    for what is beside it in this frame [px], shape (E, PIECES).
    """
    centre = (end.pivot + shift)[:, None]
    place = centre + turned(end.ends + np.array([0.0, height]), turn)
    steps, doubts = find_steps(frame, place, reach, MIN_CONTRAST, 1.0, (1, -1), end.bends)
    points, doubt = (np.where(end.ways[:, None, None] > 0, *one) for one in (steps, doubts[..., None]))
    return points, turned(points - centre, -turn), doubt[..., 0]


def _learned(end: DeckEnd, every: list[Steps], frames: Sequence[Frame], shifts: Array) -> DeckEnd | None:
    """Return the edges with the pivot and the shape that each shows in frames, from usual attitudes outwards; and that of the far end."""
    away = np.abs(end.turns - np.median(end.turns))
    for round_, far in enumerate(LEARNED_WITHIN):
        some = np.flatnonzero(away <= max(far, np.quantile(away, LEAST_SHARE)))
        end, good = _learn(end, frames, shifts, some)
        if not (kept := good.mean(axis=1) > MIN_GOOD).any():
            return None
        end = end.only(kept)
        if round_ == 1:
            end = with_far_end(end, every, shifts)
    return end


def _learn(end: DeckEnd, frames: Sequence[Frame], shifts: Array, some: Rows) -> tuple[DeckEnd, Mask]:
    """Return the edges as they are in some frames, and which pieces keep their place there, shape (E, PIECES)."""
    edge, turns = np.repeat(np.arange(len(end.ends)), PIECES), end.turns.copy()
    seen = [
        measured(end, frames[row], shifts[row], float(turns[row]), 0.0, LEARNING_REACH)[0] - shifts[row]
        for row in some
    ]
    x, y = np.moveaxis(np.array(seen).reshape(len(some), -1, 2), -1, 0)
    z = x + 1j * y
    body = fit_edges(z, edge, np.repeat(end.pivot[:, 0] + 1j * end.pivot[:, 1], PIECES))
    turns[some] = body.angle
    there = np.isfinite(z).mean(axis=0).reshape(-1, PIECES)
    good = (body.spread.reshape(-1, PIECES) < MAX_SPREAD) & (there > MIN_SEEN)
    own = body.pivot[::PIECES]
    pivot = np.stack([own.real, own.imag], axis=1)
    ends, bends = end.ends + (end.pivot - pivot)[:, None], end.bends.copy()
    for one, (height, use) in enumerate(zip(body.height.reshape(-1, PIECES), good, strict=True)):
        if use.any():
            level = float(np.median(height[use]))
            ends[one, :, 1] = level
            bends[one] = np.where(use, height - level, np.interp(MIDDLES, MIDDLES[use], height[use] - level))
    return replace(end, pivot=pivot, pivot_std=body.pivot_std, ends=ends, bends=bends, turns=turns), good


def _rough_slopes(every: list[Steps], box: Box) -> Array:
    """Slope of most of what steps across the pictures and moves [rad]: several edges of the deck are parallel, no long sides are."""
    edges = np.arange(-MAX_TURN, MAX_TURN, np.radians(0.5))
    counts: list[Array] = []
    for one in every:
        left, top, right, bottom = np.round((np.array(box) - one.corner * 2) * one.scale).astype(int)
        part = slice(max(top, 0), bottom), slice(max(left, 0), right)
        amount = one.amount[part]
        across, down = one.slopes[part][amount > 0].T
        slope = np.arctan2(-across * np.sign(down), np.abs(down))
        count, _ = np.histogram(
            slope, len(edges) - 1, (edges[0], edges[-1]), weights=np.minimum(amount[amount > 0], MAX_SLOPE)
        )
        counts.append(np.convolve(count, np.hanning(9), mode="same"))
    always = np.quantile(counts, ALWAYS_THERE, axis=0)  # the horizon, in a camera that shakes
    return edges[np.argmax(counts - always, axis=1)] + np.radians(0.25)


def _usual_box(every: list[Steps], slopes: Array, box: Box) -> tuple[float, float, float, float] | None:
    """Where brightness steps across the lines of the deck: a hand that passes widens the box of what moves.

    The horizon is as level as a deck at rest, so that pictures of a tilted one tell.
    """
    tilted = np.abs(slopes - np.median(slopes)) > 2 * ATTITUDE_STEP
    sides: list[Array] = []
    for one, turn in zip(every, slopes, strict=True):
        if tilted.sum() > 1 and not tilted[len(sides)]:
            sides.append(np.full(4, np.nan))
            continue
        left, top, right, bottom = np.round((np.array(box) - one.corner * 2) * one.scale).astype(int)
        beside, below = np.moveaxis(one.slopes[top:bottom, left:right], -1, 0)
        across = np.abs(np.cos(turn) * below - np.sin(turn) * beside)
        along = np.abs(np.cos(turn) * beside + np.sin(turn) * below)
        amount = (across > MAX_SLOPE / 2) & (along < ATTITUDE_STEP * across)
        if not amount.any():
            sides.append(np.full(4, np.nan))
            continue
        ends: list[float] = []
        for axis, begin in ((0, left), (1, top)):
            share = np.cumsum(amount.sum(axis=axis))
            low, high = np.searchsorted(share, share[-1] * np.array([TRIMMED_SHARE, 1 - TRIMMED_SHARE]))
            ends += [one.corner[axis] + (begin + edge) / one.scale for edge in (low, high)]
        sides.append(np.array(ends))
    if not np.isfinite(sides).all(axis=1).any():
        return None
    left, right, top, bottom = np.nanmedian(sides, axis=0)
    wide, high = BOX_MARGIN * (right - left), BOX_MARGIN * (bottom - top)
    return left - wide, top - high, right + wide, bottom + high


def _grid(half: Array, step: Array) -> Grid:
    """Return a grid about the pivot, as wide and high to either side and in such steps [px], both of shape (2,)."""
    across, down = (step[axis] * np.arange(-(n := round(half[axis] / step[axis])), n + 1) for axis in (0, 1))
    return across, down


def _shown(one: Steps, centre: Array, turn: float, grid: Grid) -> Image:
    """How much of an edge one picture shows at each place of the grid that turns with the deck."""
    x, y = grid
    step = one.on_grid(centre, x, y, turn)
    width = max(1, round(STRAIGHT_LENGTH / (one.scale * float(x[1] - x[0]))))
    return np.asarray(np.clip(cv2.blur(step, (width, 1)), -MAX_SLOPE, MAX_SLOPE), np.float32)


def _mean(pictures: Sequence[Image] | Image, weight: Array) -> Image:
    return np.asarray(np.tensordot(weight.astype(np.float32), pictures, 1), np.float32)


def _sharpest(shown: Image, weight: Array, aside: Array) -> int:
    """Return about which of m places n pictures, turned back, have the sharpest edges.

    Turned back about another place, a picture is the same one, shifted: by so many steps of the grid, shape (m, n, 2).
    """
    margin = np.ceil(np.abs(aside).max(axis=(0, 1))).astype(int) + 1
    columns, rows = np.array(shown.shape[:0:-1]) - 2 * margin
    score: list[float] = []
    for begins in aside + margin:
        mean: Image = np.zeros((rows, columns), np.float32)
        for one, w, (x, y) in zip(shown, weight.tolist(), begins.tolist(), strict=True):
            left, top = round(x), int(y)
            part = one[top : top + rows + 1, left : left + columns]
            mean += np.float32(w * (top + 1 - y)) * part[:-1]
            mean += np.float32(w * (y - top)) * part[1:]
        score.append(_sharpness(mean))
    return int(np.argmax(score))


def _in_most_attitudes(shown: Image, turns: Array) -> Image:
    """What shows of an edge in all attitudes but a few: the horizon does where the deck rests."""
    attitude = np.round(turns / (2 * ATTITUDE_STEP)).astype(int)
    each = [shown[attitude == one].mean(axis=0) for one in np.unique(attitude)]
    return np.quantile(each, MISSING_ATTITUDES, axis=0).astype(np.float32)


def _sharpness(mean: Image) -> float:
    """How straight and thin the edges are."""
    return float(np.sum(_ridges(mean).mean(axis=1) ** 2))


def _ridges(mean: Image) -> Image:
    """How much more of an edge there is than above and below."""
    beside = np.maximum(np.roll(mean, HALF_RIDGE, axis=0), np.roll(mean, -HALF_RIDGE, axis=0))
    ridge = np.maximum(mean - beside, np.float32(0))
    ridge[:HALF_RIDGE] = ridge[-HALF_RIDGE:] = 0.0
    return ridge


def _level(mean: Image, reach: float) -> float:
    """How much more all pictures are to be turned, so that the edges of their mean run along the grid [rad]."""
    rows, columns = np.indices(mean.shape)[:, :, ::COARSER]

    def best(tried: Array) -> float:
        score = [_sharpness(_turned_on([mean], rows, columns, turn)[0]) for turn in tried]
        return float(tried[int(np.argmax(score))])

    rough = best(np.linspace(-reach, reach, 21))
    return best(rough + np.linspace(-reach, reach, 21) / 10)


def _own_turns(shown: Image, mean: Image) -> Array:
    """How much more each of n pictures is to be turned to show most of the edges that all have [rad], shape (n,)."""
    rows, columns = np.nonzero(mean >= CLEAR * mean.max())
    score = _turned_on(shown, rows, columns, NEAR_TURNS[:, None]) @ mean[rows, columns]
    return NEAR_TURNS[np.argmax(score, axis=1)]


def _any_turn(one: Steps, centre: Array, grid: Grid, mean: Image) -> float:
    """The turn, of all, at which a picture shows most of the edges that all have [rad]."""
    (x, y), mean = grid, mean[:, ::COARSER]
    rows, columns = np.nonzero(mean >= CLEAR * mean.max())
    turns = np.arange(-MAX_TURN, MAX_TURN, np.radians(1.5))
    place = np.stack([x[::COARSER][columns], y[rows]], axis=1)
    step = one.across(centre + turned(place, turns[:, None]), turns[:, None])
    return float(turns[np.argmax(np.minimum(np.abs(step), MAX_SLOPE) @ mean[rows, columns])])


def _turned_on(shown: Sequence[Image] | Image, rows: Rows, columns: Rows, turn: Array | float) -> Image:
    """Return what n pictures on the grid show at some of its places, turned about its middle [rad], shape (n, ...).

    By cubics: straight lines would blur what they read between pixels, and so prefer no turn.
    """
    down, across = (np.array(shown[0].shape) - 1) / 2
    z = (GRID_ACROSS * (columns - across) + 1j * GRID_DOWN * (rows - down)) * np.exp(1j * turn)
    x, y = (z.real / GRID_ACROSS + across).astype(np.float32), (z.imag / GRID_DOWN + down).astype(np.float32)
    seen = [cv2.remap(one, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE) for one in shown]
    return np.array(seen, np.float32)


def _edges(means: dict[int, Image], x: Array, y: Array, shortest: float) -> tuple[Array, Array, Rows]:
    """Return the ridges of the mean pictures of either way in which brightness steps, concave as decks are.

    Left and right end of each, shape (E, 2, 2), how far below the line between them its pieces are, shape (E, PIECES), both in px,
    and the way, shape (E,).
    """
    ridges = {way: _ridges(mean) for way, mean in means.items()}
    usual = MIN_STRENGTH * max(ridge.mean(axis=1).max() for ridge in ridges.values())
    ends: list[Array] = []
    bends: list[Array] = []
    ways: list[int] = []
    for _ in range(2 * MAX_EDGES):
        way = max(ridges, key=lambda one: float(ridges[one].mean(axis=1).max()))
        ridge = ridges[way]
        strength = ridge.mean(axis=1)
        row = int(np.argmax(strength))
        if strength[row] < usual or len(ends) == MAX_EDGES:
            break
        rows, along = _traced(ridge, row)
        there = np.flatnonzero(along > MIN_ALONG_SHARE * np.quantile(along, 0.9))
        for column, at in enumerate(rows):
            ridge[max(0, at - MIN_SPACING) : at + MIN_SPACING + 1, column] = 0.0
        if len(there) < 2:
            continue
        a, b = np.quantile(there, [0.02, 0.98]).astype(int)
        if x[b] - x[a] < shortest:
            continue
        middles = x[a] + (x[b] - x[a]) * MIDDLES
        height = np.interp(middles, x[a : b + 1], y[rows[a : b + 1]])
        if abs(np.arctan(np.polyfit(middles, height, 1)[0])) > MAX_SLANT:
            continue
        level = float(height.mean())
        ends.append(np.array([[x[a], level], [x[b], level]]))
        bends.append(height - level)
        ways.append(way)
    return np.array(ends).reshape(-1, 2, 2), np.array(bends).reshape(-1, PIECES), np.array(ways, np.intp)


def _traced(ridge: Image, row: int) -> tuple[Rows, Image]:
    """Return in which row a ridge is in each column, from where it is highest in one on to both sides, and how high, both of shape (X,)."""
    begin = int(np.argmax(ridge[row]))
    rows = np.full(ridge.shape[1], row, np.intp)
    for way in (range(begin + 1, len(rows)), range(begin - 1, -1, -1)):
        at = row
        for column in way:
            near = ridge[at - 1 : at + 2, column]
            at = min(max(at - 1 + int(np.argmax(near + STRAIGHT_ON)), 1), len(ridge) - 2)
            rows[column] = at
    return rows, ridge[rows, np.arange(len(rows))]
