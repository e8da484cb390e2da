"""The angle that several parallel edges agree on, and how well they do."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from sysid.roll import Array
from sysid.video.rectify import longer, rectify, smear, unwrap
from sysid.video.turning import Turning
from sysid.video.unknowns import Unknowns, spread_by
from sysid.video.view import View

ELSEWHERE = 6.0
"""Distance from where the axis puts it that makes a line another one, in standard deviations (and 1 px)."""
OFF = 4.0
"""An edge so many standard deviations from what the others say counts little in that frame."""
BIAS = 0.15
"""What shade, background and compression may shift one half of an edge by against the other [px]: it is the
same as long as the deck stands still, so that no profile across the edge shows it."""
CONTRADICTION = np.radians(1.0)
"""Two edges that are further apart than this, and by more than their noise, are not both the deck's."""
TRUSTED = 0.8
"""Share of the attitudes in which an edge must agree with the others to be believed: the deck's long side, or
what bounds it as seen from aside, turns as its ends do in some only."""
ATTITUDES = 0.15
"""Share of the whole range of turns over which an edge must be seen; a line of the background is not."""
PARALLEL = np.radians(0.7)
"""What edges of a deck may lack in being parallel, as seen along its axis: the cut, and what is not known of
perspective. A line that is further off is none of them, as far as it goes."""
ONE_LINE = 4.0
"""Distance at which two edges are parts of one line [px]."""
ASIDE = np.radians(10.0)
"""From further aside, the outline of the deck's long side lies along that of its end when it is level, and parts
from it when it is tilted. No picture tells which of the two an edge is a part of."""
OUTLINE = np.radians(2.0)
"""How far the two may part and still be taken for one."""
SHARP = np.radians(0.7)
"""Deviation of a direction up to which it is a witness."""
ROUGH = np.radians(1.5)
"""How far the slope of most lines in a picture may be off."""
BINS = 8
"""Attitudes that are told apart, over the range of an edge that is seen over most."""
ROUNDS = 12


def fit_direction(
    view: View,
    matrix: Array,
    before: Unknowns,
    *,
    deviations: Sequence[Array],
    slopes: Array,
) -> Turning:
    """Common turn of edges as seen along the axis.

    Lines across the axis show neither its direction nor focal length nor read-out: they stay as they are
    known beforehand.

    Args:
        view: Both ends of each edge, one after the other.
        matrix: Camera matrix [px], shape (3, 3).
        before: What is known of camera and lens.
        deviations: Standard deviation of each edge's direction in each frame [rad], n times (E,).
        slopes: Rough slope of the lines across the deck in each frame of the film [rad].
    """
    deviation = np.array(deviations)
    points = view.all_points(before.readout)
    for edge in range(deviation.shape[1]):
        deviation[elsewhere(points[:, 2 * edge : 2 * edge + 2]), edge] = np.nan
    length = np.nanmedian(np.linalg.norm(points[:, 1::2] - points[:, ::2], axis=2), axis=0)
    deviation = np.hypot(deviation, BIAS * np.sqrt(12) / (2 * length))
    first = _directions(view, matrix, before.value)
    common = agree(first, deviation, line_numbers(points))

    def angle_at(value: Array) -> Array:
        return _mean(_directions(view, matrix, value) - common.offset, common.weight)

    angle = angle_at(before.value)
    unknown = spread_by(before, angle, angle_at, view.share, view.time(before.readout))
    std = np.sqrt(common.variance + smear(angle) ** 2 + unknown)
    if abs(before.value[0]) > ASIDE:
        std = np.hypot(std, OUTLINE / np.sqrt(3))
    wrong = ~np.isfinite(common.variance) | _astray(angle, slopes[view.track.index])
    angle = np.where(wrong, np.nan, angle)
    outliers = int((np.isfinite(first).any(axis=1) & ~np.isfinite(angle)).sum())
    return Turning(
        unwrap(angle),
        np.where(np.isfinite(angle), std, np.nan),
        before,
        float(np.nanmedian(deviation)),
        outliers,
        np.array([1 + 0j]),
    )


class Agreement:
    """How edges make one turn: weights, offsets and what is left open."""

    def __init__(self, offset: Array, weight: Array, variance: Array) -> None:
        """Hold each edge's direction at angle zero (E,), weights (n, E), and the variance of the turn (n,)."""
        self.offset, self.weight, self.variance = offset, weight, variance


def agree(direction: Array, deviation: Array, lines: npt.NDArray[np.intp]) -> Agreement:
    """Find the turn of parallel edges, ignoring those that turn otherwise.

    Args:
        direction: Direction of each edge in each frame [rad], shape (n, E); NaN where it is not seen.
        deviation: Its standard deviation, the same shape.
        lines: Number of the line that each edge is a part of, shape (E,).

    Returns:
        The agreement; its variance is infinite where edges contradict each other, or none is seen.
    """
    count = direction.shape[1]
    seen = np.isfinite(direction) & np.isfinite(deviation)
    angle = np.where(seen, direction, 0.0)
    variance = np.where(seen, deviation, 1.0) ** 2
    # One that is sharp is not judged by those that are not.
    sharp = seen & (deviation < SHARP)
    seen = np.where(sharp.any(axis=1, keepdims=True), sharp, seen)
    spans = np.array([_span(angle[here, edge]) for edge, here in enumerate(seen.T)])
    if spans.max() > CONTRADICTION:  # what is seen in one attitude only is no part of the deck, but behind it
        seen &= spans > ATTITUDES * spans.max()
    lead = int(np.argmax(np.where(seen, 1 / variance, 0).sum(axis=0)))
    # The brighter side of one edge is the darker one of the next, so that they may point against each other.
    flip = np.zeros(count)
    for edge in range(count):
        both = seen[:, lead] & seen[:, edge]
        opposite = (
            both.any() and np.median(np.abs(_wrapped(angle[both, edge] - angle[both, lead]))) > np.pi / 2
        )
        flip[edge] = np.pi if opposite else 0.0
    angle = angle - flip
    offset = np.zeros(count)
    # Parts of one line err alike, so that they count as one.
    alike = lines[:, None] == lines
    parts = np.maximum(seen @ alike.astype(np.float64), 1.0)
    votes = (seen / parts).sum(axis=1, keepdims=True)
    told = seen & (votes > 1.5)
    off, mean = np.zeros(direction.shape), np.zeros(len(direction))
    for _ in range(ROUNDS):
        mean = _middle_line(np.where(seen, angle - offset, np.nan), 1 / variance, lines)
        off = np.where(seen, _wrapped(angle - offset - mean[:, None]), 0.0)
        for edge in range(count):
            if told[:, edge].sum() > 5:
                offset[edge] += float(np.median(off[told[:, edge], edge]))
        offset = np.clip(offset - np.median(offset), -PARALLEL, PARALLEL)
    # Against a middle that it is itself a part of, an edge is less far off than it is wrong.
    square = off**2 * votes / np.maximum(votes - 1, 0.5)
    attitude = np.round(unwrap(mean) / max(float(spans.max()) / BINS, 1e-6))
    own = np.stack(
        [_bias(square[:, edge], variance[:, edge], attitude, told[:, edge]) for edge in range(count)], axis=1
    )
    trusted = (
        np.array([_borne_out(square[:, edge], attitude, told[:, edge]) for edge in range(count)]) >= TRUSTED
    )
    if trusted.any():
        seen = seen & trusted
    total = variance + own
    against = seen & (square > CONTRADICTION**2) & (square > OFF**2 * total)
    weight = np.where(against, 0.0, seen / parts / total)
    left = weight.sum(axis=1)
    # Of two that contradict each other neither is to be believed; of three or more the odd one out is not.
    votes, doubts = ((weight > 0) / parts).sum(axis=1), (against / parts).sum(axis=1)
    scatter = (weight * off**2).sum(axis=1) / np.maximum(votes - 1, 1)
    doubt = np.maximum(1.0, np.where(votes > 1.5, scatter, 1.0))
    good = (left > 0) & (votes > doubts)
    return Agreement(offset + flip, weight, np.where(good, doubt / np.maximum(left, 1e-30), np.inf))


def line_numbers(points: Array) -> npt.NDArray[np.intp]:
    """Number the lines that edges lie on in most frames, shape (E,).

    Args:
        points: Both ends of each edge, one after the other [px], shape (n, 2E, 2); NaN where not seen.
    """
    ends = points.reshape(len(points), -1, 2, 2)
    along = ends[:, :, 1] - ends[:, :, 0]
    length = np.linalg.norm(along, axis=2)
    normal = np.stack([along[..., 1], -along[..., 0]], axis=2) / length[..., None]
    middle = ends.mean(axis=2)
    number = np.arange(ends.shape[1])
    for edge in range(len(number)):
        for other in range(edge):
            apart = np.abs(np.sum((middle[:, edge] - middle[:, other]) * normal[:, other], axis=1))
            apart = apart[np.isfinite(apart)]
            if len(apart) and np.median(apart) < ONE_LINE:
                number[edge] = number[other]
                break
    return number


def elsewhere(points: Array) -> npt.NDArray[np.bool_]:
    """Frames in which another line was taken for an edge, which keeps its distance from the axis.

    For lines n·x = c that turn about p at the distance h, c = n·p + h; p and h by reweighted least squares.

    Args:
        points: Both ends of one edge [px], shape (n, 2, 2).
    """
    along = points[:, 1] - points[:, 0]
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    place = np.sum(normal * points.mean(axis=1), axis=1)
    seen = np.isfinite(place)
    design = np.column_stack([normal, np.ones(len(normal))])[seen]
    weight = np.ones(len(design))
    off, limit = np.zeros(len(design)), np.inf
    for _ in range(10 if len(design) else 0):
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


def _astray(angle: Array, slope: Array) -> npt.NDArray[np.bool_]:
    """Frames in which the edges followed turn otherwise than most lines in the picture, in sum over the film."""
    apart = _wrapped(2 * (angle - slope)) / 2  # a line has no first end
    seen = np.isfinite(apart)
    apart = np.where(seen, apart - np.median(apart[seen]), 0.0)
    spread = 1.4826 * float(np.median(np.abs(apart[seen])))
    return np.abs(apart) > np.maximum(ROUGH, OFF * spread)


def _directions(view: View, matrix: Array, value: Array) -> Array:
    z = rectify(view.all_points(value[3]), longer(matrix, value[2]), value[0], value[1])
    return np.angle(z[:, 1::2] - z[:, ::2])


def _bias(square: Array, variance: Array, attitude: Array, told: npt.NDArray[np.bool_]) -> Array:
    """What an edge errs by beyond its noise, by attitude [rad²], shape (n,).

    As the deck turns, another side of it or another background may come to bound an edge. Where nothing was
    there to compare it with, it may err as it does where it errs most.
    """
    bias = np.full(len(square), np.nan)
    for one in np.unique(attitude[told]):
        here = attitude == one
        if (here & told).sum() > 2:
            # 0.455: the median of the square of a normal deviate.
            bias[here] = max(
                float(np.median(square[here & told])) / 0.455 - float(np.median(variance[here & told])), 0.0
            )
    known = np.isfinite(bias)
    return np.where(known, bias, bias[known].max() if known.any() else 0.0)


def _middle_line(angle: Array, weight: Array, lines: npt.NDArray[np.intp]) -> Array:
    """Median over lines of the angles of their parts (n, E), shape (n,): no two of three can be outvoted by one.

    Between two lines it is the middle, as nothing says which is right.
    """
    rough = _mean(angle, np.ones(angle.shape))
    apart = _wrapped(angle - rough[:, None])
    each: list[Array] = []
    for line in np.unique(lines):
        part = np.where(np.isfinite(apart) & (lines == line), weight, 0.0)
        total = part.sum(axis=1)
        value = (part * np.nan_to_num(apart)).sum(axis=1) / np.maximum(total, 1e-30)
        each.append(np.where(total > 0, value, np.nan))
    ordered = np.sort(np.array(each), axis=0)
    count = np.isfinite(ordered).sum(axis=0)
    column = np.arange(len(rough))
    low = ordered[np.maximum(count - 1, 0) // 2, column]
    high = ordered[np.minimum(count // 2, len(each) - 1), column]
    return rough + (low + high) / 2  # NaN is sorted last, and where there is nothing else


def _borne_out(square: Array, attitude: Array, told: npt.NDArray[np.bool_]) -> float:
    """Share of the attitudes in which an edge agrees with others; 1 where there are none to compare it with."""
    agrees = [
        float(np.median(square[here])) < CONTRADICTION**2
        for one in np.unique(attitude[told])
        if (here := (attitude == one) & told).sum() > 2
    ]
    return float(np.mean(agrees)) if agrees else 1.0


def _span(angle: Array) -> float:
    """Range of most of the directions of one edge [rad]."""
    if len(angle) < 2:
        return 0.0
    turned = _wrapped(angle - angle[0])
    return float(np.quantile(turned, 0.98) - np.quantile(turned, 0.02))


def _mean(angle: Array, weight: Array) -> Array:
    """Weighted mean of angles (n, E), ignoring NaN; NaN where nothing has weight."""
    weight = np.where(np.isfinite(angle), weight, 0.0)
    total = np.sum(weight * np.exp(1j * np.where(np.isfinite(angle), angle, 0.0)), axis=1)
    return np.where(weight.sum(axis=1) > 0, np.angle(total), np.nan)


def _wrapped(angle: Array) -> Array:
    return np.angle(np.exp(1j * angle))
