"""The angle of a sensor that turns about one axis, from gyro and accelerometer together, or from the accelerometer alone.

Least squares over the whole record finds the angle φ at the edges of short blocks, and the constants of the sensors. Each
block measures the angles at its edges. The gyro's mean rate is their difference, but for its offset b and gain error
c. The two accelerations square to the axis, as one complex number, are

    a = G e^(iφ) - (i φ̈ + φ̇²) ρ

with gravity G and the lever arm ρ from the axis to the accelerometer. The angles have no prior, so the estimate is
unbiased. Each sensor counts by its noise: the gyro in fast motion, gravity in slow motion. A linear filter
that treats all times alike leaves the frequency and the damping of a decay as they are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sysid.logs.table.clock import GAP
from sysid.logs.table.names import ACCEL_UNITS
from sysid.roll import Array

PER_SWING = 20
"""Blocks in a period: their mean takes (π/20)²/6 = 0.4 % of a swing's amplitude, from gyro and accelerometer alike."""
ROUNDS = 8
"""Steps of a search that begins nearby; of Gauss and Newton, the fourth moves the angle by less than rounding."""
GAIN_STD = 0.02
"""Typical gain error of a MEMS gyro, as a share: 1 to 3 % in data sheets."""
NODES = 6
"""Edges that give a block its means: the mean of a second derivative, to fourth order."""
ARM_STD = 0.5
"""Standard deviation of a lever arm on a board, before it is known [m]."""


def _cell_mean(derivative: int) -> Array:
    """Return the weights of nodes that give the mean of a derivative between the middle two, in steps of the nodes.

    They are exact for polynomials through six nodes: the mean of a derivative is the difference of the one below at the
    ends. The slope needs the middle two.
    """
    at = np.arange(NODES) - (NODES - 1) / 2
    powers = [np.polynomial.Polynomial.basis(power) for power in range(NODES)]
    lower = [one.deriv(derivative - 1) if derivative else one.integ() for one in powers]
    means = np.array([one(0.5) - one(-0.5) for one in lower], dtype=np.float64)
    weights = np.linalg.solve(np.vander(at, increasing=True).T, means)
    return np.trim_zeros(np.round(np.asarray(weights, dtype=np.float64), 12))


EDGES, _SLOPE, _BEND = (_cell_mean(derivative) for derivative in range(3))
"""Mean of a value, of its slope and of its second derivative."""
_ROUGH = np.diff(np.eye(5), 4, axis=0)
"""Fourth difference, in steps of the nodes."""


@dataclass(frozen=True, slots=True)
class Blocks:
    """Sensors, averaged over blocks of an even clock."""

    edges: Array
    """Times of the blocks' edges [s], shape (n + 1,)."""
    rate: Array | None
    """Mean rate about the axis [rad/s], shape (n,); None without a gyro."""
    accel: npt.NDArray[np.complex128]
    """Mean acceleration square to the axis, in m/s², complex: along the zero of the angle and to its left, shape (n,)."""
    rate_std: float
    """Of a block's mean rate [rad/s]."""
    accel_std: Array
    """Of a component of a block's mean acceleration [m/s²], shape (n,)."""


@dataclass(frozen=True, slots=True)
class Swing:
    """Result of gyro and accelerometer together."""

    angle: Array
    """At the blocks' edges [rad], shape (n + 1,)."""
    offset: float
    """Of the gyro [rad/s]."""
    gain: float
    """Rate of the sensor over its reading [1]."""
    gravity: float
    """As the accelerations have it [m/s²]; it lies along the zero of the angle."""
    arm: complex
    """From the axis to the accelerometer, in the same axes [m]."""
    std: Array
    """Standard deviations of offset [rad/s], gain [1], gravity [m/s²] and arm (2) [m], shape (5,)."""
    left: npt.NDArray[np.complex128]
    """Residual acceleration, complex [m/s²], shape (n,)."""
    cost: float
    """Half the sum of squares, in deviations [1]."""


def smooth_swing(
    blocks: Blocks,
    start: Array,
    *,
    arm: complex | None = None,
    first: complex = 0j,
    gain_std: float = GAIN_STD,
    stiff: float = 0.0,
) -> Swing:
    """Find angle, offset, gain, gravity and lever arm.

    Args:
        blocks: The measurement.
        start: First guess of the angle at the blocks' edges [rad], shape (n + 1,).
        arm: The lever arm [m], where it is known.
        first: First guess of the lever arm [m].
        gain_std: Of the gyro's gain error [1].
        stiff: Standard deviation of the fourth difference of the angle [rad]; 0 for none, which needs a gyro.
    """
    from scipy import sparse
    from scipy.sparse.linalg import splu

    n, has_gyro = len(blocks.accel), blocks.rate is not None
    phi, rho = start.copy(), first if arm is None else arm
    const = np.array([0.0, 0.0, ACCEL_UNITS["g"], rho.real, rho.imag])
    prior = np.array([np.inf, gain_std, np.inf, ARM_STD, ARM_STD])
    free = np.array([has_gyro, has_gyro, True, arm is None, arm is None])
    cost, now, left, inverse = np.inf, np.inf, np.zeros(n, complex), np.eye(5)
    parts = _linear_parts(blocks)
    rough: Any = _stencil(_ROUGH, n - 3, n + 1) / stiff if stiff > 0 else sparse.csr_matrix((0, n + 1))
    for _ in range(ROUNDS):
        left, by_angle, by_const = _accelerations(blocks, parts, phi, const)
        rates, gyro, by_gyro = _rates(blocks, parts, phi, const)
        angles = sparse.vstack([by_angle.real, by_angle.imag, gyro, rough]).tocsc()
        smooth = np.zeros((rough.shape[0], 5))
        constants = np.vstack([by_const.real, by_const.imag, by_gyro, smooth]) * free
        weighted = left * parts.weight
        residual = np.concatenate([weighted.real, weighted.imag, rates, -(rough @ phi)])
        known = const * free / prior**2
        now = 0.5 * float(residual @ residual + const @ known)
        curvature = (angles.T @ angles).tocsc()
        # A sensor that says nothing of some angle leaves it where it is.
        least = 1e-12 * float(curvature.diagonal().max())
        solve = splu(curvature + least * sparse.identity(n + 1, format="csc")).solve
        mixed = np.asarray(angles.T @ constants)
        reduced = solve(mixed)
        inverse = np.linalg.inv(
            constants.T @ constants + np.diag(free / prior**2 + ~free) - mixed.T @ reduced
        )
        gradient = angles.T @ residual
        own = inverse @ (constants.T @ residual - known - reduced.T @ gradient)
        phi, const = phi + solve(gradient) - reduced @ own, const + own * free
        if abs(cost - now) < 1e-9 * now:
            break
        cost = now
    std = np.sqrt(np.clip(np.diagonal(inverse), 0.0, None)) * free
    return Swing(phi, const[0], 1 + const[1], const[2], complex(const[3], const[4]), std, left, now)


@dataclass(frozen=True, slots=True)
class _Parts:
    """Parts that stay the same from step to step: means over a block by the angles at its edges, and the weights."""

    mean: Any
    slope: Any
    bend: Any
    step: float
    weight: Array


def _linear_parts(blocks: Blocks) -> _Parts:
    n, step = len(blocks.accel), float(np.median(np.diff(blocks.edges)))
    mean, slope, bend = (
        _stencil(weights, n, n + 1) / step**order for order, weights in enumerate((EDGES, _SLOPE, _BEND))
    )
    weight = 1 / blocks.accel_std
    weight[:2] = weight[-2:] = 0.0  # stencils reach beyond the ends there
    return _Parts(mean, slope, bend, step, weight)


def _accelerations(
    blocks: Blocks, parts: _Parts, phi: Array, const: Array
) -> tuple[npt.NDArray[np.complex128], Any, npt.NDArray[np.complex128]]:
    """Return the residual accelerations [m/s²], and their weighted derivatives by angles and constants."""
    from scipy import sparse

    gravity, rho = const[2], complex(const[3], const[4])
    middle, rate, turn = parts.mean @ phi, parts.slope @ phi, parts.bend @ phi
    # Means over a block: of e^(iφ) at a constant rate, and of φ̇² at a constant acceleration.
    turned = np.exp(1j * middle) * np.sinc(rate * parts.step / (2 * np.pi))
    lever = -(1j * turn + rate**2 + (turn * parts.step) ** 2 / 12)
    left = blocks.accel - gravity * turned - lever * rho
    by_angle = sparse.diags(parts.weight) @ (
        sparse.diags(1j * gravity * turned) @ parts.mean
        - 1j * rho * parts.bend
        - 2 * rho * sparse.diags(rate) @ parts.slope
    )
    by_const = np.stack((0 * turned, 0 * turned, turned, lever, 1j * lever), axis=1)
    return left, by_angle, np.asarray(by_const * parts.weight[:, None], np.complex128)


def _rates(blocks: Blocks, parts: _Parts, phi: Array, const: Array) -> tuple[Array, Any, Array]:
    """Return the gyro's weighted residuals and their derivatives; no rows without a gyro."""
    if blocks.rate is None:
        return np.zeros(0), parts.slope[:0], np.zeros((0, 5))
    rates = blocks.rate
    residual = ((1 + const[1]) * rates - const[0] - parts.slope @ phi) / blocks.rate_std
    by_const = np.stack((np.ones_like(rates), -rates, 0 * rates, 0 * rates, 0 * rates), axis=1)
    return residual, parts.slope / blocks.rate_std, by_const / blocks.rate_std


def _stencil(weights: Array, rows: int, nodes: int) -> Any:
    """Return the matrix that applies weights about each of some rows to angles at nodes, shape (rows, nodes)."""
    from scipy import sparse

    size = weights.size
    first = np.clip(np.arange(rows) - (size - (nodes - rows) - 1) // 2, 0, nodes - size)
    at = np.repeat(np.arange(rows), size), (first[:, None] + np.arange(size)).ravel()
    return sparse.csr_matrix((np.tile(weights.ravel(), rows), at), shape=(rows, nodes))


def integral_of(time: Array, values: Array) -> Callable[[Array], Array]:
    """Return the integral of a cubic spline through samples, shape (n,), as a function of time [s].

    Uneven stamps or few samples a period do not shift it. A line bridges gaps, where a spline would overshoot.
    """
    from scipy.interpolate import CubicSpline

    steps = np.diff(time)
    usual = float(np.median(steps))
    gaps = np.flatnonzero(steps > GAP * usual)
    most = time.size // max(gaps.size, 1)  # as many nodes in gaps as there are samples, at most
    fill = [np.linspace(time[k], time[k + 1], 2 + min(int(steps[k] / usual), most))[1:-1] for k in gaps]
    fine = np.sort(np.concatenate([time, *fill]))
    return CubicSpline(fine, np.interp(fine, time, values)).antiderivative()


def block_means(time: Array, values: Sequence[Array], step: float) -> tuple[Array, list[Array]]:
    """Return the edges of blocks of about `step` [s] on an even clock, and the means of values, shape (n,) each, between them."""
    edges = np.linspace(time[0], time[-1], max(8, int((time[-1] - time[0]) / step)) + 1)
    return edges, [np.diff(integral_of(time, column)(edges)) / np.diff(edges) for column in values]
