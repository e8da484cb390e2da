"""Contact detection: when a foot stands on the ground, from the motion of its sole; also in noisy recorded clips.

A point of the sole comes to stand where it is low and slow, and leaves by wider thresholds (a Schmitt trigger).
Both follow the clip's own noise, measured where the foot is slowest.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.signal import savgol_filter

from sysid.roll import Array

MAX_HEIGHT, MAX_SPEED = 0.001, 0.1
"""Height above the ground [m] and speed [m/s] below which a point of a noiseless clip stands."""
ENTER, LEAVE = 3.0, 6.0
"""How many times the noise is added to that to come to a stand, and to leave it."""


@dataclass(frozen=True, slots=True)
class Stance:
    """When one foot stands, and where the ground is."""

    planted: npt.NDArray[np.bool_]
    """Shape (frames,)."""
    ground: float
    """Height of the standing sole [m]."""
    noise: float
    """Scatter of that height [m]."""
    slide: float
    """Greatest speed of the slowest point of the standing sole over the ground, away from landing and lifting [m/s]."""

    @property
    def touchdowns(self) -> npt.NDArray[np.intp]:
        """Frames in which the foot comes to stand, without the first frame."""
        return np.flatnonzero(self.planted[1:] & ~self.planted[:-1]) + 1


def find_stance(sole: Array, rate: float) -> Stance:
    """Find when a foot stands.

    Args:
        sole: Lowest points of the sole in the world [m], shape (frames, points, 3); at least five frames.
        rate: Frames a second [Hz].
    """
    window = 3
    shaking = _white_noise(sole[..., 2].mean(axis=1))
    for limit in (0.001, 0.003):  # longer windows blur landing and lifting, so only against noise
        window += 2 * (shaking > limit and len(sole) > window + 2)
    position = np.asarray(savgol_filter(sole, window, 2, axis=0))
    velocity = np.asarray(savgol_filter(sole, window, 2, deriv=1, delta=1 / rate, axis=0))
    speed = np.linalg.norm(velocity[..., :2], axis=-1)
    lowest = position[..., 2].min(axis=1)
    slowest = speed.min(axis=1)
    slow = np.argsort(slowest)[: max(3, len(sole) // 5)]
    resting = slow[np.argsort(lowest[slow])[: max(2, len(slow) // 2)]]
    ground = float(np.median(lowest[resting]))
    noise = float(1.4826 * np.median(np.abs(lowest[slow] - ground)))
    skating = float(np.median(slowest[slow]))
    height = position[..., 2] - ground

    def stands(times: float) -> npt.NDArray[np.bool_]:
        near, calm = (
            height < MAX_HEIGHT + times * noise,
            speed < (1 + (times > ENTER)) * MAX_SPEED + times * skating,
        )
        return (near & calm).any(axis=1)

    comes, stays = stands(ENTER), stands(LEAVE)
    planted = np.zeros(len(sole), dtype=bool)
    for frame in range(len(sole)):
        before = frame > 0 and planted[frame - 1]
        planted[frame] = stays[frame] if before else comes[frame]
    inside = planted.copy()
    inside[1:-1] &= planted[2:] & planted[:-2]
    inside[[0, -1]] = False
    return Stance(planted, ground, noise, float(slowest[inside].max(initial=0.0)))


def _white_noise(values: Array) -> float:
    """Return the scatter from frame to frame, from third differences; smooth motion has none."""
    if len(values) < 5:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(values, 3))) / np.sqrt(20))
