"""Direction of the axis, lens and shutter with which the points of a turning body run on circles.

As a camera along the axis sees it, every point of a rigid body, whatever its depth, runs on a circle: with complex numbers for
picture coordinates,

    z_ij = τ_i + c_j + exp(i φ_i) q_j.

φ_i is the roll in frame i, τ_i a shift of the whole body (a truck that gives way; never an angle), q_j the body's shape and c_j the
centres of its points' circles, which differ if their depths do and the axis is not in the middle of the picture.

A bundle adjustment: what all frames have in common (the camera, and the body's shape and circles) is found by least squares
of the distances in the pictures, with what is known beforehand; where a body lies in a frame follows from that frame.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sysid.least_squares import Normal, minimise
from sysid.roll import Array
from sysid.video.pose.camera_state import DIFFERENCE_STEP, READOUT, CameraState
from sysid.video.pose.keyframes import Keyframes
from sysid.video.pose.point_noise import BLUR_SHARE, PointNoise, point_noise
from sysid.video.pose.prior import BodyPrior
from sysid.video.pose.rectify import project, upright
from sysid.video.pose.view import View
from sysid.video.types import Complex

NOISE_ROUNDS = 3
"""Times that the noise is found anew."""
SQUARE_SQUEEZE = 0.0075
"""Standard deviation of a printed square's squareness: one that stands 7 degrees off looks 0.75 % narrower."""
LEAST_COST = 1e-5
"""The search ends where a step gains less than this share of the sum of squares: slant and focal length share a valley."""


@dataclass(frozen=True, slots=True)
class Body:
    """A camera, and shape and circles of a body's points as one along the axis sees them [px]; of several along further first axes."""

    camera: Array
    """Its values [rad, rad, 1, s], shape (..., 4)."""
    flat: Array
    """Takes what it sees to what one along the axis does [px], shape (..., 3, 3)."""
    shape: Complex
    """q, shape (..., N)."""
    centre: Complex
    """c, shape (..., N)."""

    def placed(self, points: Array, shear: Array) -> tuple[Array, Array]:
        """Return where the body fits best: its angle [rad], shape (..., n), and what does not fit [px], (..., n, N, 2).

        Args:
            points: Points as a straight lens shows them [px], shape (n, N, 2).
            shear: What to add to them for each second of read-out [px/s], shape (n, N, 2).
        """
        seen = points + self.camera[..., READOUT, None, None, None] * shear
        # All frames at once: products of many small matrices take long.
        there = project(self.flat, seen.reshape(*seen.shape[:-3], -1, 2))
        place = (there[..., 0] + 1j * there[..., 1]).reshape(seen.shape[:-1]) - self.centre[..., None, :]
        shift = place.mean(axis=-1, keepdims=True)
        angle = np.angle(((place - shift) @ self.shape.conj()[..., None])[..., 0])
        model = self.centre[..., None, :] + shift + np.exp(1j * angle)[..., None] * self.shape[..., None, :]
        aside = np.asarray(np.linalg.inv(self.flat), np.float64)
        again = project(aside, np.stack([model.real, model.imag], axis=-1).reshape(there.shape))
        return angle, seen - again.reshape(seen.shape)


@dataclass(frozen=True, slots=True)
class Unknowns:
    """How what all frames have in common stands in a row of numbers: the camera's free ones, then c and q."""

    before: CameraState
    matrix: Array
    """Camera matrix [px], shape (3, 3)."""
    home: Array
    """The body in one of the frames, as filmed [px], shape (N, 2): q is counted from what a camera along the axis sees of it, so that
    another axis bends the body as it does the picture, and leaves little to the other numbers."""

    @property
    def focal(self) -> float:
        """Focal length, in which c and q are counted [px]."""
        return float(self.matrix[0, 0])

    def body(self, x: Array) -> Body:
        """Return camera and body of numbers [rad, rad, 1, s; focal lengths], shape (p + 4N,), or of rows of them."""
        free = self.before.free
        camera = np.broadcast_to(self.before.value, (*x.shape[:-1], 4)).copy()
        camera[..., free] = x[..., : len(free)]
        flat = upright(self.matrix, camera)
        parts = self.focal * x[..., len(free) :].reshape(*x.shape[:-1], 4, len(self.home))
        shape = project(flat, self.home) @ np.array([1, 1j]) + parts[..., 2, :] + 1j * parts[..., 3, :]
        shape = shape - shape.mean(axis=-1, keepdims=True)
        return Body(camera, flat, shape, parts[..., 0, :] + 1j * parts[..., 1, :])


@dataclass(frozen=True, slots=True)
class Found:
    """What all frames have in common."""

    unknowns: Unknowns
    x: Array
    """The numbers, as `unknowns` has them, shape (P,)."""
    covariance: Array
    """Of these, shape (P, P)."""
    camera_state: CameraState
    body: Body
    noise: PointNoise
    cost: float
    """Sum of squares that is left, weighed as usual noise would have it, and of what is known beforehand."""


def fit_circles(
    view: View,
    some: Keyframes,
    matrix: Array,
    before: CameraState,
    prior: BodyPrior,
    start: Array,
    steps: int = 60,
) -> Found:
    """Find body and camera, three times, as the noise weighs the frames.

    Args:
        view: The points.
        some: The frames that are used.
        matrix: Camera matrix [px], shape (3, 3).
        before: What is known of the camera beforehand.
        prior: What is known of the body.
        start: Camera from which the search sets out, shape (4,).
        steps: Steps of each search at most.
    """
    points, shear = view.points[some.rows], view.shear[some.rows]
    unknowns = Unknowns(before, matrix, points[len(points) // 2])
    x = np.concatenate([start[before.free], np.zeros(4 * points.shape[1])])
    beforehand = _priors(unknowns, prior)

    def residuals(x: Array, weight: Array) -> Array:
        body = unknowns.body(x)
        rest = np.sqrt(weight)[:, None, None] * body.placed(points, shear)[1]
        return np.concatenate([rest.reshape(*x.shape[:-1], -1), beforehand(x, body)], axis=-1)

    noise, doubt = PointNoise(0.05**2, 0.0), np.ones(len(points))
    low, high, width = np.full(len(x), -np.inf), np.full(len(x), np.inf), np.full(len(x), np.inf)
    if (at := before.place_of(READOUT)) is not None:  # as likely anywhere within its limits
        low[at], high[at], width[at] = 0.0, before.readout_limit, before.std[READOUT]
    information = np.zeros((0, 0))
    for _ in range(NOISE_ROUNDS):
        weight = some.share * doubt / noise.variance(some.speed)

        def normal(x: Array, weight: Array = weight) -> Normal:
            rows = residuals(x + DIFFERENCE_STEP * np.vstack([np.zeros(len(x)), np.eye(len(x))]), weight)
            slopes = (rows[1:] - rows[0]) / DIFFERENCE_STEP
            return Normal(float(0.5 * rows[0] @ rows[0]), slopes @ rows[0], slopes @ slopes.T)

        found = minimise(normal, x, low, high, iterations=steps, tolerance=LEAST_COST)
        x, information = found.point, found.normal.hessian
        noise, doubt = point_noise(unknowns.body(x).placed(points, shear)[1], some, len(before.free), prior)
    covariance = np.asarray(np.linalg.inv(information + np.diag(width**-2.0)), np.float64)
    body = unknowns.body(x)
    unknown = np.zeros((4, 4))
    p = len(before.free)
    unknown[np.ix_(before.free, before.free)] = covariance[:p, :p]
    # One noise for all solutions, so that they can be compared.
    usual = PointNoise(prior.floor**2, BLUR_SHARE**2).variance(some.speed)
    cost = float(np.sum(residuals(x, some.share / usual) ** 2))
    state = replace(before, value=body.camera, covariance=unknown)
    return Found(unknowns, x, covariance, state, body, noise, cost)


def _priors(unknowns: Unknowns, prior: BodyPrior) -> Callable[[Array, Body], Array]:
    """Return what is known beforehand as a function of the numbers (..., P) and their body: distances in standard deviations."""
    before, home = unknowns.before, unknowns.home
    size = float(np.sqrt(np.mean(np.sum((home - home.mean(axis=0)) ** 2, axis=1))))
    told = [number for number in before.free if number != READOUT]
    ideal = np.exp(1j * np.pi / 2 * np.arange(len(home))) / np.sqrt(len(home))

    def at(x: Array, body: Body) -> Array:
        own = x[..., -2 * len(home) :] * unknowns.focal / size
        # The body's own size says nothing of its shape, but that shift and turn are not to be told from it.
        both = [body.centre / (prior.centre_std * unknowns.focal)]
        if prior.square:
            off = body.shape - (body.shape @ ideal.conj())[..., None] * ideal
            both.append(off / (SQUARE_SQUEEZE * size))
        parts = [part for one in both for part in (one.real, one.imag)]
        return np.concatenate(
            [(body.camera[..., told] - before.value[told]) / before.std[told], own, *parts], axis=-1
        )

    return at
