"""The angle of the deck from points on the edges of its end, and how well it is known."""

from collections.abc import Mapping

import numpy as np

from sysid.roll import Array
from sysid.video.pose.angle import AngleTrack
from sysid.video.pose.camera_state import READOUT, CameraState, rate_of, spread_by
from sysid.video.pose.rectify import rectify, smear, unwrap
from sysid.video.pose.view import View
from sysid.video.trackers._edge_profile import PIECES
from sysid.video.trackers.edge.body import POINT_FLOOR, Edge, EdgeBody, fit_edges, moments
from sysid.video.types import Complex

MIN_POINTS, MIN_USUAL_SHARE = 6, 0.45
"""Points that must lie where the body has them in a frame that is believed: so many, and this share of what is
usual in the film."""
EDGE_BIAS = 0.05
"""What shade, background and compression may shift an edge's points by, growing along it [px]: it is the same as
long as the deck stands still, so that no scatter shows it."""
SHUTTER_ROUNDS = 2
"""Times that the shutter's correction is made, the second time with the turn that is known by then."""


def fit_direction(
    view: View,
    matrix: Array,
    before: CameraState,
    *,
    pivot: Array,
    doubts: Mapping[int, Array] | None = None,
    vanishing: tuple[Array, float] | None = None,
) -> AngleTrack:
    """Turn of the edges of the deck's end, as seen along its axis.

    Lines across the axis show neither its direction nor focal length nor read-out: they stay as they are
    known beforehand, unless the deck's far end shows its direction.

    Args:
        view: Points along each edge.
        matrix: Camera matrix [px], shape (3, 3).
        before: What is known of camera and lens.
        pivot: What each edge turns about in the picture, roughly [px], shape (E, 2).
        doubts: How far each point of a frame may be off for what is beside it there [px], shape (N,), by the frame's number.
        vanishing: Where the axis vanishes in the picture, shape (2,), and its standard deviation [px], if that is seen.
    """
    if vanishing is not None and {0, 1} <= set(before.free):
        place, std = vanishing
        off = view.straighten(place[None])[0] - matrix[:2, 2]
        before = before.facing(off / matrix[0, 0], std / matrix[0, 0])
    time = view.time(before.readout)
    z = rectify(view.points, matrix, before.value)
    about = np.repeat(rectify(pivot, matrix, before.value), PIECES)
    edge = np.arange(z.shape[1]) // PIECES
    known = doubts or {}
    doubt = np.array([known.get(number, np.zeros(len(edge))) for number in view.track.index.tolist()])
    body = fit_edges(z, edge, about, doubt)
    for _ in range(SHUTTER_ROUNDS if before.readout else 0):
        body = fit_edges(z - _moved(body, z, time, view.late * before.readout), edge, about, doubt)

    def angle_at(value: Array) -> Array:
        place = rectify(view.points, matrix, value)
        return body.angle + _turned(place - _moved(body, place, time, view.late * value[READOUT]), edge, body)

    seen = angle_at(before.value)
    unknown = spread_by(before.value, before.covariance, seen, angle_at, time, view.share, READOUT)
    unknown += (body.scale_std * (seen - np.nanmedian(seen))) ** 2
    noise = _variance(body, edge)
    trusted = body.weight.sum(axis=1)
    wrong = trusted < max(MIN_POINTS, MIN_USUAL_SHARE * float(np.median(trusted)))
    angle = np.where(wrong, np.nan, body.angle)
    own = noise + smear(angle) ** 2
    return AngleTrack(
        unwrap(angle),
        np.where(wrong, np.nan, np.sqrt(own + unknown)),
        before,
        float(np.sqrt(np.average(body.rest**2, weights=body.weight))),
        int((wrong & (np.isfinite(z).sum(axis=1) >= MIN_POINTS)).sum()),
        np.array([1 + 0j]),
        np.where(wrong, np.nan, np.sqrt(own)),
    )


def _moved(body: EdgeBody, z: Complex, time: Array, late: Array) -> Complex:
    """How far points have turned with the body by the time that the sensor reads them.

    An edge does not show what it does along itself: only its turn about the pivot says how its points move.
    """
    return 1j * rate_of(time, body.angle)[:, None] * (z - body.pivot) * np.nan_to_num(late)


def _turned(z: Complex, edge: Edge, body: EdgeBody) -> Array:
    """Slope of the edges against the body's angle, as their points lie one by one [rad], shape (n,)."""
    place: Complex = np.exp(-1j * body.angle)[:, None] * np.where(body.weight > 0, z, 0)
    total, x, y, xx, xy = moments(
        body.weight, edge, place.real, place.imag, place.real**2, place.real * place.imag
    )
    total = np.maximum(total, 1e-9)
    return (xy - x * y / total).sum(axis=1) / np.maximum((xx - x**2 / total).sum(axis=1), 1e-9)


def _variance(body: EdgeBody, edge: Edge) -> Array:
    """What noise leaves open of the turn [rad²], shape (n,)."""
    total, x, xx, square = moments(body.weight, edge, body.along, body.along**2, body.rest**2)
    total = np.maximum(total, 1e-9)
    inside = xx - x**2 / total
    lever, points = np.maximum(inside.sum(axis=1), 1e-9), total.sum(axis=1)
    edges = np.maximum(lever**2 / np.maximum((inside**2).sum(axis=1), 1e-9), 1.0)
    noise = np.maximum(square.sum(axis=1) / np.maximum(points - 3, 1), POINT_FLOOR**2)
    return noise / lever + EDGE_BIAS**2 * points / lever / edges
