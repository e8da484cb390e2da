"""Direction of the axis, lens and shutter with which the points of a turning body run on circles.

To a camera along the axis every point of a rigid body runs on a circle, whatever its depth. Picture coordinates are complex:

    z_ij = τ_i + c_j + exp(i φ_i) q_j.

In frame i the roll is φ_i, and τ_i is a shift of the whole body (a truck gives way). The body's shape is q_j.
The circles of its points have the centres c_j. These differ if depths do and the axis is not in the middle of the picture.
The depth of a plane may grow by g with height. With P, the place at which the axis passes its middle, and q_j in focal lengths,

    c_j = -P g Im(q_j).

A bundle adjustment finds the camera, the body's shape and its circles, which all frames share. It minimises the distances in the
pictures, with priors. Each frame gives the place of the body in it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.least_squares import Normal, minimise
from sysid.roll import Array
from sysid.video.pose.camera_state import DIFFERENCE_STEP, READOUT, CameraState
from sysid.video.pose.keyframes import BLUR_SHARE, Keyframes, PointNoise, point_noise
from sysid.video.pose.prior import PLANE_CENTRES, ROUNDS, SLOPE, BodyPrior
from sysid.video.pose.rectify import project, upright
from sysid.video.pose.view import View
from sysid.video.types import Complex

ACROSS = np.radians(7.0)
"""A printed square stands across the axis to within this [rad]: what docs/video.md asks for."""


@dataclass(frozen=True, slots=True)
class Body:
    """A camera, and shape and circles of a body's points as one along the axis sees them [px]; of several along further first axes."""

    camera: Array
    """Its values [rad, rad, 1, s], shape (..., 4)."""
    flat: Array
    """Homography from its picture to that of a camera along the axis [px], shape (..., 3, 3)."""
    shape: Complex
    """q, shape (..., N)."""
    centre: Complex
    """c, shape (..., N)."""

    def upright(self, points: Array, shear: Array) -> tuple[Array, Complex]:
        """Return points (n, N, 2) [px] with the shutter's part, (..., n, N, 2), and to a camera along the axis, (..., n, N)."""
        seen = points + self.camera[..., READOUT, None, None, None] * shear
        # All frames at once: products of many small matrices take long.
        there = project(self.flat, seen.reshape(*seen.shape[:-3], -1, 2))
        return seen, (there[..., 0] + 1j * there[..., 1]).reshape(seen.shape[:-1])

    def pivot(self, points: Array, shear: Array, share: Array) -> Array:
        """Return where the axis is seen [px], shape (2,): about there the middle of the points turns, as `share`, shape (n,), weighs frames."""
        weight = np.sqrt(share)
        circle = weight[:, None] * np.stack(
            [np.ones(len(share)), np.exp(1j * self.placed(points, shear)[0])], axis=1
        )
        middle = self.upright(points, shear)[1].mean(axis=-1)
        place = np.linalg.lstsq(circle, weight * middle, rcond=None)[0][0]
        aside = np.asarray(np.linalg.inv(self.flat), np.float64)
        return project(aside, np.array([[place.real, place.imag]]))[0]

    def placed(self, points: Array, shear: Array) -> tuple[Array, Array]:
        """Return the angle at which the body fits points (n, N, 2) best [rad], shape (..., n), and the rest [px], (..., n, N, 2)."""
        seen, place = self.upright(points, shear)
        place = place - self.centre[..., None, :]
        shift = place.mean(axis=-1, keepdims=True)
        angle = np.angle(((place - shift) @ self.shape.conj()[..., None])[..., 0])
        model = self.centre[..., None, :] + shift + np.exp(1j * angle)[..., None] * self.shape[..., None, :]
        aside = np.asarray(np.linalg.inv(self.flat), np.float64)
        again = project(aside, np.stack([model.real, model.imag], axis=-1).reshape(*seen.shape[:-3], -1, 2))
        return angle, seen - again.reshape(seen.shape)


@dataclass(frozen=True, slots=True)
class Unknowns:
    """The order of the common unknowns of all frames: the camera's free numbers, c and q, and g if a side may be slanted."""

    before: CameraState
    matrix: Array
    """Camera matrix [px], shape (3, 3)."""
    home: Array
    """The body in one of the frames, as filmed [px], shape (N, 2). q is counted from its picture along the axis."""
    any_side: bool = False
    """Whether depth may grow with height."""
    pivot: Array = field(default_factory=lambda: np.zeros(2))
    """Place of the axis on a slanted side [px], shape (2,); c is counted from g's part of it."""

    @property
    def focal(self) -> float:
        """Focal length, in which c and q are counted [px]."""
        return float(self.matrix[0, 0])

    def body(self, x: Array) -> Body:
        """Return camera and body of numbers [rad, rad, 1, s; focal lengths; 1], shape (P,), or of rows of them."""
        free, size = self.before.free, len(self.home)
        camera = np.broadcast_to(self.before.value, (*x.shape[:-1], 4)).copy()
        camera[..., free] = x[..., : len(free)]
        flat = upright(self.matrix, camera)
        parts = self.focal * x[..., len(free) : len(free) + 4 * size].reshape(*x.shape[:-1], 4, size)
        shape = project(flat, self.home) @ np.array([1, 1j]) + parts[..., 2, :] + 1j * parts[..., 3, :]
        shape = shape - shape.mean(axis=-1, keepdims=True)
        centre = parts[..., 0, :] + 1j * parts[..., 1, :]
        if self.any_side:
            aside = (project(flat, self.pivot[None]) - self.matrix[:2, 2]) @ np.array([1, 1j])
            centre = centre - aside * x[..., -1:] * shape.imag / self.focal
        return Body(camera, flat, shape, centre)


@dataclass(frozen=True, slots=True)
class Found:
    """The numbers that all frames share."""

    unknowns: Unknowns
    x: Array
    """The numbers, as `unknowns` has them, shape (P,)."""
    covariance: Array
    """Of these, shape (P, P)."""
    camera_state: CameraState
    body: Body
    noise: PointNoise
    likelihood: float
    """Logarithm of how likely it is: of a noise that is at least the usual one."""


def fit_circles(
    view: View,
    some: Keyframes,
    matrix: Array,
    before: CameraState,
    prior: BodyPrior,
    start: Array,
    slope: float = 0.0,
) -> Found:
    """Find body and camera, three times, as the noise weighs the frames.

    The search sets out from the camera `start`, shape (4,), and a slope g [1]; the camera matrix [px] has shape (3, 3).
    """
    points, shear = view.points[some.rows], view.shear[some.rows]
    unknowns = Unknowns(before, matrix, points[len(points) // 2], prior.any_side)
    x = np.concatenate([start[before.free], np.zeros(4 * points.shape[1]), [slope] * prior.any_side])
    beforehand = _priors(unknowns, prior)

    def residuals(x: Array, weight: Array) -> Array:
        body = unknowns.body(x)
        rest = np.sqrt(weight)[:, None, None] * body.placed(points, shear)[1]
        return np.concatenate([rest.reshape(*x.shape[:-1], -1), beforehand(x, body)], axis=-1)

    noise, doubt = PointNoise(0.05**2, 0.0), np.ones(len(points))
    low, high, width = (np.full(len(x), limit) for limit in (-np.inf, np.inf, np.inf))
    if (at := before.place_of(READOUT)) is not None:  # as likely anywhere within its limits
        low[at], high[at], width[at] = 0.0, before.readout_limit, before.std[READOUT]
    information = np.zeros((0, 0))
    for _ in range(ROUNDS):
        if prior.any_side:
            unknowns = replace(unknowns, pivot=unknowns.body(x).pivot(points, shear, some.share))
        weight = some.share * doubt / noise.variance(some.speed)

        def normal(x: Array, weight: Array = weight) -> Normal:
            rows = residuals(x + DIFFERENCE_STEP * np.vstack([np.zeros(len(x)), np.eye(len(x))]), weight)
            slopes = (rows[1:] - rows[0]) / DIFFERENCE_STEP
            return Normal(float(0.5 * rows[0] @ rows[0]), slopes @ rows[0], slopes @ slopes.T)

        found = minimise(normal, x, low, high, iterations=12)
        x, information = found.point, found.normal.hessian
        noise, doubt = point_noise(unknowns.body(x).placed(points, shear)[1], some, len(before.free), prior)
    covariance = np.asarray(np.linalg.inv(information + np.diag(width**-2.0)), np.float64)
    body = unknowns.body(x)
    unknown = np.zeros((4, 4))
    unknown[np.ix_(before.free, before.free)] = covariance[: len(before.free), : len(before.free)]
    # One noise for all solutions, so that they can be compared.
    usual = PointNoise(prior.floor**2, BLUR_SHARE**2).variance(some.speed)
    cost = float(np.sum(residuals(x, some.share / usual) ** 2))
    count = float(some.share.sum() * (2 * points.shape[1] - 3))
    state = replace(before, value=body.camera, covariance=unknown)
    return Found(unknowns, x, covariance, state, body, noise, -count / 2 * np.log1p(cost / count))


def _priors(unknowns: Unknowns, prior: BodyPrior) -> Callable[[Array, Body], Array]:
    """Return the priors as a function of the numbers (..., P) and their body: distances in standard deviations."""
    before, home = unknowns.before, unknowns.home
    size = float(np.sqrt(np.mean(np.sum((home - home.mean(axis=0)) ** 2, axis=1))))
    told = [number for number in before.free if number != READOUT]
    ideal = np.exp(1j * np.pi / 2 * np.arange(len(home))) / np.sqrt(len(home))

    def at(x: Array, body: Body) -> Array:
        centre, own = np.split(x[..., len(before.free) : len(before.free) + 4 * len(home)], 2, axis=-1)
        # A weak prior on the shape, as shift and turn are degenerate with it.
        known = [
            (body.camera[..., told] - before.value[told]) / before.std[told],
            own * unknowns.focal / size,
            centre / PLANE_CENTRES,
        ]
        if prior.square:
            off = body.shape - (body.shape @ ideal.conj())[..., None] * ideal
            squeeze = 1 - np.cos(ACROSS)
            known += [part / (squeeze * size) for part in (off.real, off.imag)]
        if unknowns.any_side:
            known.append(x[..., -1:] / SLOPE)
        return np.concatenate(known, axis=-1)

    return at
