"""The angle of a body that turns about an axis, from points in pictures.

A camera that does not look along the axis sees circles as ellipses, and at more depth than one. The
picture that it would take if it did look along it is a homography of its own, known up to the axis'
direction and the focal length; in that picture points run on circles (`body`). Direction, focal
length and read-out of the shutter are what makes the circles round, with what is known beforehand.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from sysid.roll import Array
from sysid.video.body import Body, angle_slopes, common_problem, first_body, turn_of
from sysid.video.rectify import Complex, enlargement, longer, rectify, smear, unrectify, unwrap
from sysid.video.unknowns import ROUGH, STEPS, Unknowns, rate_of
from sysid.video.view import Rows, View

SQUARE_SQUEEZE = 0.015
"""Standard deviation of a marker's squareness: one that stands 10 degrees off looks 1.5 % narrower."""
PLANE = 0.002
"""Standard deviation of the circles' centres of points in one plane across the axis, in focal lengths: a
tenth of a focal length aside, at depths that differ by 2 %."""
BLUR_SHARE = 0.06
"""Distance from where they should be that is allowed to points in motion, in steps from frame to frame."""
FLOOR = 0.02
"""Least standard deviation of a point's position [px]: pixels and lens have faults of their own."""
STILL = 0.25
"""Motion up to which a picture is still the same one, with the same errors [px]."""
SAME_NOISE = 0.3
"""Share of the noise from frame to frame below which a picture is an old one."""
SAME = 4
"""Frames of a still picture that are used at most."""
MANY, ASTRAY = 8, 3.0
"""Of so many points those are left out that are so many standard deviations off."""
FEW = 2
"""With so few points a slant to the other side is tried as well."""
ROUNDS = 3
"""Times that the noise is found anew."""
MOST_STEPS = 25
HELD = 1e9
"""Weight that holds what is not to be found."""
ENOUGH = 1e-2
"""Steps end where they gain less than this of the sum of squares, which is in units of the noise."""
MOST_ROWS = 300
"""Frames that are used at most to find the unknowns; the angle is found in all."""


@dataclass(frozen=True, slots=True)
class Turning:
    """How a body turned, as seen by the camera."""

    angle: Array
    """Angle about the axis, clockwise in the picture [rad], shape (n,), unwrapped; NaN where not seen."""
    std: Array
    """Standard deviation of each angle [rad], shape (n,): noise, blur and what is unknown of the camera;
    not a common offset."""
    unknowns: Unknowns
    """What was found of direction, lens and shutter."""
    noise: float
    """Standard deviation of a point's position at rest [px]."""
    outliers: int
    """Frames left out because their points do not fit a turning body."""
    shape: Complex
    """The body's points at angle zero, as a camera along the axis sees them, about their middle."""


@dataclass(frozen=True, slots=True)
class Solid:
    """What is known beforehand of a body."""

    square: bool = False
    """Its points are the corners of a square that stands across the axis (to within 10 degrees), in order."""
    centre_std: float = PLANE
    """Standard deviation of the circles' centres, in focal lengths."""
    alike: float = 1.0
    """How many points share their errors, so that they count as one."""
    floor: float = FLOOR
    """Least standard deviation of a point's position [px]."""
    shows_lens: bool = True
    """Whether its points are known well enough to tell the focal length by; it stays in doubt otherwise."""
    dead_zone: float = 0.0
    """Motion that compression may leave out of the film, to either side [px]: the less contrast, the more."""
    still: float = STILL
    """Motion up to which its points keep their errors [px]."""


@dataclass(frozen=True, slots=True)
class _Some:
    """The frames that tell the unknowns, and how much each does."""

    rows: Rows
    mask: npt.NDArray[np.bool_]
    share: Array
    """One over how many frames show the same still picture, shape (m,)."""
    speed: Array
    """Mean speed of the points [px/frame], shape (m,)."""


def fit_turning(view: View, matrix: Array, before: Unknowns, solid: Solid | None = None) -> Turning:
    """Estimate the angle of a rigid body in every frame.

    Args:
        view: The points.
        matrix: Camera matrix [px], shape (3, 3).
        before: Direction of the axis, focal length and read-out, as known beforehand.
        solid: What is known of the body.

    Returns:
        The angles. Zero is arbitrary here: the attitude in one of the frames.
    """
    solid = solid or Solid()
    some = _telling(view, solid.still)
    found = _solve(view, some, matrix, before, solid, before)
    other = None
    if view.track.points.shape[1] == FEW and {0, 1} <= set(before.free):
        # From afar, a slant to one side and to the other look alike to few points.
        away = found.unknowns.value * [-1, -1, 1, 1] + before.value * [2, 2, 0, 0]
        other = _solve(view, some, matrix, before, solid, found.unknowns.at(away))
        found, other = (other, found) if other.cost < found.cost else (found, other)
    n = len(view)
    angle, misfit, size, speed = np.full(n, np.nan), np.full(n, np.nan), np.ones(n), np.zeros(n)
    for rows in view.chunks():
        seen, mask = _in_view(view, rows, matrix, found)
        good = _enough(mask)
        angle[rows] = np.where(good, seen.angle, np.nan)
        square = (np.abs(seen.rest) ** 2).sum(axis=1) / np.maximum(mask.sum(axis=1), 1)
        misfit[rows] = np.where(good, np.sqrt(square) * seen.scale, np.nan)
        size[rows] = np.where(good, (np.abs(seen.turned) ** 2).sum(axis=1) * seen.scale**2, 1.0)
        speed[rows] = _speed(view, rows)
    wrong = misfit > 12 * (float(np.nanmedian(misfit)) + FLOOR) + BLUR_SHARE * speed
    angle[wrong] = np.nan
    variance = found.noise.variance(speed) * solid.alike / size + _stuck(view, found, solid) ** 2
    variance += _common_variance(view, angle, matrix, found) + smear(angle) ** 2
    if other is not None:
        variance += _either(view, angle, matrix, found, other)
    std = np.sqrt(variance)
    return Turning(
        unwrap(angle),
        np.where(np.isfinite(angle), std, np.nan),
        found.unknowns,
        float(np.sqrt(found.noise.rest)),
        int(wrong.sum()),
        found.body.shape,
    )


@dataclass(frozen=True, slots=True)
class _Noise:
    """Variance of a point's place [px²], at rest and growing with the square of its speed."""

    rest: float
    blur: float

    def variance(self, speed: Array) -> Array:
        return self.rest + self.blur * speed**2


@dataclass(frozen=True, slots=True)
class _Found:
    """What all frames have in common."""

    unknowns: Unknowns
    body: Body
    noise: _Noise
    covariance: Array
    """Of Re c, Im c, Re q, Im q and the free unknowns, shape (4N + p, 4N + p)."""
    cost: float
    """Sum of squares that is left, weighed as usual noise would have it, and of what is known beforehand."""


def _either(view: View, angle: Array, matrix: Array, found: _Found, other: _Found) -> Array:
    """Variance that is left as another slant fits almost as well; less what it does at rest [rad²], shape (n,)."""
    share = 1 / (1 + np.exp(min((other.cost - found.cost) / 2, 50.0)))
    change = np.full(len(view), np.nan)
    for rows in view.chunks():
        seen, _ = _in_view(view, rows, matrix, other)
        change[rows] = np.angle(np.exp(1j * (seen.angle - angle[rows])))
    change = np.angle(np.exp(1j * (change - np.nanmedian(change))))
    return share * np.nan_to_num(change) ** 2


def _stuck(view: View, found: _Found, solid: Solid) -> Array:
    """What a film leaves open that shows a picture again instead of a new one [rad], shape (n,).

    Compression leaves a part of the picture as it is while it changes by little: a deck that hardly moves
    stands still in the film. Its points then do not even scatter from frame to frame as their noise would.
    """
    moved = np.full(len(view), np.inf)
    for rows in view.chunks():
        before = np.maximum(rows - 1, 0)
        with np.errstate(invalid="ignore"):
            step = np.sum(
                (view.track.points[rows].astype(np.float64) - view.track.points[before]) ** 2, axis=2
            )
        count = np.isfinite(step).sum(axis=1)
        mean = np.nansum(step, axis=1) / np.maximum(count, 1)
        moved[rows] = np.where((count > 0) & (rows > 0), mean, np.inf)
    # Of two pictures with noise of their own, a point's places differ by four times its variance in a direction.
    stuck = moved < SAME_NOISE * 4 * found.noise.rest
    reach = float(np.abs(found.body.shape - found.body.shape.mean()).max())
    return np.where(stuck, solid.dead_zone / np.sqrt(3) / reach, 0.0)


def _common_variance(view: View, angle: Array, matrix: Array, found: _Found) -> Array:
    """What common errors, of the body's circles and of the unknowns, do to the angles; less what at rest."""
    readout = found.unknowns.readout
    rate = rate_of(view.time(readout), angle) * (view.share - np.mean(view.share))

    def slopes_of(rows: Rows) -> Array:
        seen, mask = _in_view(view, rows, matrix, found)
        slopes = angle_slopes(seen.angle, seen.turned, mask, seen.slopes)
        if 3 in found.unknowns.free:  # a frame that is read later shows a later angle: that is no error
            slopes[:, -1] -= rate[rows]
        return slopes

    at_rest = np.nanargmin(np.abs(angle - np.nanmedian(angle)))
    rest = slopes_of(np.array([at_rest], np.intp))
    variance, shutter = np.zeros(len(angle)), np.zeros(len(angle))
    for rows in view.chunks():
        slopes = slopes_of(rows) - rest
        variance[rows] = np.einsum("ni,ij,nj->n", slopes, found.covariance, slopes, optimize=True)
        shutter[rows] = slopes[:, -1]
    if 3 not in found.unknowns.free:
        return variance
    # The shutter's correction takes velocities from neighbouring frames: it is as good as they are alike.
    jump = np.abs(np.diff(shutter, prepend=shutter[:1], append=shutter[-1:]))
    return variance + (ROUGH * np.fmax(jump[1:], jump[:-1]) * readout) ** 2


def _in_view(view: View, rows: Rows, matrix: Array, found: _Found) -> "tuple[_Seen, npt.NDArray[np.bool_]]":
    points = view.points(rows)
    mask = _all_finite(points)
    shear = view.shear(rows)
    seen, _ = _seen(points, shear, mask, matrix, found.unknowns, found.body)
    if mask.shape[1] >= MANY:
        variance = found.noise.variance(_speed(view, rows))
        for _ in range(3):  # many that slip turn the body at first, so that it takes more than one look
            mask = _near(mask, seen.rest * seen.scale[:, None], variance)
            seen, _ = _seen(points, shear, mask, matrix, found.unknowns, found.body)
    return seen, mask


def _near(mask: npt.NDArray[np.bool_], rest: Complex, variance: Array) -> npt.NDArray[np.bool_]:
    """Points that are about where the body has them: of many, some slip. The better half where most seem to."""
    distance = np.where(mask, np.abs(rest), np.inf)
    near = mask & (distance < ASTRAY * np.sqrt(2 * variance)[:, None])
    count = mask.sum(axis=1)
    most = near.sum(axis=1) >= np.maximum(0.5 * count, MANY)
    half = np.sort(distance, axis=1)[
        np.arange(len(count)), np.minimum(np.maximum(count // 2, MANY), mask.shape[1] - 1)
    ]
    return np.asarray(np.where(most[:, None], near, mask & (distance <= half[:, None])), np.bool_)


def _all_finite(points: Array) -> npt.NDArray[np.bool_]:
    return np.asarray(np.isfinite(points).all(axis=-1), np.bool_)


@dataclass(frozen=True, slots=True)
class _Seen:
    """Some frames as a camera along the axis sees them, with a body laid onto them."""

    angle: Array
    rest: Complex
    """What does not fit [px, rectified], shape (m, N)."""
    turned: Complex
    slopes: Complex
    """Derivatives of the places by the free unknowns, shape (p, m, N)."""
    scale: Array
    """Pixels of the picture in one of the rectified one, shape (m,)."""


def _seen(
    points: Array,
    shear: Array,
    mask: npt.NDArray[np.bool_],
    matrix: Array,
    unknowns: Unknowns,
    body: Body | None,
) -> tuple[_Seen, Body]:
    yaw, pitch, logarithm, readout = unknowns.value
    camera = longer(matrix, logarithm)
    # In pixels, so that a longer lens alone changes nothing but the perspective.
    z = camera[0, 0] * rectify(np.where(mask[..., None], points + readout * shear, 0), camera, yaw, pitch)
    body = body or first_body(z, mask)
    angle, rest, turned = turn_of(z, mask, body)
    # Derivatives at the places without their noise: with it, noise would pass for a slant.
    clean = z - rest
    still = unrectify(clean / camera[0, 0], camera, yaw, pitch) - readout * shear
    slopes: list[Complex] = []
    for number in unknowns.free:
        moved = unknowns.value.copy()
        moved[number] += STEPS[number]
        other = longer(matrix, moved[2])
        there = other[0, 0] * rectify(still + moved[3] * shear, other, moved[0], moved[1])
        slopes.append((there - clean) / STEPS[number])
    middle = np.where(mask, clean, 0).sum(axis=1) / np.maximum(mask.sum(axis=1), 1)
    scale = 1 / enlargement(middle / camera[0, 0], yaw, pitch)
    return _Seen(angle, rest, turned, np.array(slopes).reshape(len(slopes), *z.shape), scale), body


def _enough(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    return mask.sum(axis=1) >= max(2, min(mask.shape[1], 4) - 1)


def _speed(view: View, rows: Rows) -> Array:
    """Mean speed of the points [px/frame], the larger one of before and after each frame."""
    here = np.clip(rows[:, None] + np.arange(-1, 2), 0, len(view) - 1)
    with np.errstate(invalid="ignore"):
        moved = np.linalg.norm(np.diff(view.track.points[here], axis=1), axis=-1)
    count = np.isfinite(moved).sum(axis=2)
    return (np.nansum(moved, axis=2) / np.maximum(count, 1)).max(axis=1)


def _telling(view: View, still: float) -> _Some:
    """Choose frames: few of those that show one and the same picture, many of those turned furthest."""
    seen = np.zeros(len(view), bool)
    run = np.zeros(len(view), int)
    place = np.zeros((len(view), 2))
    anchor, number = np.full(view.track.points.shape[1:], np.inf), 0
    # Freed of the camera's shake: what a lens, a shade or a slant does to a point goes with the body's attitude.
    steady = np.concatenate([view.points(rows) for rows in view.chunks()])
    for row in range(len(view)):
        points = steady[row]
        with np.errstate(invalid="ignore"):
            away = np.abs(points - anchor)
        known = np.isfinite(away)
        # Of many points some slip: the picture is another one if half of them have moved.
        moved = np.median if len(points) >= MANY else np.max
        if not known.any() or moved(away[known]) > still:
            anchor, number = points, number + 1
        run[row] = number
        good = np.isfinite(points).all(axis=-1)
        seen[row] = _enough(good[None])[0]
        if seen[row]:
            place[row] = points[good][-1] - points[good][0]
    usable = np.flatnonzero(seen)
    if len(usable) > 2:  # a frame without neighbours shows no velocity
        usable = usable[(usable > 0) & (usable < len(view) - 1)]
    _, first, count = np.unique(run[usable], return_index=True, return_counts=True)
    kept = np.concatenate(
        [
            usable[begin + np.unique(np.linspace(0, many - 1, min(many, SAME)).astype(int))]
            for begin, many in zip(first, count, strict=True)
        ]
    )
    if len(kept) > MOST_ROWS:
        direction = np.angle(place[kept] @ np.array([1, 1j]))
        away = np.abs(np.angle(np.exp(1j * (direction - np.median(direction)))))
        far = np.argsort(-away)[: 2 * MOST_ROWS // 3]
        even = np.linspace(0, len(kept) - 1, MOST_ROWS // 3).astype(int)
        kept = kept[np.unique(np.concatenate([far, even]))]
    _, inverse, count = np.unique(run[kept], return_inverse=True, return_counts=True)
    return _Some(kept, _all_finite(view.points(kept)), 1 / count[inverse], _speed(view, kept))


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


def _solve(view: View, some: _Some, matrix: Array, before: Unknowns, solid: Solid, start: Unknowns) -> _Found:
    """Find body and unknowns by damped Gauss-Newton steps; three times, as the noise weighs the frames."""
    points, shear = view.points(some.rows), view.shear(some.rows)
    free = before.free
    limit = np.array([0.15, 0.15, 0.4, np.inf])[free]
    now = before.at(start.value)
    _, body = _seen(points, shear, some.mask, matrix, now, None)
    noise, doubt = _Noise(0.05**2, 0.0), np.ones(len(points))
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
        noise, doubt = _noise(trial.rest, some, len(free), solid)
        if len(body.shape) >= MANY:
            some = replace(some, mask=_near(some.mask, trial.rest, noise.variance(some.speed)))
    assert trial is not None
    covariance = _covariance(trial.normal, lens, before)
    unknown = np.zeros((4, 4))
    unknown[np.ix_(free, free)] = covariance[len(covariance) - len(free) :, len(covariance) - len(free) :]
    # One noise for all solutions, so that they can be compared.
    usual = some.share / (solid.alike * (solid.floor**2 + (BLUR_SHARE * some.speed) ** 2))
    cost = _try(points, shear, some, matrix, before, solid, usual, body, now).cost
    return _Found(replace(now, covariance=unknown), body, noise, covariance, cost)


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
    some: _Some,
    matrix: Array,
    before: Unknowns,
    solid: Solid,
    weight: Array,
    body: Body,
    unknowns: Unknowns,
) -> _Trial:
    seen, _ = _seen(points, shear, some.mask, matrix, unknowns, body)
    scaled = weight * seen.scale**2
    normal, pull = common_problem(seen.rest, seen.angle, seen.turned, some.mask, scaled, seen.slopes)
    cost = float(np.sum(scaled[:, None] * np.abs(seen.rest) ** 2))
    cost += _add_priors(normal, pull, body, unknowns, before, solid, matrix[0, 0])
    return _Trial(body, unknowns, seen.rest * seen.scale[:, None], cost, normal, pull)


def _add_priors(
    normal: Array, pull: Array, body: Body, now: Unknowns, before: Unknowns, solid: Solid, focal: float
) -> float:
    """Add what is known beforehand to the normal equations, in place; return its cost."""
    size = len(body.shape)
    length = np.sqrt(np.mean(np.abs(body.shape) ** 2))
    diagonal = np.arange(2 * size)
    tight = (solid.centre_std * focal) ** -2
    normal[diagonal, diagonal] += tight
    centre = np.concatenate([body.centre.real, body.centre.imag])
    pull[diagonal] -= centre * tight
    cost = float(centre @ centre) * tight
    normal[diagonal + 2 * size, diagonal + 2 * size] += length**-2  # a hair: shift and turn are free
    if solid.square:
        ideal = np.exp(1j * np.pi / 2 * np.arange(size))
        off = (np.eye(size) - np.outer(ideal, ideal.conj()) / size) / (SQUARE_SQUEEZE * length) ** 2
        shape = slice(2 * size, 4 * size)
        normal[shape, shape] += np.block([[off.real, -off.imag], [off.imag, off.real]])
        wrong = off @ body.shape
        pull[shape] -= np.concatenate([wrong.real, wrong.imag])
        cost += float(np.vdot(body.shape, wrong).real)
    if free := before.free:
        prior = np.linalg.inv(before.covariance[np.ix_(free, free)])
        moved = now.value[free] - before.value[free]
        normal[4 * size :, 4 * size :] += prior
        pull[4 * size :] -= prior @ moved
        cost += float(moved @ prior @ moved)
    return cost


def _noise(rest: Complex, some: _Some, unknowns: int, solid: Solid) -> tuple[_Noise, Array]:
    """Noise from what does not fit [px], and how much each frame is to be believed, from 0 to 1."""
    freedom = np.maximum(2 * some.mask.sum(axis=1) - 3, 1)
    square = (np.abs(rest) ** 2).sum(axis=1) / freedom
    typical = float(np.median(square)) + FLOOR**2 + (BLUR_SHARE * some.speed) ** 2
    doubt = 1 / (1 + square / (9 * typical)) ** 2
    weight = freedom * some.share
    spent = min(0.7, (4 * some.mask.shape[1] - 5 + unknowns) / float(weight.sum()))
    used = square < 25 * typical
    slow = used & (some.speed <= np.median(some.speed[used]))
    at_rest = float(np.average(square[slow], weights=weight[slow])) / (1 - spent) + solid.floor**2
    fast = used & (some.speed > 0.5)
    blur = 0.0
    if fast.sum() >= 3:
        speed = some.speed[fast]
        share = weight[fast] * speed**2 / (at_rest + 1e-3 * speed**2) ** 2
        blur = float(max(np.sum(share * (square[fast] - at_rest)) / np.sum(share * speed**2), 0.0))
    return _Noise(at_rest, blur), doubt
