"""The direction of gravity in the frame of a moving sensor, from gyro and accelerometer, over a whole record.

Integrating the gyro gives a frame S that turns with the room, but for the gyro's offset and noise. Seen from
S the vertical hardly moves, while everything that the accelerometer feels beside gravity comes and goes. So
the accelerations are turned into S and averaged over short blocks, and a Kalman filter with a
Rauch-Tung-Striebel smoother (Rauch, Tung, Striebel, AIAA Journal 3(8), 1965) follows the vertical in S through
the blocks, forwards and backwards, together with the constant errors of the sensors: offset, gain and
misalignment of the gyro, offset of the accelerometer. Filtering accelerations in an almost inertial
frame is the idea of VQF (Laidig and Seel, Information Fusion 91, 2023); theirs is a low-pass filter.
"""

from dataclasses import dataclass, replace

import numpy as np

from sysid.errors import SysidError
from sysid.logs.sources.rotations import cross_matrices, integrate_rate
from sysid.roll import Array

STANDARD_GRAVITY = 9.80665
"""[m/s²], by definition (CGPM 1901)."""
BLOCK_SECONDS = 0.05
"""Samples are averaged over this long in a frame that turns with the gyro [s]: what neighbours feel is alike anyway
(`MOTION_TIME`), and the smoother takes so much less time. Half or twice of it moves the roll of the shipped log by 0.006° RMS,
of 0.11° that it states."""
ARM_SHARE = 0.03
"""A lever arm counts where it explains this share of what the accelerometer feels beside gravity."""
ROUNDS, STATES = 3, 18
"""Rounds in which offsets, strength of the accelerations and lever arm settle: three more move the roll of the shipped log by
0.0004° RMS, the third alone by 0.02°. And what the smoother follows: vertical 3, gyro offset 3, gains and misalignment 9,
accelerometer offset 3."""
GAIN_WALK = 0.003
"""Share of an angle that was turned through by which it is wrong, for what is left of gain errors and misalignment."""
MOTION_TIME = 2.0
"""Accelerations of a hand or a deck stay alike over about this long [s]; blocks within it are one measurement."""
WINDOW_SECONDS = 1.0
"""Over this long the strength of such accelerations is taken as one [s]."""
GAIN_STD = 0.02
"""Typical gain and misalignment errors of a MEMS gyro, as a share: 1 to 3 % in data sheets."""
GAIN_MOST = 3 * GAIN_STD
"""A larger error than any data sheet's is the accelerometer's: at the end of a pendulum it feels hardly any tilt, however long it swings."""
ACCEL_OFFSET_STD = 0.01
"""Typical offset of a MEMS accelerometer [g]."""
HELD = 1e-6
"""Standard deviation of gains that are held [1]; at zero the smoother's covariances have no inverse."""


@dataclass(frozen=True, slots=True)
class Gravity:
    """The vertical in the sensor's frame."""

    up: Array
    """Unit vector against gravity in sensor axes, shape (n, 3)."""
    std: Array
    """Standard deviation of its direction [rad], shape (n,), the accelerometer's constant offset aside."""
    offset: Array
    """Gyro offset [rad/s], shape (3,), mean over the record."""
    offset_std: Array
    """Its standard deviation [rad/s], shape (3,)."""
    rate: Array
    """Rotation rate in sensor axes without the gyro's offset, gain errors and misalignment [rad/s], shape (n, 3)."""
    lever_arm: Array | None
    """From the axis of rotation to the accelerometer, in sensor axes [m], shape (3,); None where there is none."""
    gain_error: float
    """The largest of the gyro's gain errors and misalignments [1] that were taken off."""
    gain_covariance: Array
    """Of the gyro's gain errors and misalignment, row by row [1], shape (9, 9)."""

    def scale_std(self, axis: Array) -> float:
        """Return the standard deviation of the scale of angles and rates about an axis [1], a unit vector of shape (3,)."""
        along = np.outer(axis, axis).ravel()
        return float(np.sqrt(along @ self.gain_covariance @ along))


def smooth_gravity(
    time: Array,
    rate: Array,
    accel: Array,
    *,
    offset: Array | None = None,
    offset_std: float = 0.1,
    rate_noise: float = 2e-3,
    lever_arm: Array | None = None,
    find_lever_arm: bool = False,
) -> Gravity:
    """Estimate the direction of gravity at every sample.

    Args:
        time: Strictly increasing time [s], shape (n,).
        rate: Rotation rate in sensor axes [rad/s], shape (n, 3).
        accel: Specific force in sensor axes [m/s^2], shape (n, 3); at rest it points up.
        offset: First guess of the gyro's offset [rad/s], shape (3,).
        offset_std: Standard deviation of that guess [rad/s].
        rate_noise: Standard deviation of one sample of the gyro [rad/s].
        lever_arm: From a fixed axis or point of rotation to the accelerometer, in sensor axes [m], shape (3,);
            its tangential and centripetal accelerations are taken off.

    Raises:
        SysidError: The record is too short.
    """
    first = np.zeros(3) if offset is None else offset
    known = first, offset_std, rate_noise
    found = _smooth(time, rate, accel, *known, GAIN_STD, lever_arm, find_lever_arm)
    if found.gain_error <= GAIN_MOST:
        return found
    held = _smooth(time, rate, accel, *known, HELD, lever_arm, find_lever_arm)
    return replace(held, gain_covariance=GAIN_STD**2 * np.eye(9))


def _smooth(
    time: Array,
    rate: Array,
    accel: Array,
    offset: Array,
    offset_std: float,
    rate_noise: float,
    gain_std: float,
    lever_arm: Array | None,
    find_lever_arm: bool,
) -> Gravity:
    """Return what `smooth_gravity` does, of a gyro whose gains and misalignment have a standard deviation [1]."""
    size = max(1, round(BLOCK_SECONDS / float(np.median(np.diff(time)))))
    if time.size < 4 * size:
        raise SysidError(f"a record of {time[-1] - time[0]:.3g} s is too short to tell gravity from motion.")
    known = np.zeros(15)
    known[:3] = offset
    prior = np.repeat((offset_std, gain_std, gain_std, gain_std, ACCEL_OFFSET_STD), 3)
    errors, arm = known.copy(), lever_arm
    blocks = _Blocks.of(time, size)
    spread = up = np.zeros(0)
    state = covariance = np.zeros(0)
    for _ in range(ROUNDS):
        free = (rate - errors[:3]) @ (np.eye(3) - errors[3:12].reshape(3, 3)).T
        attitude = integrate_rate(time, free)
        force = accel - STANDARD_GRAVITY * errors[12:]
        if arm is not None:
            force = force - lever_accelerations(time, free) @ arm
        problem = _Problem.of(blocks, attitude, free, force, spread, rate_noise)
        state, covariance = problem.solve(known - errors, prior)
        errors = errors + state[-1, 3:]
        spread = problem.spread(state)
        vertical = state[:, :3] / np.linalg.norm(state[:, :3], axis=1, keepdims=True)
        up = _in_sensor(time, blocks.time, attitude, vertical)
        if find_lever_arm and lever_arm is None:
            arm = _fit_lever_arm(time, free, accel, up)
    return Gravity(
        up=up,
        std=np.interp(time, blocks.time, _direction_std(covariance)),
        offset=errors[:3],
        offset_std=np.sqrt(np.diagonal(covariance[-1, 3:6, 3:6])),
        rate=(rate - errors[:3]) @ (np.eye(3) - errors[3:12].reshape(3, 3)).T,
        lever_arm=arm,
        gain_error=float(np.abs(errors[3:12]).max()),
        gain_covariance=covariance[-1, 6:15, 6:15],
    )


def lever_accelerations(time: Array, rate: Array) -> Array:
    """Return the matrices ω̇× + ω× ω× that turn a lever arm [m] into accelerations, shape (n, 3, 3)."""
    from scipy.interpolate import CubicSpline

    # Central differences are 0.3 % short at 50 samples a period; on an arm of 30 cm that is a hundredth of g.
    acceleration: Array = CubicSpline(time, rate)(time, 1)
    turning = cross_matrices(rate)
    return cross_matrices(acceleration) + turning @ turning


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Runs of samples that are averaged."""

    starts: np.ndarray[tuple[int], np.dtype[np.intp]]
    counts: Array
    time: Array
    """Mean time of each block [s]."""
    length: Array
    """From the middle of each block to the middle of the next [s], shape (blocks - 1,)."""

    @classmethod
    def of(cls, time: Array, size: int) -> "_Blocks":
        starts = np.arange(0, time.size - size // 2, size)
        counts = np.diff(np.append(starts, time.size)).astype(np.float64)
        middle = np.add.reduceat(time, starts) / counts
        return cls(starts, counts, middle, np.diff(middle))

    def mean(self, values: Array) -> Array:
        """Return block means of values, shape (n, ...)."""
        shape = (-1,) + (1,) * (values.ndim - 1)
        return np.add.reduceat(values, self.starts, axis=0) / self.counts.reshape(shape)


@dataclass(frozen=True, slots=True)
class _Problem:
    """What the smoother is given, block by block, in units of g."""

    measured: Array
    """Specific force in S, shape (blocks, 3)."""
    variance: Array
    """Variance of a component of it beside gravity, shape (blocks,)."""
    drift: Array
    """∫R dt and ∫R ω_j dt to the next block, shape (blocks - 1, 3, 12)."""
    attitude: Array
    """Mean R, shape (blocks, 3, 3)."""
    walk: Array
    """Variance that the vertical gains on the way to the next block, shape (blocks - 1,)."""
    period: float
    """Length of a block [s]."""

    @classmethod
    def of(
        cls, blocks: _Blocks, attitude: Array, rate: Array, force: Array, spread: Array, rate_noise: float
    ) -> "_Problem":
        turned = blocks.mean(np.einsum("nij,nj->ni", attitude, force))
        measured = turned / STANDARD_GRAVITY
        mean_attitude = blocks.mean(attitude)
        turned_rates = np.einsum("nij,nk->nijk", attitude, rate).reshape(-1, 3, 9)
        drift = np.concatenate((mean_attitude, blocks.mean(turned_rates)), axis=2)
        period = float(np.median(blocks.length))
        if not spread.size:
            spread = _local_mean((np.linalg.norm(measured, axis=1) - 1) ** 2, period) + 1e-4
        angle = np.linalg.norm(blocks.mean(rate), axis=1)[:-1] * blocks.length
        sample = period / float(np.median(blocks.counts))
        return cls(
            measured=measured,
            variance=spread * max(1.0, MOTION_TIME / period),
            drift=0.5 * (drift[1:] + drift[:-1]) * blocks.length[:, None, None],
            attitude=mean_attitude,
            walk=rate_noise**2 * sample * blocks.length + (GAIN_WALK * angle) ** 2,
            period=period,
        )

    def solve(self, known: Array, prior: Array) -> tuple[Array, Array]:
        """Follow x = (vertical s in S, gyro offset b and gain error C, accelerometer offset a) through the blocks.

        s' = s - s × (∫R dt b + ∫R C ω dt), measured s + R a; the fifteen errors are constant, `known` within `prior`.
        Returns means, shape (blocks, 18), and covariances, shape (blocks, 18, 18), given all measurements.
        """
        count = len(self.measured)
        mean, predicted = np.zeros((count, STATES)), np.zeros((count, STATES))
        cov, predicted_cov = np.zeros((count, STATES, STATES)), np.zeros((count, STATES, STATES))
        transition = np.tile(np.eye(STATES), (count, 1, 1))
        x = np.concatenate((self.measured[0], known))
        p = np.diag(np.concatenate((np.ones(3), prior)) ** 2)
        sees = np.zeros((3, STATES))
        sees[:, :3] = np.eye(3)
        for k in range(count):
            if k:
                s0, s1, s2 = x[:3]
                f = transition[k]
                f[:3, 3:15] = np.array(((0.0, s2, -s1), (-s2, 0.0, s0), (s1, -s0, 0.0))) @ self.drift[k - 1]
                x = f @ x
                p = f @ p @ f.T
                p.flat[: 2 * STATES + 3 : STATES + 1] += self.walk[k - 1]
            predicted[k], predicted_cov[k] = x, p
            sees[:, 15:] = self.attitude[k]
            seen = sees @ p
            innovation = seen @ sees.T
            innovation.flat[::4] += self.variance[k]
            gain = np.linalg.solve(innovation, seen).T
            x = x + gain @ (self.measured[k] - sees @ x)
            p = p - gain @ seen
            mean[k], cov[k] = x, p
        for k in range(count - 2, -1, -1):
            gain = np.linalg.solve(predicted_cov[k + 1], transition[k + 1] @ cov[k]).T
            mean[k] += gain @ (mean[k + 1] - predicted[k + 1])
            cov[k] += gain @ (cov[k + 1] - predicted_cov[k + 1]) @ gain.T
        return mean, cov

    def spread(self, state: Array) -> Array:
        """Return the variance of a component of the acceleration beside gravity about each block."""
        seen = state[:, :3] + np.einsum("kij,kj->ki", self.attitude, state[:, 15:])
        return _local_mean(np.sum((self.measured - seen) ** 2, axis=1) / 3, self.period) + 1e-7


def _in_sensor(time: Array, block_time: Array, attitude: Array, vertical: Array) -> Array:
    """Turn the vertical, known at the blocks, from S back into the sensor's frame at every sample."""
    between = np.stack([np.interp(time, block_time, vertical[:, axis]) for axis in range(3)], axis=1)
    up = np.einsum("nji,nj->ni", attitude, between)
    return up / np.linalg.norm(up, axis=1, keepdims=True)


def _direction_std(covariance: Array) -> Array:
    """Standard deviation of the vertical at each block, were the accelerometer's offset known, shape (blocks,)."""
    vertical, mixed, offset = covariance[:, :3, :3], covariance[:, :3, 15:], covariance[:, 15:, 15:]
    left = vertical - mixed @ np.linalg.solve(offset, mixed.transpose(0, 2, 1))
    return np.sqrt(np.maximum(np.trace(left, axis1=1, axis2=2), 0.0) / 2)


def _fit_lever_arm(time: Array, rate: Array, accel: Array, up: Array) -> Array | None:
    """Return the arm whose accelerations best explain what is left beside gravity; None if it explains little."""
    matrices = lever_accelerations(time, rate)
    left = accel - STANDARD_GRAVITY * up
    normal = np.einsum("nij,nik->jk", matrices, matrices)
    right = np.einsum("nij,ni->j", matrices, left)
    arm = np.linalg.lstsq(normal, right, rcond=1e-3)[0]
    explained = float(right @ arm) / float(np.sum(left**2))
    return arm if explained > ARM_SHARE and float(np.linalg.norm(arm)) < 2.0 else None


def _local_mean(values: Array, period: float) -> Array:
    """Average over about WINDOW_SECONDS on either side."""
    from scipy.ndimage import gaussian_filter1d

    return gaussian_filter1d(values, WINDOW_SECONDS / 2 / period, mode="nearest")
