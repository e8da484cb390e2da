"""Edges of a body that turns about an axis: their points show where they are across the edge only.

In the picture of a camera along the axis, a point of an edge lies at

    Im(exp(-i φ) (z - q)) = h + s + c

where φ is the turn, q what the body turns about, h the edge's distance from there at that place along it, s a shift of the
whole body and c one of its edge. Every place has one h, whatever the turn: that tells the points of the deck's edges from
those that something else has lent them, the outline of a long side or a wheel. Points slide along their edge as the deck
turns, the more, the less well q was known when they were taken: of a concave deck's edge h changes on the way.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sysid.roll import Array
from sysid.video.pose.pose import attitude_share
from sysid.video.types import Complex

Edge = npt.NDArray[np.intp]
POINT_FLOOR = 0.05
"""Least standard deviation of a point [px]."""
POINT_STD = 0.2
"""Usual error of a point [px]."""
SHIFT_STD = 0.7
"""Standard deviation of what shake and soft trucks shift the body by [px]."""
EDGE_SHIFT_STD = 0.3
"""Standard deviation of what shade and compression shift one edge by [px]."""
PIVOT_SHARE = 0.15
"""Standard deviation of where the pivot is taken to be, in lengths of the longest edge [1]."""
ATTITUDE_BINS = 12
"""Attitudes that count alike, over the range of turns, when the body is learned."""
LEAST_SPREADS = (1.0, 1.0, 0.75, 0.5, 0.35, 0.25, 0.2, 0.2, 0.2, 0.2)
"""Usual distance of a point from where the body has it that is not told from a smaller one, round by round [px]: what compression and
shade do to an edge is common to its points."""
SHAPE_ROUNDS = 8
"""Times that the parabola of an edge is drawn, each time with less trust in what is beside it: a piece of another edge."""
OUTLYING = 2.5
"""Distance at which points count half, in their usual one [1]."""


@dataclass(frozen=True, slots=True)
class EdgeBody:
    """The body, how it turned, and how far each point is trusted."""

    angle: Array
    """φ, 0 where the edges are level [rad], shape (n,)."""
    pivot: Complex
    """q of each point's edge [px], shape (M,)."""
    pivot_std: Array
    """Standard deviation of that, down the picture or across it, whichever is more [px], shape (E,)."""
    weight: Array
    """Trust in each point of each frame, from 0 to 1, shape (n, M)."""
    rest: Array
    """What does not fit [px], shape (n, M); 0 where not seen."""
    spread: Array
    """How far each point usually is from where the body has it [px], shape (M,)."""
    height: Array
    """Distance of each point from there, across its edge where that is level [px], shape (M,)."""
    along: Array
    """Place of each point along the edges, from the pivot [px], shape (n, M)."""
    scale_std: float
    """By which share turns may be off [1]: an arc about its pivot looks like one that turns less about a farther one."""


def fit_edges(z: Complex, edge: Edge, pivot: Complex, doubt: Array | float = 0.0) -> EdgeBody:
    """Find the turn of edges.

    Args:
        z: Points of the edges in every frame [px], shape (n, M); NaN where not seen.
        edge: Number of the edge of each point, shape (M,).
        pivot: What each point turns about, roughly [px], shape (M,).
        doubt: How far each point may be off for what is beside it in that frame [px], shape (n, M).
    """
    seen = np.isfinite(z)
    vague = np.hypot(POINT_FLOOR, np.broadcast_to(doubt, z.shape))
    vague = vague / np.median(vague[seen])  # in usual ones
    place = np.where(seen, z, pivot) - pivot  # from where the pivot was taken to be
    angle = rough_turn(z, edge)
    shift = np.zeros(len(z))
    turned = np.exp(-1j * angle)[:, None] * place
    centre, height = np.zeros(len(edge), np.complex128), np.nan_to_num(_medians(turned.imag, seen))
    along, rest, weight = turned.real, turned.imag - height, seen.astype(np.float64)
    spread = np.ones(len(edge))
    middle = _usual(along, weight)
    known = PIVOT_SHARE * max(float(np.ptp(middle[edge == one])) for one in np.unique(edge))
    shape = _shape(middle, height, weight.sum(axis=0), edge)
    for least in (*LEAST_SPREADS, LEAST_SPREADS[-1]):
        spread = np.maximum(_spread(rest / vague, seen, attitudes(angle)), least)
        trust, usual = seen * (least / spread / vague) ** 2, spread * vague
        middle = _usual(along, weight)
        height = height + shape.below(middle)
        shape = _shape(middle, height, weight.sum(axis=0), edge)
        for _ in range(3):
            weight = trust / (1 + (rest / (OUTLYING * usual)) ** 2) ** 2
            turned = np.exp(-1j * angle)[:, None] * place
            level = turned.imag - shape.below(along) - shape.slope * (turned.real - along)
            centre, height = _body(level, shape.slope, angle, weight, edge, known)
            for _ in range(2):
                turned = np.exp(-1j * angle)[:, None] * (place - centre)
                along = turned.real
                rest = turned.imag - shape.below(along) - shift[:, None] - height
                weight = trust / (1 + (rest / (OUTLYING * usual)) ** 2) ** 2
                lever = along + shape.slope * turned.imag
                more, further = _turn_step(rest, lever, shift, weight, edge)
                angle, shift = angle + more, shift + further
                rest = rest - more[:, None] * lever - further[:, None]
    shape = _shape(shape.middle, height, weight.sum(axis=0), edge)
    slope = shape.level
    pivot_std, scale_std = _doubt(shape, angle, weight, edge, known)
    return EdgeBody(
        angle + slope,
        pivot + centre,
        pivot_std,
        weight,
        np.where(seen, rest, 0.0),
        spread,
        (np.exp(-1j * slope) * (shape.middle + 1j * height)).imag,
        np.where(seen, along, 0.0),
        scale_std,
    )


def rough_turn(z: Complex, edge: Edge) -> Array:
    """Median slope between points of each edge that are half its length apart [rad], shape (n,)."""
    half = np.bincount(edge).max() // 2
    pair = edge[half:] == edge[:-half]
    with np.errstate(invalid="ignore"):
        slope = np.angle((z[:, half:] - z[:, :-half])[:, pair])
    some = np.isfinite(slope).any(axis=1)
    middle = np.full(len(z), np.nan)
    middle[some] = np.nanmedian(slope[some], axis=1)
    return np.interp(np.arange(len(z)), np.flatnonzero(some), middle[some])


def moments(weight: Array, edge: Edge, *values: Array) -> list[Array]:
    """Sums over the points of each edge, weighed, of 1 and of values (n, M) of any unit; each (n, E)."""
    belongs = (edge[:, None] == np.arange(edge.max() + 1)).astype(np.float64)
    return [weight @ belongs, *((weight * value) @ belongs for value in values)]


def attitudes(angle: Array) -> Array:
    """Return the weight of each frame [1], shape (n,), by its angle [rad]: all attitudes in the range of angles count alike."""
    return attitude_share(angle, max(float(np.ptp(angle)) / ATTITUDE_BINS, 1e-6))


def _spread(rest: Array, seen: npt.NDArray[np.bool_], share: Array) -> Array:
    """Return how far each point usually is from where the body has it [px], shape (M,).

    Args:
        rest: How far it is [px], shape (n, M).
        seen: Whether it is seen, shape (n, M).
        share: How much each frame counts [1], shape (n,).
    """
    order = np.argsort(np.where(seen, np.abs(rest), np.inf), axis=0)
    total = np.cumsum(np.take_along_axis(seen * share[:, None], order, axis=0), axis=0)
    middle = np.argmax(total >= total[-1] / 2, axis=0)
    return 1.48 * np.abs(np.take_along_axis(rest, order, axis=0))[middle, np.arange(rest.shape[1])]


def _medians(values: Array, seen: npt.NDArray[np.bool_]) -> Array:
    """Median of each column's seen values; NaN where there are none."""
    some = seen.any(axis=0)
    middle = np.full(values.shape[1], np.nan)
    middle[some] = np.nanmedian(np.where(seen, values, np.nan)[:, some], axis=0)
    return middle


@dataclass(frozen=True, slots=True)
class _Shape:
    """Edges as curves."""

    level: float
    """Slope of all where they are straight above or below their pivot [rad]: decks are symmetrical, and concave."""
    middle: Array
    """Usual place of each point along its edge, from the pivot [px], shape (M,)."""
    slope: Array
    """Slope of the edge there [1], shape (M,)."""
    curvature: Array
    """And its curvature [1/px], shape (M,)."""

    def below(self, along: Array) -> Array:
        """Return how far the edge is below each point's usual place at places along it, (n, M), both in px."""
        off = np.nan_to_num(along - self.middle)
        return off * (self.slope + off * self.curvature / 2)


def _shape(along: Array, height: Array, weight: Array, edge: Edge) -> _Shape:
    """Return the parabolas through the usual places of points, along and across their edges [px], both of shape (M,)."""
    count = edge.max() + 1
    belongs = (edge[:, None] == np.arange(count)).astype(np.float64)
    bow = belongs * along[:, None] ** 2 / 2
    trust, lean, fit = weight, np.ones(len(edge)), np.zeros(1 + 2 * count)
    for _ in range(SHAPE_ROUNDS):
        root = np.sqrt(trust)
        design = np.hstack([(lean * along)[:, None], belongs, bow])
        fit = np.linalg.lstsq(design * root[:, None], height * root, rcond=None)[0]
        off = np.abs(height - design @ fit)
        order = np.argsort(off)
        middle = off[order][np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)]
        trust = weight / (1 + (off / max(OUTLYING * 1.48 * middle, POINT_STD)) ** 2) ** 2
        # An edge that turns about its pivot is another part of itself above it.
        lean = 1 + (fit[1 : 1 + count] * fit[1 + count :])[edge]
    curvature = np.asarray(fit[1 + count :][edge], np.float64)
    return _Shape(float(np.arctan(fit[0])), along, fit[0] * lean + curvature * along, curvature)


def _body(
    level: Array, slope: Array, angle: Array, weight: Array, edge: Edge, known: float
) -> tuple[Complex, Array]:
    """What each point's edge turns about, and its distance from there [px], both of shape (M,).

    Args:
        level: How far each point is from the origin across its edge, where it usually is along that [px], shape (n, M).
        slope: Slope of the edge there [1], shape (M,).
        angle: Turns [rad], shape (n,).
        weight: Of the points, shape (n, M).
        edge: Number of the edge of each point, shape (M,).
        known: Standard deviation of the first beforehand [px].
    """
    design = np.stack(_levers(slope, angle), axis=-1)
    weight = weight * attitudes(angle)[:, None] + 1e-9
    total = weight.sum(axis=0)
    mean = np.einsum("nm,nmk->mk", weight, design) / total[:, None]
    y = (weight * level).sum(axis=0) / total
    centre = np.zeros(len(edge), np.complex128)
    for one in range(edge.max() + 1):
        own = edge == one
        w, way = weight[:, own], design[:, own] - mean[own]
        normal = np.einsum("nm,nmk,nml->kl", w, way, way)
        pull = np.einsum("nm,nmk,nm->k", w, way, level[:, own] - y[own])
        prior = w.shape[1] * (POINT_STD / known) ** 2 * np.eye(2)  # all points of an attitude may err alike
        centre[own] = complex(*np.linalg.solve(normal + prior, pull))
    return centre, y - mean[:, 0] * centre.real - mean[:, 1] * centre.imag


def _doubt(shape: _Shape, angle: Array, weight: Array, edge: Edge, known: float) -> tuple[Array, float]:
    """Return the standard deviations of what edges turn about [px], shape (E,), and of the scale of their turns [1].

    The first as edges differ in it, whatever the turn and shift that are common to all; the second as far as points tell all of it at
    once: a bent edge looks the same about a farther pivot, if it turns more and is shifted a little. All points of an attitude may err alike.

    Args:
        shape: The edges.
        angle: Turns [rad], shape (n,).
        weight: Of the points, shape (n, M).
        edge: Number of the edge of each point, shape (M,).
        known: Standard deviation of the pivots beforehand [px].
    """
    belongs = (edge[:, None] == np.arange(edge.max() + 1)).astype(np.float64)
    design = np.concatenate(
        [lever[..., None] * belongs for lever in _levers(shape.slope, angle)]
        + [(angle[:, None] * shape.middle)[..., None]],
        axis=-1,
    )
    weight = weight * attitudes(angle)[:, None] / (belongs.sum(axis=0) * POINT_STD**2)[edge] + 1e-9
    design -= np.einsum("nm,nmk->mk", weight, design) / weight.sum(axis=0)[:, None]
    normal = np.einsum("nm,nmk,nml->kl", weight, design, design)
    normal += np.diag(np.append(np.full(len(normal) - 1, known**-2.0), 0.0))
    pivot = np.diag(np.linalg.inv(normal[:-1, :-1])).reshape(2, -1).max(axis=0)
    common = np.einsum("nm,nmk->nk", weight, design)
    normal -= np.einsum("nk,nl,n->kl", common, common, 1 / (weight.sum(axis=1) + SHIFT_STD**-2.0))
    return np.sqrt(pivot), float(np.sqrt(np.linalg.inv(normal)[-1, -1]))


def _levers(slope: Array, angle: Array) -> list[Array]:
    """Return how far a point moves across its edge as the edge's pivot moves across the picture and down it [1], each of shape (n, M).

    Args:
        slope: Slope of the edge at each point [1], shape (M,).
        angle: Turns [rad], shape (n,).
    """
    sine, cosine = np.sin(angle)[:, None], np.cos(angle)[:, None]
    return [-sine - slope * cosine, cosine - slope * sine]


def _turn_step(rest: Array, along: Array, shift: Array, weight: Array, edge: Edge) -> tuple[Array, Array]:
    """Change of turn and shift in every frame that fits best."""
    total, x, y, xx, xy = moments(weight, edge, along, rest, along**2, along * rest)
    total = np.maximum(total, 1e-9)
    inside, pull = (xx - x**2 / total).sum(axis=1), (xy - x * y / total).sum(axis=1)
    # An edge as a whole may be off by more than its points suggest.
    trust = 1 / (1 / total + (EDGE_SHIFT_STD / POINT_STD) ** 2)
    x, y = x / total, y / total
    tight = (POINT_STD / SHIFT_STD) ** 2
    a, b, d = inside + (trust * x**2).sum(axis=1), (trust * x).sum(axis=1), trust.sum(axis=1) + tight
    p, q = pull + (trust * x * y).sum(axis=1), (trust * y).sum(axis=1) - tight * shift
    determinant = np.maximum(a * d - b**2, 1e-6)
    return np.clip((d * p - b * q) / determinant, -0.02, 0.02), np.clip((a * q - b * p) / determinant, -2, 2)


def _usual(along: Array, weight: Array) -> Array:
    """Return the mean place of each point along the edges [px], shape (M,)."""
    return (weight * along).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-9)
