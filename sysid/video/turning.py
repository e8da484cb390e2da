"""The angle of a body that turns about a fixed direction, from points on it seen by a tilted camera.

Turn the camera in thought until it looks along the axis: that is a homography of the picture, known
up to the axis' direction (`yaw`, `pitch`). In the picture it then takes, every point of the body,
whatever its depth, runs on a circle: with complex numbers for picture coordinates,

    z_ij = τ_i + c_j + exp(i φ_i) q_j.

φ_i is the roll in frame i, τ_i a shift of the whole body (a truck that gives way; never an angle), q_j
the body's shape and c_j the centres of its points' circles, which differ if their depths do and the
axis is not in the middle of the picture. The axis' direction is what makes the circles round.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sysid.roll import Array

Complex = npt.NDArray[np.complex128]

SQUARE_PRIOR = np.radians(15.0)
"""Standard deviation of yaw and pitch before anything is seen: people stand about square [rad]."""
CENTRE_PRIOR = 0.02
"""Standard deviation of the circles' centres before anything is seen, in sizes of the body."""
SQUARE_SQUEEZE = 0.015
"""Standard deviation of a marker's squareness: one that stands 10 degrees off looks 1.5 % narrower."""
BLUR_SHARE = 0.06
"""Distance from where they should be that is allowed to points in motion, in steps from frame to frame."""
FLOOR = 0.02
"""Least standard deviation of a point's position [px]: pixels and lens have faults of their own."""


@dataclass(frozen=True, slots=True)
class Turning:
    """How a body turned, as seen by the camera."""

    angle: Array
    """Angle about the axis, clockwise in the picture [rad], shape (n,), unwrapped; NaN where not seen."""
    std: Array
    """Standard deviation of each angle [rad], shape (n,): noise, blur and the axis' direction; not a
    common offset."""
    yaw: float
    """Direction of the axis, to the right of the optical axis [rad]."""
    pitch: float
    """Direction of the axis, downwards [rad]."""
    direction_std: float
    """Standard deviation of that direction [rad]: the root mean square of both."""
    noise: float
    """Standard deviation of a point's position at rest [px]."""
    blur: float
    """Growth of that deviation with speed [px per px/frame]."""
    outliers: int
    """Frames left out because their points do not fit a turning body."""
    misfit: Array
    """Sum of the squared distances of a frame's points from where they should be [px^2], shape (n,)."""
    shape: Complex
    """The body's points at angle zero, as a camera along the axis sees them, about their middle."""


@dataclass(frozen=True, slots=True)
class _State:
    angle: Array
    shift: Complex
    shape: Complex
    centre: Complex
    residual: Complex


def rectify(points: Array, matrix: Array, yaw: float, pitch: float) -> Complex:
    """Return points (..., 2) [px] as a camera looking along the axis would see them, x + i y (y down)."""
    ray = _rays(points, matrix) @ _look(yaw, pitch)
    return ray[..., 0] / ray[..., 2] + 1j * (ray[..., 1] / ray[..., 2])


def fit_turning(
    points: Array,
    matrix: Array,
    *,
    direction: tuple[float, float] | None = None,
    square: bool = False,
    alike: float = 1.0,
    floor: float = FLOOR,
) -> Turning:
    """Estimate the angle of a rigid body in every frame.

    Args:
        points: Picture coordinates of N points on the body [px], shape (n, N, 2); NaN where not seen.
        matrix: Camera matrix [px], shape (3, 3).
        direction: Yaw and pitch of the axis [rad], where known; estimated otherwise.
        square: The points are the corners of a square that stands across the axis (to within 10
            degrees), in order around it.
        alike: How many points share their errors, so that they count as one.
        floor: Least standard deviation of a point's position [px].

    Returns:
        The angles. Zero is arbitrary here: the first point lies in direction 0 from the second.
    """
    seen = np.isfinite(points).all(axis=-1)
    keep = seen.sum(axis=1) >= max(2, min(points.shape[1], 4) - 1)
    state, yaw, pitch, covariance = _solve(points, seen & keep[:, None], matrix, direction, square)
    keep, outliers = _without_outliers(state, seen & keep[:, None], keep, points, matrix)
    mask = seen & keep[:, None]
    state, yaw, pitch, covariance = _solve(points, mask, matrix, direction, square)
    noise, blur, per_frame = _noise(state, mask, points, matrix, floor)
    information = _information(state, mask) / alike
    variance = (per_frame / matrix[0, 0]) ** 2 / information
    variance = variance + alike * _centre_variance(state, mask, noise / matrix[0, 0])
    direction_std = 0.0
    if direction is None:
        variance = variance + _direction_variance(points, mask, matrix, state, yaw, pitch, alike * covariance)
        direction_std = float(np.sqrt(alike * np.trace(covariance) / 2))
    angle = np.where(keep, state.angle, np.nan)
    std = np.where(keep, np.sqrt(variance + smear(angle) ** 2), np.nan)
    shape = state.shape - state.shape.mean()
    misfit = np.where(keep, (np.abs(state.residual) ** 2).sum(axis=1) * matrix[0, 0] ** 2, np.nan)
    return Turning(unwrap(angle), std, yaw, pitch, direction_std, noise, blur, outliers, misfit, shape)


def _rays(points: Array, matrix: Array) -> Array:
    homogeneous = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
    return homogeneous @ np.linalg.inv(matrix).T


def _look(yaw: float, pitch: float) -> Array:
    """Axes of the camera that looks along the axis, as columns, without a twist about it."""
    turn = np.hypot(yaw, pitch)
    if turn < 1e-12:
        return np.eye(3)
    # The axis is the optical axis turned to the right by yaw and down by pitch.
    vector = np.array([-pitch, yaw, 0.0]) / turn
    cross = np.array([[0, 0, vector[1]], [0, 0, -vector[0]], [-vector[1], vector[0], 0]])
    return np.eye(3) + np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross


def _solve(
    points: Array,
    mask: npt.NDArray[np.bool_],
    matrix: Array,
    direction: tuple[float, float] | None,
    square: bool,
) -> tuple[_State, float, float, Array]:
    """Fit direction and everything that follows from it; the covariance is in units of the noise."""
    from scipy.optimize import least_squares

    def state_at(parameters: Array) -> _State:
        return _procrustes(rectify(points, matrix, parameters[0], parameters[1]), mask)

    if direction is not None:
        return state_at(np.array(direction)), *direction, np.zeros((2, 2))
    # A few hundred frames, those turned furthest from the middle among them, tell the direction.
    start = state_at(np.zeros(2))
    rows = _telling_frames(start.angle, mask)
    some, some_mask = points[rows], mask[rows]
    size = np.sqrt(np.mean(np.abs(start.shape) ** 2))

    def residuals(parameters: Array, noise: float) -> Array:
        yaw, pitch = parameters - 1  # about one, because steps of derivatives are relative
        state = _procrustes(rectify(some, matrix, yaw, pitch), some_mask)
        parts = [state.residual[some_mask] / noise]
        if square:
            ideal = np.exp(1j * np.pi / 2 * np.arange(4))
            first = np.vdot(ideal, state.shape) / 4
            parts.append((state.shape - first * ideal) / (SQUARE_SQUEEZE * size))
        values = np.concatenate(parts)
        return np.concatenate([values.real, values.imag, (parameters - 1) / SQUARE_PRIOR])

    parameters, state, covariance = np.ones(2), start, np.eye(2)
    for _ in range(2):  # the weight of the priors depends on the noise, which depends on the direction
        noise = np.sqrt(np.mean(np.abs(state.residual[mask]) ** 2) / 2) + 0.5 * FLOOR / matrix[0, 0]
        fit = least_squares(
            residuals, parameters, diff_step=2e-3, loss="soft_l1", max_nfev=20, args=(float(noise),)
        )
        parameters, state = fit.x, state_at(fit.x - 1)
        covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    return state, float(parameters[0] - 1), float(parameters[1] - 1), covariance


def _telling_frames(angle: Array, mask: npt.NDArray[np.bool_], count: int = 300) -> npt.NDArray[np.intp]:
    usable = np.flatnonzero(mask.sum(axis=1) >= 2)
    if len(usable) <= count:
        return usable
    away = np.abs(angle[usable] - np.median(angle[usable]))
    far = usable[np.argsort(-away)[: 2 * count // 3]]
    even = usable[np.linspace(0, len(usable) - 1, count // 3).astype(int)]
    return np.unique(np.concatenate([far, even]))


def _procrustes(z: Complex, mask: npt.NDArray[np.bool_]) -> _State:
    """Alternate between angles and shape until they agree (generalised Procrustes, no scaling)."""
    weight = mask.astype(np.float64)
    count = np.maximum(weight.sum(axis=1), 1)
    full = np.flatnonzero(mask.all(axis=1)) if mask.all(axis=1).any() else np.argsort(-weight.sum(axis=1))[:1]
    z = np.where(mask, z, 0)
    shape = z[full[0]] - z[full[0]][mask[full[0]]].mean()
    shape = np.where(mask[full[0]], shape, 0)
    centre = np.zeros(z.shape[1], np.complex128)
    angle, shift = np.zeros(len(z)), np.zeros(len(z), np.complex128)
    ridge = 1 / CENTRE_PRIOR**2
    rotation = np.exp(1j * angle)
    for _ in range(12):
        body = z - weight * centre
        mean_body = body.sum(axis=1) / count
        mean_shape = (weight * shape).sum(axis=1) / count
        turned = (weight * np.conj(shape - mean_shape[:, None]) * (body - mean_body[:, None])).sum(axis=1)
        before, angle = angle, np.angle(turned)
        rotation = np.exp(1j * angle)
        shift = mean_body - rotation * mean_shape
        shape, centre = _circles(z - weight * shift[:, None], rotation, weight, ridge)
        if np.abs(np.exp(1j * (angle - before)) - 1).max() < 1e-7:
            break
    residual = weight * (z - shift[:, None] - centre - rotation[:, None] * shape)
    return _State(angle, shift, shape, centre, residual)


def _circles(z: Complex, rotation: Complex, weight: Array, ridge: float) -> tuple[Complex, Complex]:
    """Least squares for every point's circle z_i = c + rotation_i q, with a weak pull of c to zero."""
    n = np.maximum(weight.sum(axis=0), 1)
    mean_rotation = (weight * rotation[:, None]).sum(axis=0) / n
    shape = (weight * np.conj(rotation)[:, None] * z).sum(axis=0) / n
    mean = z.sum(axis=0) / n
    # Noise of about 1e-3 sizes a point and frame sets how soon the data outweigh the pull.
    information = n * (1 - np.abs(mean_rotation) ** 2) / 1e-6
    centre = (mean - mean_rotation * shape) / np.maximum(1 - np.abs(mean_rotation) ** 2, 1e-12)
    centre = centre * information / (information + ridge)
    centre = centre - centre.mean()
    shape = shape - centre * np.conj(mean_rotation)
    return shape, centre


def _information(state: _State, mask: npt.NDArray[np.bool_]) -> Array:
    count = np.maximum(mask.sum(axis=1), 1)
    mean = (mask * state.shape).sum(axis=1) / count
    return np.maximum((mask * np.abs(state.shape - mean[:, None]) ** 2).sum(axis=1), 1e-18)


def _without_outliers(
    state: _State, mask: npt.NDArray[np.bool_], keep: npt.NDArray[np.bool_], points: Array, matrix: Array
) -> tuple[npt.NDArray[np.bool_], int]:
    """Drop frames whose points fit far worse than those of frames at the same speed do."""
    error = (
        np.sqrt((np.abs(state.residual) ** 2).sum(axis=1) / np.maximum(mask.sum(axis=1), 1)) * matrix[0, 0]
    )
    typical = np.median(error[keep]) + 0.02
    good = keep & (error < 12 * typical + BLUR_SHARE * _speed(points))
    return good, int(keep.sum() - good.sum())


def _noise(
    state: _State, mask: npt.NDArray[np.bool_], points: Array, matrix: Array, floor: float
) -> tuple[float, float, Array]:
    """Noise at rest [px], its growth with speed, and each frame's noise [px], from what does not fit."""
    seen = mask.sum(axis=1)
    freedom = np.maximum(2 * seen - 3, 0)
    used = freedom > 0
    square = (np.abs(state.residual) ** 2).sum(axis=1) * matrix[0, 0] ** 2 / np.maximum(freedom, 1)
    speed = _speed(points)
    slow = used & (speed <= np.median(speed[used]))
    rest = float(np.average(square[slow], weights=freedom[slow])) + floor**2
    fast = used & (speed > 0.5)
    blur = 0.0
    if fast.sum() >= 3:
        weight = freedom[fast] * speed[fast] ** 2 / (rest + 1e-3 * speed[fast] ** 2) ** 2
        blur = float(max(np.sum(weight * (square[fast] - rest)) / np.sum(weight * speed[fast] ** 2), 0.0))
    return np.sqrt(rest), np.sqrt(blur), np.sqrt(rest + blur * speed**2)


def _speed(points: Array) -> Array:
    """Mean speed of the points [px/frame], shape (n,), from neighbouring frames."""
    with np.errstate(invalid="ignore"):
        moved = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    count = np.isfinite(moved).sum(axis=1)
    step = np.where(count > 0, np.nansum(moved, axis=1) / np.maximum(count, 1), 0.0)
    return np.maximum(np.append(step, 0.0), np.insert(step, 0, 0.0))


def _centre_variance(state: _State, mask: npt.NDArray[np.bool_], noise: float) -> Array:
    """What the uncertainty of the circles' centres does to the angles, less what it does at rest."""
    rotation = np.exp(1j * state.angle[mask.any(axis=1)])
    n = len(rotation)
    information = n * (1 - np.abs(rotation.mean()) ** 2) + noise**2 / (
        CENTRE_PRIOR**2 * np.mean(np.abs(state.shape) ** 2) + 1e-18
    )
    size = (np.abs(state.shape - state.shape.mean()) ** 2).sum()
    rest = np.exp(1j * np.median(state.angle))
    return (
        noise**2 / max(information, 1e-12) * np.abs(np.exp(1j * state.angle) - rest) ** 2 / max(size, 1e-18)
    )


def _direction_variance(
    points: Array,
    mask: npt.NDArray[np.bool_],
    matrix: Array,
    state: _State,
    yaw: float,
    pitch: float,
    covariance: Array,
) -> Array:
    """What the uncertainty of the axis' direction does to the angles, less what it does at rest."""
    columns: list[Array] = []
    for number in range(2):
        step = 0.01
        moved = np.array([yaw, pitch])
        moved[number] += step
        other = _procrustes(rectify(points, matrix, moved[0], moved[1]), mask)
        change = np.angle(np.exp(1j * (other.angle - state.angle))) / step
        columns.append(change - np.median(change[mask.any(axis=1)]))
    jacobian = np.stack(columns, axis=1)
    return np.einsum("ni,ij,nj->n", jacobian, covariance, jacobian)


def smear(angle: Array) -> Array:
    """What an unknown exposure does: a smeared body is seen at its mean, not at the middle of the exposure.

    The mean over an exposure T is off by φ̈ T²/24; for T anywhere between 0 and the frame interval the
    root mean square of that is the second difference of the angle over 54.
    """
    smear = np.zeros(len(angle))
    with np.errstate(invalid="ignore"):
        smear[1:-1] = np.abs(np.diff(np.exp(1j * angle), n=2)) / 54
    return np.where(np.isfinite(smear), smear, 0.0)


def unwrap(angle: Array) -> Array:
    """Return the angles without jumps of whole turns, past the NaN of frames that show nothing."""
    good = np.isfinite(angle)
    result = angle.copy()
    result[good] = np.unwrap(angle[good])
    return result
