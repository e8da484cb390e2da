"""Direction of the axis, lens and shutter with which the points of a turning body run on circles."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sysid.roll import Array
from sysid.video.pose.body import Body, common_problem
from sysid.video.pose.camera_state import CameraState
from sysid.video.pose.keyframes import Keyframes
from sysid.video.pose.placed_body import Found, fit_pose
from sysid.video.pose.point_noise import BLUR_SHARE, MANY_POINTS, PointNoise, near_ones, point_noise
from sysid.video.pose.prior import BodyPrior, add_priors
from sysid.video.pose.view import View
from sysid.video.types import Complex

NOISE_ROUNDS = 3
"""Times that the noise is found anew."""
MAX_STEPS = 25
"""Steps of Levenberg and Marquardt at most; they end by `MIN_GAIN` long before where there is an answer."""
FIXED_WEIGHT = 1e9
"""Weight that holds what is not to be found, in the unit of the noise [1]."""
MIN_GAIN = 1e-2
"""Steps end where they gain less than this of the sum of squares, which is in units of the noise."""


@dataclass(frozen=True, slots=True)
class _Trial:
    """Body and camera, and how well they fit."""

    body: Body
    camera_state: CameraState
    rest: Complex
    """What does not fit, shape (m, N)."""
    cost: float
    normal: Array
    pull: Array


def fit_circles(
    view: View, some: Keyframes, matrix: Array, before: CameraState, prior: BodyPrior, start: CameraState
) -> Found:
    """Find body and camera by damped Gauss-Newton steps; three times, as the noise weighs the frames.

    Args:
        view: The points.
        some: The frames that are used.
        matrix: Camera matrix [px], shape (3, 3).
        before: What is known of the camera beforehand.
        prior: What is known of the body.
        start: Camera from which the search sets out.
    """
    points, shear = view.points(some.rows), view.shear(some.rows)
    free = before.free
    limit = np.array([0.15, 0.15, 0.4, np.inf])[free]
    now = before.at(start.value)
    _, body = fit_pose(points, shear, some.mask, matrix, now, None)
    noise, doubt = PointNoise(0.05**2, 0.0), np.ones(len(points))
    trial = None
    lens = 4 * len(body.shape) + free.index(2) if 2 in free and not prior.shows_lens else None
    for _ in range(NOISE_ROUNDS):
        weight = some.share * doubt / (noise.variance(some.speed) * prior.alike)

        at = partial(_try, points, shear, some, matrix, before, prior, weight)
        trial = at(body, now)
        damping = 0.0
        for _ in range(MAX_STEPS):
            damped = trial.normal + damping * np.diag(np.diag(trial.normal))
            if lens is not None:
                damped[lens, lens] *= FIXED_WEIGHT
            step = np.asarray(np.linalg.solve(damped, trial.pull), np.float64)
            bold = np.abs(step[len(step) - len(free) :])
            step *= min(1.0, float(np.min(limit / np.maximum(bold, 1e-12), initial=1.0)))
            value = trial.camera_state.value.copy()
            value[free] += step[len(step) - len(free) :]
            other = at(trial.body.moved(step), now.at(value))
            # The body once more for this camera: a slant shortens it by more than in proportion.
            own = 4 * len(body.shape)
            refit = np.asarray(np.linalg.solve(other.normal[:own, :own], other.pull[:own]), np.float64)
            settled = at(other.body.moved(refit), other.camera_state)
            other = settled if settled.cost < other.cost else other
            gain = trial.cost - other.cost
            if gain >= 0:
                trial, damping = other, damping / 10
            else:
                damping = max(10 * damping, 1e-3)
            if not abs(gain) >= MIN_GAIN:
                break
        body, now = trial.body, trial.camera_state
        noise, doubt = point_noise(trial.rest, some.mask, some.share, some.speed, len(free), prior)
        if len(body.shape) >= MANY_POINTS:
            some = replace(some, mask=near_ones(some.mask, trial.rest, noise.variance(some.speed)))
    assert trial is not None
    covariance = _covariance(trial.normal, lens, before)
    unknown = np.zeros((4, 4))
    unknown[np.ix_(free, free)] = covariance[len(covariance) - len(free) :, len(covariance) - len(free) :]
    # One noise for all solutions, so that they can be compared.
    usual = some.share / (prior.alike * (prior.floor**2 + (BLUR_SHARE * some.speed) ** 2))
    cost = _try(points, shear, some, matrix, before, prior, usual, body, now).cost
    return Found(replace(now, covariance=unknown), body, noise, covariance, cost)


def _covariance(normal: Array, lens: int | None, before: CameraState) -> Array:
    """Of all that is common; a focal length that the points do not tell is as uncertain as it was before."""
    if lens is None:
        return np.asarray(np.linalg.inv(normal), np.float64)
    others = np.delete(np.arange(len(normal)), lens)
    inverse = np.linalg.inv(normal[np.ix_(others, others)])
    follow = np.zeros(len(normal))
    follow[others], follow[lens] = -inverse @ normal[others, lens], 1.0
    covariance = np.outer(follow, follow) * before.covariance[2, 2]
    covariance[np.ix_(others, others)] += inverse
    return covariance


def _try(
    points: Array,
    shear: Array,
    some: Keyframes,
    matrix: Array,
    before: CameraState,
    prior: BodyPrior,
    weight: Array,
    body: Body,
    camera_state: CameraState,
) -> _Trial:
    seen, _ = fit_pose(points, shear, some.mask, matrix, camera_state, body)
    scaled = weight * seen.scale**2
    normal, pull = common_problem(seen.rest, seen.angle, seen.turned, some.mask, scaled, seen.slopes)
    cost = float(np.sum(scaled[:, None] * np.abs(seen.rest) ** 2))
    cost += add_priors(normal, pull, body, camera_state, before, prior, matrix[0, 0])
    return _Trial(body, camera_state, seen.rest * seen.scale[:, None], cost, normal, pull)
