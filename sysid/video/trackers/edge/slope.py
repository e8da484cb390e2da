"""How far the deck has turned in every frame, roughly: the slope of the lines across it, over the whole film.

In nearly every frame several lines of the deck are parallel, as no long side of it is; where that fails for a
frame or two, the film before and after says which slope is the deck's.
"""

from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from sysid.roll import Array
from sysid.video.film.frames import Frame
from sysid.video.film.survey import Survey
from sysid.video.types import Box

MIN_LENGTH = 0.03
"""Shortest line that counts, as a share of the picture's width."""
MAX_SLOPE = np.radians(50)
"""A line steeper than this is not across the deck [rad]."""
PARALLEL_WITHIN = np.radians(2.0)
"""Lines across the deck differ by less than this in direction, for perspective [rad]."""
UNPAIRED_SHARE = 0.5
"""Share of a line's score that counts only where others are parallel to it."""
MAX_CONTRAST = 60.0
"""Contrast beyond which more is no better [grey levels]."""
COMPARED_PICTURES = 16
"""Pictures that lines are looked for in, to tell those of the background."""
FULLY_MOVED_SHARE, MIN_MOVED_WEIGHT = 0.5, 0.2
"""Share of the pictures in which a line must be gone to count fully, and what one counts at least that is gone in
few: a deck that rests for most of a film."""
STATIC_SHARE, STATIC_WEIGHT = 0.92, 0.03
"""Share of the pictures in which a line is that never moves, though a hand may pass; what it counts."""
MAX_SHAKE = 4
"""Shift of the picture up to which a still line is known again [px]."""
SIDE_DISTANCE = 2.0
"""Distance from a line at which brightness is read on its two sides [px]."""
CANDIDATES = 5
"""Slopes that are weighed for each frame."""
SLOPE_STEP = np.radians(6.0)
"""Change of slope from frame to frame that costs as much as a slope without any line gains [rad]."""
UNSEEN_GAIN = 0.3
"""Share of what the best slope in a frame gains, that the frame gains whose lines are left aside."""


def deck_slopes(frames: Sequence[Frame], look: Survey) -> Array:
    """Return the slope of the lines across the deck in each frame of a survey [rad], shape (n,).

    The path through all frames with the most and longest parallel lines and the least jumps
    (Viterbi's algorithm).
    """
    slopes: list[Array] = []
    scores: list[Array] = []
    others = [frame.dark() for frame in look.frames[:: max(1, len(look.frames) // COMPARED_PICTURES)]]
    for frame in frames:
        slope, score = _candidates(frame.dark(), look, others)
        slopes.append(slope)
        scores.append(score)
    rows = {frame.index: row for row, frame in enumerate(frames)}
    return best_path(np.array(slopes), np.array(scores))[[rows[frame.index] for frame in look.frames]]


def best_path(slope: Array, score: Array) -> Array:
    """Return the slope of each frame along the best path.

    Args:
        slope: Candidates for each frame [rad], shape (n, m); NaN where there is none.
        score: How good they are, from 0 to 1.

    Returns:
        Shape (n,): the candidate, or, where none is on the path, the last one that was.
    """
    n, m = slope.shape
    seen = np.isfinite(slope)
    # One state more for each candidate of the frame before: going on with its slope, unseen.
    state = np.zeros((n, 2 * m))
    total = np.zeros((n, 2 * m))
    before = np.zeros((n, 2 * m), int)
    state[0] = np.concatenate([np.where(seen[0], slope[0], 0.0)] * 2)
    total[0] = np.concatenate([np.where(seen[0], score[0], -1e9), np.full(m, -1e8)])
    for row in range(1, n):
        here = np.where(seen[row], slope[row], 0.0)
        cost = ((here[:, None] - state[row - 1]) / SLOPE_STEP) ** 2
        gain = total[row - 1] - np.minimum(cost, 25.0)
        before[row, :m] = np.argmax(gain, axis=1)
        total[row, :m] = np.where(seen[row], score[row] + gain.max(axis=1), -1e9)
        state[row, :m] = here
        last = np.argsort(-total[row - 1])[:m]
        before[row, m:], state[row, m:] = last, state[row - 1, last]
        total[row, m:] = total[row - 1, last] + UNSEEN_GAIN
    path = np.zeros(n, int)
    path[-1] = int(np.argmax(total[-1]))
    for row in range(n - 1, 0, -1):
        path[row - 1] = before[row, path[row]]
    return state[np.arange(n), path]


def segments(frame: Frame, box: Box, shortest: float) -> Array:
    """Return straight lines within a box that are not too steep, shape (m, 2, 2) [px]."""
    part, corner = frame.part(box)
    found: Any = cv2.createLineSegmentDetector().detect(cv2.GaussianBlur(part, (0, 0), 1.0))[0]
    if found is None:
        return np.zeros((0, 2, 2))
    ends = np.asarray(found, np.float64).reshape(-1, 2, 2) + corner
    along = ends[:, 1] - ends[:, 0]
    good = (np.linalg.norm(along, axis=1) > shortest) & (np.abs(slope_of(ends)) < MAX_SLOPE)
    return ends[good]


def slope_of(ends: Array) -> Array:
    """Direction of lines (m, 2, 2), whichever end comes first, from -pi/2 to pi/2 [rad], shape (m,)."""
    along = ends[..., 1, :] - ends[..., 0, :]
    with np.errstate(divide="ignore"):
        return np.arctan(along[..., 1] / along[..., 0])


def parallel_to(slope: Array, score: Array) -> tuple[npt.NDArray[np.bool_], Array]:
    """For each line: which are parallel to it, shape (m, m), and how much they count together, shape (m,).

    What several lines agree on counts, rather than one long one: a long side of the deck.

    Args:
        slope: Slope of each line [rad], shape (m,).
        score: How much each counts alone, in any unit, shape (m,).
    """
    parallel = np.abs(slope[:, None] - slope) < PARALLEL_WITHIN
    return parallel, parallel @ score - UNPAIRED_SHARE * np.max(parallel * score, axis=1, initial=0.0)


def still_there(contrast: Array, ends: Array, others: Sequence[Frame]) -> Array:
    """Tell whether lines of one picture are where they were in others, shape (k, m).

    Args:
        contrast: Difference of brightness across each [grey levels], shape (m,).
        ends: Their ends, freed of the camera's shake [px], shape (m, 2, 2).
        others: Frames in grey.
    """
    normal = normals(ends)
    reach = np.arange(-MAX_SHAKE, MAX_SHAKE + 0.5)
    moved = (ends[:, None] + reach[None, :, None, None] * normal[:, None, None]).reshape(-1, 2, 2)
    there: list[Array] = []
    for other in others:
        # Here the mean: a median jumps where the line crosses another edge in its middle.
        sides = sides_of(other, moved + other.shift, middle=np.mean)
        step = np.abs(sides[:, 0] - sides[:, 1]).reshape(len(ends), -1).max(axis=1)
        there.append(step > 0.6 * np.abs(contrast))
    return np.array(there).reshape(len(others), len(ends))


def normals(ends: Array) -> Array:
    """Unit vectors (m, 2) to the left of lines (m, 2, 2) [px] in the picture, walking from first to second end."""
    along = ends[:, 1] - ends[:, 0]
    return np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)


def sides_of(frame: Frame, ends: Array, middle: Callable[..., Array] = np.median) -> Array:
    """Brightness on both sides of each line of `ends` (m, 2, 2) [grey levels], shape (m, 2)."""
    share = np.linspace(0.08, 0.92, 36)[None, :, None]
    line = ends[:, None, 0] + share * (ends[:, None, 1] - ends[:, None, 0]) - frame.corner
    normal = normals(ends)
    places = [(line + side * SIDE_DISTANCE * normal[:, None]).astype(np.float32) for side in (1, -1)]
    seen = [
        cv2.remap(
            frame.picture, place[..., 0], place[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        for place in places
    ]
    # The median along the line, so that something in front of a part of it does no harm.
    return np.stack([middle(side.astype(np.float64), axis=1) for side in seen], axis=1)


def _candidates(frame: Frame, look: Survey, others: Sequence[Frame]) -> tuple[Array, Array]:
    slopes, scores = np.full(CANDIDATES, np.nan), np.zeros(CANDIDATES)
    ends = segments(frame, look.box, MIN_LENGTH * look.moving.shape[1])
    if not len(ends):
        return slopes, scores
    step = np.abs(np.subtract(*sides_of(frame, ends).T))
    still = still_there(step, ends - frame.shift, others).mean(axis=0)
    score = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) * np.minimum(step, MAX_CONTRAST)
    share = np.where(
        still > STATIC_SHARE, STATIC_WEIGHT, np.clip((1 - still) / FULLY_MOVED_SHARE, MIN_MOVED_WEIGHT, 1.0)
    )
    score = score * _moving(look, ends) * share
    slope = slope_of(ends)
    parallel, together = parallel_to(slope, score)
    best = max(float(together.max()), 1e-9)
    for number in range(CANDIDATES):
        one = int(np.argmax(together))
        if together[one] <= 0:
            break
        slopes[number] = np.average(slope[parallel[one]], weights=score[parallel[one]] + 1e-9)
        scores[number] = together[one] / best
        together = np.where(parallel[one], 0.0, together)
    return slopes, scores


def _moving(look: Survey, ends: Array) -> Array:
    """Share of each line that lies where something moves, shape (m,)."""
    share = np.linspace(0.1, 0.9, 20)[None, :, None]
    places = np.round(ends[:, None, 0] + share * (ends[:, None, 1] - ends[:, None, 0])).astype(int)
    inside = np.clip(places, 0, np.array(look.moving.shape[::-1]) - 1)
    return np.asarray(look.moving[inside[..., 1], inside[..., 0]].mean(axis=1), np.float64)
