"""Measured decays beside the same decays in a scene."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.board.clamped import ClampedScene
from sysid.board import Board
from sysid.errors import SysidError
from sysid.joint import JointLaw
from sysid.joint.sensor import clock_ratio, sense
from sysid.progress import steps
from sysid.quantity import Z95
from sysid.roll import Array, Release

WITHIN_RANGE = 0.97
"""Share of the scene's tilt range up to which a decay is compared [1]: a limit pushes just before its end."""
BLOCK = 0.008
"""Residuals are averaged over blocks of this length before the noise is taken out [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReleaseCheck:
    """One measured decay beside the scene's."""

    release: Release
    """The measurement, from the sample on after which it stays within the scene's tilt range."""
    side: str
    """The edge that was down when the deck was let go."""
    simulated: Array
    """[rad], shape (n,); with the log's own zero."""
    zero: float
    """The log's zero against the scene's [rad]."""
    rest_error: float
    """Distance of the scene's rest from the log's, beyond the record's uncertainty [rad]; 0 where the log's zero is unknown."""
    start: tuple[float, float]
    """Fitted roll [rad] and rate [rad/s] at the first sample, about the scene's zero."""
    cut: float
    """Time left out at the beginning, beyond the scene's tilt range [s]."""
    error_power: float
    """Mean square of the residual without noise, plus the square of `rest_error` [rad²]; may be slightly negative."""
    power: float
    """Mean square of the measured roll about the log's own rest without the sensor's noise [rad²]."""
    error_power_std: float
    """Standard deviation of `error_power` by the noise [rad²]."""

    @property
    def rmse(self) -> float:
        """RMS of the residual, noise included [rad]."""
        return float(np.sqrt(np.mean((self.release.roll - self.simulated) ** 2)))

    @property
    def nrmse(self) -> float:
        """RMS of the residual over RMS of the measured roll about rest, both without noise."""
        return math.sqrt(max(self.error_power, 0.0) / self.power)


@dataclass(frozen=True, slots=True)
class SceneCheck:
    """All measured decays beside the scene's."""

    releases: tuple[ReleaseCheck, ...]
    tolerance: float

    @property
    def nrmse(self) -> float:
        """RMS of all residuals over RMS of all measured roll about rest, both without noise."""
        return math.sqrt(max(self._mean([r.error_power for r in self.releases]), 0.0)) / self.motion

    @property
    def hidden(self) -> float:
        """NRMSE that the sensors' noise could hide, at 95 %."""
        weights = np.array([len(one.simulated) for one in self.releases], dtype=np.float64)
        weights /= weights.sum()
        std = math.sqrt(float(np.sum((weights * [r.error_power_std for r in self.releases]) ** 2)))
        return math.sqrt(1.645 * std) / self.motion

    @property
    def rmse(self) -> float:
        """RMS of all residuals, noise included [rad]."""
        return float(
            np.sqrt(np.mean(np.concatenate([r.release.roll - r.simulated for r in self.releases]) ** 2))
        )

    @property
    def rest_error(self) -> float:
        """Largest `rest_error` of all releases [rad]."""
        return max((release.rest_error for release in self.releases), key=abs)

    @property
    def only_rest_is_off(self) -> bool:
        """Whether the scene would pass if it rested where the log does."""
        moving = self._mean([release.error_power - release.rest_error**2 for release in self.releases])
        return self.nrmse > self.tolerance and moving <= (self.tolerance * self.motion) ** 2

    @property
    def motion(self) -> float:
        """RMS of the measured roll about rest over all releases, without noise [rad]."""
        return math.sqrt(self._mean([release.power for release in self.releases]))

    def _mean(self, values: Sequence[float]) -> float:
        """Return the mean of a value of each release, weighted by samples."""
        return float(np.average(values, weights=[len(one.simulated) for one in self.releases]))


def check_scene(
    board: Board, scene: ClampedScene, releases: Sequence[Release], *, tolerance: float = 0.02
) -> SceneCheck:
    """Release the deck in a scene as in the logs, and compare.

    Angle and rate at the start and the log's zero are fitted for each release: noise of the first samples does not count.

    Args:
        board: The record; only its measurement effects (clock, lowpass, drift) and rest angle are used.

    Raises:
        SysidError: No decay stays within the scene's tilt range for long enough.
    """
    return SceneCheck(tuple(_compare(board, scene, release) for release in steps(releases)), tolerance)


def _compare(board: Board, scene: ClampedScene, release: Release) -> ReleaseCheck:
    from scipy.interpolate import CubicSpline
    from scipy.optimize import least_squares

    inside = _inside(release, scene.tilt_range)
    time, measured = release.time[inside:], release.roll[inside:]
    duration = float(time[-1] - time[0])
    rest, law = board.rest_angle, JointLaw.from_board(board)
    clock = clock_ratio(law.structure, law.parameters)
    if abs(rest) > scene.tilt_range:
        raise SysidError(
            f"board '{board.name}' rests at {rest:.3g} rad, and its tilt range ends at ±{scene.tilt_range:.3g} rad: the scene "
            "would lean on its stop. Correct tilt.rest_angle or tilt.range in the record, or fit it to a log whose zero "
            "is level."
        )

    def simulated(unknown: Array) -> Array:
        angle, rate, zero = unknown
        move = CubicSpline(*scene.swing(angle, rate, duration / clock))
        return zero + sense(law, time, move((time - time[0]) / clock))

    zero = release.rest - rest
    slope = np.polynomial.Polynomial.fit(time[:12] - time[0], measured[:12], 2).convert().coef
    guess = np.array([slope[0] - zero, slope[1], zero])
    speed = max(abs(slope[1]), abs(slope[0] - release.rest) / 0.02)
    found = least_squares(
        lambda unknown: simulated(unknown) - measured,  # pyright: ignore[reportUnknownLambdaType]
        guess,
        x_scale=[max(release.amplitude, 1e-3), speed, max(release.amplitude, 1e-3)],
        diff_step=1e-5,
        max_nfev=12,
    )
    residual = np.asarray(found.fun)
    step = float(np.median(np.diff(time)))
    error_power, error_power_std = _smooth_power(residual, step)
    power, _ = _smooth_power(measured - release.rest, step)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * float(np.mean(residual**2))
    rest_error = _rest_error(board, release, float(found.x[2]), math.sqrt(max(covariance[2, 2], 0.0)))
    return ReleaseCheck(
        release=replace(release[inside:], hold=0.0 if inside else release.hold), side=release.side,
        simulated=measured + residual, zero=float(found.x[2]), rest_error=rest_error,
        start=(float(found.x[0]), float(found.x[1])), cut=float(time[0] - release.time[0]),
        error_power=error_power + rest_error**2, power=max(power, 1e-12), error_power_std=error_power_std,
    )  # fmt: skip


def _inside(release: Release, tilt_range: float) -> int:
    """Return the first sample from which the deck stays within the scene's tilt range."""
    beyond = np.flatnonzero(np.abs(release.roll - release.rest) > WITHIN_RANGE * tilt_range)
    first = int(beyond[-1]) + 1 if len(beyond) else 0
    if len(release.roll) - first < 16:
        raise SysidError(
            f"{release.log}, release {release.number}: the deck stays within the scene's tilt range of "
            f"{tilt_range:.3g} rad for {len(release.roll) - first} samples only. Release it from less, or widen "
            "tilt.range in the board record."
        )
    return first


def _rest_error(board: Board, release: Release, zero: float, zero_std: float) -> float:
    """Return the difference of the rests of scene and log, beyond its 95 % interval [rad]."""
    if release.zero != "known" or board.stiffness == 0:
        # Without a spring the rest does not fix the zero; integrated rates, glued sensors and cameras have another zero.
        return 0.0
    allowed = Z95 * math.hypot(board.tilt["rest_angle"].std, zero_std)
    return zero - min(max(zero, -allowed), allowed)


def _smooth_power(signal: Array, step: float) -> tuple[float, float]:
    """Return the mean square of a sampled smooth signal under white noise, without the noise.

    Means of neighbouring blocks share the signal but not the noise, so the mean of their products is the signal's power. It
    needs no estimate of the noise.

    Args:
        signal: Evenly sampled, shape (n,).
        step: Sampling interval [s].

    Returns:
        The mean square, and its standard deviation.
    """
    width = max(1, round(BLOCK / step))
    usable = len(signal) // width * width
    blocks = signal[:usable].reshape(-1, width).mean(axis=1)
    products = blocks[1:] * blocks[:-1]
    return float(np.mean(products)), float(np.std(products) / math.sqrt(len(products)))
