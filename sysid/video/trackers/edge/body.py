"""Edges of a body that turns about an axis: their points show where they are across the edge only.

In the picture of a camera along the axis, a point of an edge lies at

    Im(exp(-i φ) (z - q)) = h + s + c

where φ is the turn, q what the body turns about, h the point's own distance from there, s a shift of the whole
body and c one of its edge. Every point has one h, whatever the turn: that tells the points of the deck's edges from
those that something else has lent them, the outline of a long side or a wheel.
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
PIVOT_STD = 12.0
"""Standard deviation of where the pivot is taken to be, which is learned from small turns on to large ones [px]."""
ATTITUDE_BINS = 12
"""Attitudes that count alike, over the range of turns, when the body is learned."""
LEAST_SPREADS = (1.0, 1.0, 0.75, 0.5, 0.35, 0.25, 0.2, 0.2, 0.2, 0.2)
"""Usual distance of a point from where the body has it that is not told from a smaller one, round by round [px]: what compression and
shade do to an edge is common to its points."""
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
    pivot_std = np.full(edge.max() + 1, PIVOT_STD)
    along, rest, weight = turned.real, turned.imag - height, seen.astype(np.float64)
    spread = np.ones(len(edge))
    for least in (*LEAST_SPREADS, LEAST_SPREADS[-1]):
        spread = np.maximum(_spread(rest / vague, seen, attitudes(angle)), least)
        trust, usual = seen * (least / spread / vague) ** 2, spread * vague
        for _ in range(3):
            weight = trust / (1 + (rest / (OUTLYING * usual)) ** 2) ** 2
            centre, height, pivot_std = _body(np.exp(-1j * angle)[:, None] * place, angle, weight, edge)
            for _ in range(2):
                turned = np.exp(-1j * angle)[:, None] * (place - centre)
                along = turned.real
                rest = turned.imag - shift[:, None] - height
                weight = trust / (1 + (rest / (OUTLYING * usual)) ** 2) ** 2
                more, further = _turn_step(rest, along, shift, weight, edge)
                angle, shift = angle + more, shift + further
                rest = rest - more[:, None] * along - further[:, None]
    slope = _slope(along, height, weight, edge)
    return EdgeBody(
        angle + slope,
        pivot + centre,
        pivot_std,
        weight,
        np.where(seen, rest, 0.0),
        spread,
        (np.exp(-1j * slope) * (_usual(along, weight) + 1j * height)).imag,
        np.where(seen, along, 0.0),
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


def _body(turned: Complex, angle: Array, weight: Array, edge: Edge) -> tuple[Complex, Array, Array]:
    """What each point's edge turns about, its distance from there, and the first's standard deviation, shape (E,), by how far it is from the origin at each turn."""
    design = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    weight = weight * attitudes(angle)[:, None] + 1e-9
    total = weight.sum(axis=0)
    mean = (weight.T @ design) / total[:, None]
    y = (weight * turned.imag).sum(axis=0) / total
    centre, doubt = np.zeros(len(edge), np.complex128), np.zeros(edge.max() + 1)
    for one in range(edge.max() + 1):
        own = edge == one
        w, some, there = weight[:, own], total[own], mean[own]
        normal = (design * w.sum(axis=1)[:, None]).T @ design - (there * some[:, None]).T @ there
        pull = design.T @ (w * turned.imag[:, own]).sum(axis=1) - there.T @ (some * y[own])
        prior = (
            w.shape[1] * (POINT_STD / PIVOT_STD) ** 2 * np.eye(2)
        )  # all points of an attitude may err alike
        covariance = np.linalg.inv(normal + prior)
        centre[own] = complex(*(covariance @ pull))
        doubt[one] = POINT_STD * np.sqrt(w.shape[1] * np.diag(covariance).max())
    return centre, y + mean[:, 0] * -centre.real - mean[:, 1] * centre.imag, doubt


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


def _slope(along: Array, height: Array, weight: Array, edge: Edge) -> float:
    """Common slope of the edges where the angle is zero."""
    x = _usual(along, weight)[None]
    total, sx, sy, sxx, sxy = moments(weight.sum(axis=0)[None], edge, x, height[None], x**2, x * height)
    total = np.maximum(total, 1e-9)
    return float((sxy - sx * sy / total).sum() / (sxx - sx**2 / total).sum())
