"""Rake and rolling resistance of a whole board from a roll-out: it is let go on a slope or pushed, and rolls by itself.

Speed, heading and roll are measured over time. A weight beside the axis or a push gives the deck its roll. Both trucks steer by
`tan σ = tan λ sin γ`, so the heading turns by `2 tan λ sin γ / L` per metre. The slope of heading against ∫ sin γ ds gives tan λ.
On ground of gradient θ, uphill positive, the speed falls by `a₀ + a₁ v + g sin θ` per second. The slopes of speed against time and
path are a₀ and a₁.

Both lines go through increments over a quarter of a second, longer than the correlation of sensor noise and smoothing. A block
jackknife gives the intervals without a model of that noise.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.board import Board
from sysid.errors import SysidError
from sysid.quantity import GRAVITY, Quantity, t95
from sysid.roll import Array

INTERVAL = 0.25
"""Length of an increment of speed and heading [s]: beyond the noise's correlation."""
BLOCKS = 10
"""Blocks of the jackknife: neighbouring increments, whose errors are correlated, are left out together."""
SMOOTHING = 0.3
"""Length of the window in which positions are smoothed by a cubic [s]."""


@dataclass(frozen=True, slots=True)
class RollOut:
    """One board rolling freely."""

    time: Array
    """[s], shape (n,), evenly spaced."""
    speed: Array
    """Along the board [m/s], shape (n,)."""
    heading: Array
    """Left turns positive, without jumps [rad], shape (n,)."""
    roll: Array
    """Of the deck, right edge down positive [rad], shape (n,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rolling:
    """Result of roll-outs."""

    rake: Quantity | None
    """λ [rad]; None if the board turned too little."""
    deceleration: Quantity
    """Loss of speed on level ground at 1 m/s, or at the nearest speed that was rolled [m/s^2]."""
    at_speed: float
    """That speed [m/s]."""

    def board(self, record: Board) -> Board:
        """Return the record with rake and rolling resistance."""
        geometry = dict(record.geometry)
        if self.rake is not None:
            geometry["rake"] = self.rake
        return replace(record, geometry=geometry, rolling={"deceleration": self.deceleration})


def from_path(time: Array, position: Array, roll: Array) -> RollOut:
    """Return a roll-out seen from above, by a film or motion capture.

    Args:
        time: [s], shape (n,), evenly spaced.
        position: Of a point of the board, on the ground, y to the left of x [m], shape (n, 2).
        roll: Right edge down positive [rad], shape (n,).

    Raises:
        SysidError: It is too short.
    """
    from scipy.signal import savgol_filter

    step = _step(time)
    window = max(5, 2 * round(SMOOTHING / step / 2) + 1)
    if len(time) < 2 * window:
        raise SysidError(f"a roll-out of {len(time) * step:.2f} s; it takes at least {2 * SMOOTHING:g} s.")
    velocity = np.asarray(savgol_filter(position, window, 3, deriv=1, delta=step, axis=0))
    inside = slice(window // 2, len(time) - window // 2)
    heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    return RollOut(time[inside], np.hypot(*velocity[inside].T), heading[inside], roll[inside])


def from_imu(time: Array, forward: Array, yaw_rate: Array, roll: Array, rest: float, free: float) -> RollOut:
    """Return a roll-out measured by an IMU on a board that stands still at the beginning of its log.

    The mean reading at rest, bias and slope, is subtracted. The rest integrates to speed and heading, through the push.

    Args:
        time: [s], shape (n,), evenly spaced.
        forward: Specific force along the board [m/s^2], shape (n,).
        yaw_rate: Left turns positive [rad/s], shape (n,).
        roll: Right edge down positive [rad], shape (n,).
        rest: Duration of the rest at the beginning [s].
        free: Time after the beginning from which it rolls freely [s].

    Raises:
        SysidError: Rest or rolling is missing.
    """
    step = _step(time)
    still = time < time[0] + rest
    rolls = time >= time[0] + free
    if still.sum() < 10 or rolls.sum() * step < 2 * INTERVAL or free < rest:
        raise SysidError(
            f"--rest {rest:g} --free {free:g}: expected a while of rest first, then of rolling, within the "
            f"{time[-1] - time[0]:.1f} s of the log."
        )
    speed, heading = (np.cumsum(signal - signal[still].mean()) * step for signal in (forward, yaw_rate))
    return RollOut(time[rolls], speed[rolls], heading[rolls], roll[rolls])


def roll_out(runs: Sequence[RollOut], wheelbase: Quantity, slope: float = 0.0) -> Rolling:
    """Return rake and rolling resistance from one or several roll-outs.

    Args:
        runs: At least one; in all at least `BLOCKS` stretches.
        wheelbase: L [m].
        slope: Gradient of the ground along the way, uphill positive [rad].

    Raises:
        SysidError: The runs are too short, or the board did not roll, gained speed on level ground, or turned the wrong way.
    """
    from scipy.integrate import cumulative_trapezoid

    turns: list[Array] = []
    losses: list[Array] = []
    for run in runs:
        every = max(1, round(INTERVAL / _step(run.time)))
        rates = run.speed, run.speed * np.sin(run.roll)
        path, bent = (cumulative_trapezoid(rate, run.time, initial=0) for rate in rates)
        at = np.arange(0, len(run.time), every)
        differences = [np.diff(values[at]) for values in (run.time, path, run.speed, bent, run.heading)]
        time, way, gain, curve, turn = differences
        turns.append(np.column_stack([-curve, turn]))  # right edge down turns right
        losses.append(np.column_stack([time, way, -GRAVITY.value * math.sin(slope) * time - gain]))
    turned, lost = np.concatenate(turns), np.concatenate(losses)
    if len(lost) < BLOCKS:
        raise SysidError(
            f"{len(lost)} stretches of {INTERVAL:g} s in all; it takes {BLOCKS}. Roll longer, or give several logs."
        )
    speeds = np.concatenate([run.speed for run in runs])
    if speeds.mean() < 0.05:
        raise SysidError(f"the board hardly rolls: {speeds.mean():.3f} m/s on average.")
    at_speed = float(np.clip(1.0, *np.quantile(speeds, (0.1, 0.9))))
    varied = np.ptp(speeds) > 0.3  # else time and path are proportional

    def loss(rows: Array) -> float:
        if not varied:
            return float(rows[:, 2].sum() / rows[:, 0].sum())
        constant, linear = np.linalg.lstsq(rows[:, :2], rows[:, 2], rcond=None)[0]
        return float(constant + linear * at_speed)

    def steering(rows: Array) -> float:
        return float(rows[:, 0] @ rows[:, 1] / (rows[:, 0] @ rows[:, 0]))

    count = f"{len(runs)} roll-out{'s' * (len(runs) > 1)}"
    deceleration = _jackknife(loss, lost, "m/s^2", f"{count}, {len(lost)} stretches")
    if deceleration.ci95[1] < 0:
        raise SysidError(
            f"the board gains {-deceleration.value:.2g} m/s^2 beyond its slope of {math.degrees(slope):g} degrees. Downhill is "
            "negative: --slope-deg -2 where it rolls down 2 degrees."
        )
    bend = _jackknife(steering, turned, "1/m", count) if np.any(turned[:, 0]) else None
    return Rolling(rake=_rake(bend, wheelbase), deceleration=deceleration, at_speed=at_speed)


def _rake(bend: Quantity | None, wheelbase: Quantity) -> Quantity | None:
    """Return λ of 2 tan λ / L; None where it is within three standard deviations of zero.

    Raises:
        SysidError: The board turns the wrong way for its roll.
    """
    if bend is not None and bend.value < -3 * bend.std:
        raise SysidError(
            f"the board turns left where its right edge is down ({bend.value:.2g} rad/m per unit of tilt). The sign of "
            "roll_rad, of y_m or of yaw_rate_rad_s is wrong: change it in the log and run again."
        )
    if bend is None or bend.value <= 3 * bend.std:
        return None
    tangent = bend.value * wheelbase.value / 2
    half = (bend.ci95[1] - bend.ci95[0]) / 2
    relative = math.hypot(bend.std / bend.value, wheelbase.std / wheelbase.value)
    reach = math.hypot(half / bend.value, 1.96 * wheelbase.std / wheelbase.value)
    scale = tangent / (1 + tangent**2)
    rake = math.atan(tangent)
    return Quantity(rake, scale * relative, "rad", bend.method, (rake - scale * reach, rake + scale * reach))


def _jackknife(estimate: Callable[[Array], float], rows: Array, unit: str, method: str) -> Quantity:
    """Return an estimate from rows with the interval of a delete-a-block jackknife."""
    blocks = np.array_split(np.arange(len(rows)), BLOCKS)
    value = estimate(rows)
    left = np.array([estimate(np.delete(rows, block, axis=0)) for block in blocks])
    std = math.sqrt((BLOCKS - 1) / BLOCKS * float(np.sum((left - left.mean()) ** 2)))
    half = t95(BLOCKS - 1) * std
    return Quantity(value, std, unit, method, (value - half, value + half))


def _step(time: Array) -> float:
    steps = np.diff(time)
    if len(steps) == 0 or not np.allclose(steps, steps.mean(), rtol=0.05, atol=0):
        raise SysidError("the times of a roll-out must be evenly spaced.")
    return float(steps.mean())
