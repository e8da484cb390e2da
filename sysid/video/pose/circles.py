"""Direction of the axis, lens and shutter with which the points of a turning body run on circles."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sysid.roll import Array
from sysid.video.pose.body import Body, common_problem
from sysid.video.pose.camera_state import Unknowns
from sysid.video.pose.keyframes import TellingFrames
from sysid.video.pose.placed_body import Found, lay_body
from sysid.video.pose.point_noise import BLUR_SHARE, MANY, PointNoise, near_ones, point_noise
from sysid.video.pose.prior import Solid, add_priors
from sysid.video.pose.rectify import Complex
from sysid.video.pose.view import View

ROUNDS = 3
"""Times that the noise is found anew."""
MOST_STEPS = 25
HELD = 1e9
"""Weight that holds what is not to be found."""
ENOUGH = 1e-2
"""Steps end where they gain less than this of the sum of squares, which is in units of the noise."""


@dataclass(frozen=True, slots=True)
class _Trial:
    """Body and unknowns, and how well they fit."""

    body: Body
    unknowns: Unknowns
    rest: Complex
    """What does not fit, shape (m, N)."""
    cost: float
    normal: Array
    pull: Array


def fit_circles(
    view: View, some: TellingFrames, matrix: Array, before: Unknowns, solid: Solid, start: Unknowns
) -> Found:
    """Find body and unknowns by damped Gauss-Newton steps; three times, as the noise weighs the frames."""
    points, shear = view.points(some.rows), view.shear(some.rows)
    free = before.free
    limit = np.array([0.15, 0.15, 0.4, np.inf])[free]
    now = before.at(start.value)
    _, body = lay_body(points, shear, some.mask, matrix, now, None)
    noise, doubt = PointNoise(0.05**2, 0.0), np.ones(len(points))
    trial = None
    lens = 4 * len(body.shape) + free.index(2) if 2 in free and not solid.shows_lens else None
    for _ in range(ROUNDS):
        weight = some.share * doubt / (noise.variance(some.speed) * solid.alike)

        at = partial(_try, points, shear, some, matrix, before, solid, weight)
        trial = at(body, now)
        damping = 0.0
        for _ in range(MOST_STEPS):
            damped = trial.normal + damping * np.diag(np.diag(trial.normal))
            if lens is not None:
                damped[lens, lens] *= HELD
            step = np.asarray(np.linalg.solve(damped, trial.pull), np.float64)
            bold = np.abs(step[len(step) - len(free) :])
            step *= min(1.0, float(np.min(limit / np.maximum(bold, 1e-12), initial=1.0)))
            value = trial.unknowns.value.copy()
            value[free] += step[len(step) - len(free) :]
            other = at(trial.body.moved(step), now.at(value))
            # The body once more for these unknowns: a slant shortens it by more than in proportion.
            own = 4 * len(body.shape)
            refit = np.asarray(np.linalg.solve(other.normal[:own, :own], other.pull[:own]), np.float64)
            settled = at(other.body.moved(refit), other.unknowns)
            other = settled if settled.cost < other.cost else other
            gain = trial.cost - other.cost
            if gain >= 0:
                trial, damping = other, damping / 10
            else:
                damping = max(10 * damping, 1e-3)
            if not abs(gain) >= ENOUGH:
                break
        body, now = trial.body, trial.unknowns
        noise, doubt = point_noise(trial.rest, some.mask, some.share, some.speed, len(free), solid)
        if len(body.shape) >= MANY:
            some = replace(some, mask=near_ones(some.mask, trial.rest, noise.variance(some.speed)))
    assert trial is not None
    covariance = _covariance(trial.normal, lens, before)
    unknown = np.zeros((4, 4))
    unknown[np.ix_(free, free)] = covariance[len(covariance) - len(free) :, len(covariance) - len(free) :]
    # One noise for all solutions, so that they can be compared.
    usual = some.share / (solid.alike * (solid.floor**2 + (BLUR_SHARE * some.speed) ** 2))
    cost = _try(points, shear, some, matrix, before, solid, usual, body, now).cost
    return Found(replace(now, covariance=unknown), body, noise, covariance, cost)


def _covariance(normal: Array, lens: int | None, before: Unknowns) -> Array:
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
    some: TellingFrames,
    matrix: Array,
    before: Unknowns,
    solid: Solid,
    weight: Array,
    body: Body,
    unknowns: Unknowns,
) -> _Trial:
    seen, _ = lay_body(points, shear, some.mask, matrix, unknowns, body)
    scaled = weight * seen.scale**2
    normal, pull = common_problem(seen.rest, seen.angle, seen.turned, some.mask, scaled, seen.slopes)
    cost = float(np.sum(scaled[:, None] * np.abs(seen.rest) ** 2))
    cost += add_priors(normal, pull, body, unknowns, before, solid, matrix[0, 0])
    return _Trial(body, unknowns, seen.rest * seen.scale[:, None], cost, normal, pull)
