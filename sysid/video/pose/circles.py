"""Direction of the axis, lens and shutter with which the points of a turning body run on circles.

To a camera along the axis every point of a rigid body runs on a circle, whatever its depth. With complex picture coordinates:

    z_ij = τ_i + c_j + exp(i φ_i) q_j.

φ_i is the roll in frame i, τ_i a shift of the whole body (a truck gives way), q_j the body's shape and c_j the centres of its points'
circles. Centres differ if depths do and the axis is not in the middle of the picture. Of a plane whose depth grows by g with height,

    c_j = -P g Im(q_j),

where P is the place at which the axis passes the plane's middle, and q_j is in focal lengths.

A bundle adjustment finds the camera, the body's shape and its circles, which all frames share. It minimises the distances in the
pictures, with priors. Each frame gives the place of the body in it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.least_squares import Normal, minimise
from sysid.roll import Array
from sysid.video.pose.camera_state import DIFFERENCE_STEP, READOUT, CameraState
from sysid.video.pose.keyframes import Keyframes
from sysid.video.pose.point_noise import BLUR_SHARE, PointNoise, point_noise
from sysid.video.pose.prior import SLOPE_SPREAD, BodyPrior
from sysid.video.pose.rectify import project, upright
from sysid.video.pose.view import View
from sysid.video.types import Complex

NOISE_ROUNDS = 3
"""Times that the noise is found anew."""
SLANTED_STEPS = 8
"""Most steps of a search for a slanted side, to save time: most bodies have none, and the search then leads nowhere."""
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
        """Return points with the shutter's part, shape (..., n, N, 2), and as a camera along the axis sees them [px], (..., n, N).

        Args:
            points: Points as a straight lens shows them [px], shape (n, N, 2).
            shear: Shift of each for a second of read-out [px/s], shape (n, N, 2).
        """
        seen = points + self.camera[..., READOUT, None, None, None] * shear
        # All frames at once: products of many small matrices take long.
        there = project(self.flat, seen.reshape(*seen.shape[:-3], -1, 2))
        return seen, (there[..., 0] + 1j * there[..., 1]).reshape(seen.shape[:-1])

    def pivot(self, points: Array, shear: Array, share: Array) -> Array:
        """Return where the axis is seen [px], shape (2,): about there the middle of the points turns, as `share`, shape (n,), weighs frames."""
        turn = np.exp(1j * self.placed(points, shear)[0])
        middle = self.upright(points, shear)[1].mean(axis=-1)
        mean_turn, mean_middle = np.average(turn, weights=share), np.average(middle, weights=share)
        spread = max(float(share @ np.abs(turn - mean_turn) ** 2), 1e-12)
        place = (
            mean_middle - mean_turn * (share @ ((middle - mean_middle) * (turn - mean_turn).conj())) / spread
        )
        aside = np.asarray(np.linalg.inv(self.flat), np.float64)
        return project(aside, np.array([[place.real, place.imag]]))[0]

    def placed(self, points: Array, shear: Array) -> tuple[Array, Array]:
        """Return where the body fits best: its angle [rad], shape (..., n), and what does not fit [px], (..., n, N, 2).

        Args:
            points: Points as a straight lens shows them [px], shape (n, N, 2).
            shear: Shift of each for a second of read-out [px/s], shape (n, N, 2).
        """
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
    """How what all frames have in common stands in a row of numbers.

    The camera's free ones, c and q, and for a slanted side the logarithm of its slope against the usual one.
    """

    before: CameraState
    matrix: Array
    """Camera matrix [px], shape (3, 3)."""
    home: Array
    """The body in one of the frames, as filmed [px], shape (N, 2). q is counted from its picture along the axis."""
    slope: float = 0.0
    """How depth grows with height, as usual where its points are [1]; 0 across the axis, where that is not unknown."""
    pivot: Array = field(default_factory=lambda: np.zeros(2))
    """Place of the axis on a slanted side [px], shape (2,); c is counted from the slope's part of it."""

    @property
    def focal(self) -> float:
        """Focal length, in which c and q are counted [px]."""
        return float(self.matrix[0, 0])

    def body(self, x: Array) -> Body:
        """Return camera and body of numbers [rad, rad, 1, s; focal lengths; logarithm], shape (P,), or of rows of them."""
        free, size = self.before.free, len(self.home)
        camera = np.broadcast_to(self.before.value, (*x.shape[:-1], 4)).copy()
        camera[..., free] = x[..., : len(free)]
        flat = upright(self.matrix, camera)
        parts = self.focal * x[..., len(free) : len(free) + 4 * size].reshape(*x.shape[:-1], 4, size)
        shape = project(flat, self.home) @ np.array([1, 1j]) + parts[..., 2, :] + 1j * parts[..., 3, :]
        shape = shape - shape.mean(axis=-1, keepdims=True)
        centre = parts[..., 0, :] + 1j * parts[..., 1, :]
        if self.slope:
            aside = (project(flat, self.pivot[None]) - self.matrix[:2, 2]) @ np.array([1, 1j])
            centre = centre - aside * self.slope * np.exp(x[..., -1:]) * shape.imag / self.focal
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

    Args:
        view: The points.
        some: The frames that are used.
        matrix: Camera matrix [px], shape (3, 3).
        before: Prior knowledge of the camera.
        prior: Prior knowledge of the body.
        start: Camera from which the search sets out, shape (4,).
        slope: How depth grows with height, as usual where the points are [1]; 0 across the axis.
    """
    points, shear = view.points[some.rows], view.shear[some.rows]
    unknowns = Unknowns(before, matrix, points[len(points) // 2], slope)
    x = np.concatenate([start[before.free], np.zeros(4 * points.shape[1])])
    if slope:
        x = np.append(x, 0.0)
    beforehand = _priors(unknowns, prior)

    def residuals(x: Array, weight: Array) -> Array:
        body = unknowns.body(x)
        rest = np.sqrt(weight)[:, None, None] * body.placed(points, shear)[1]
        return np.concatenate([rest.reshape(*x.shape[:-1], -1), beforehand(x, body)], axis=-1)

    noise, doubt = PointNoise(0.05**2, 0.0), np.ones(len(points))
    low, high, width = _limits(before, len(x))
    information = np.zeros((0, 0))
    for _ in range(NOISE_ROUNDS):
        if slope:
            unknowns = replace(unknowns, pivot=unknowns.body(x).pivot(points, shear, some.share))
        weight = some.share * doubt / noise.variance(some.speed)

        def normal(x: Array, weight: Array = weight) -> Normal:
            rows = residuals(x + DIFFERENCE_STEP * np.vstack([np.zeros(len(x)), np.eye(len(x))]), weight)
            slopes = (rows[1:] - rows[0]) / DIFFERENCE_STEP
            return Normal(float(0.5 * rows[0] @ rows[0]), slopes @ rows[0], slopes @ slopes.T)

        found = minimise(normal, x, low, high, iterations=SLANTED_STEPS if slope else 60)
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


def _limits(before: CameraState, count: int) -> tuple[Array, Array, Array]:
    """Return the least, the greatest and the deviation of each number: the readout time is as likely anywhere within its limits."""
    low, high, width = np.full(count, -np.inf), np.full(count, np.inf), np.full(count, np.inf)
    if (at := before.place_of(READOUT)) is not None:
        low[at], high[at], width[at] = 0.0, before.readout_limit, before.std[READOUT]
    return low, high, width


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
            centre / prior.centre_std,
        ]
        if prior.square:
            off = body.shape - (body.shape @ ideal.conj())[..., None] * ideal
            squeeze = 1 - np.cos(ACROSS)
            known += [part / (squeeze * size) for part in (off.real, off.imag)]
        if unknowns.slope:
            known.append(x[..., -1:] / SLOPE_SPREAD)
        return np.concatenate(known, axis=-1)

    return at
