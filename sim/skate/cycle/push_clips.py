"""Pushing as reference clips have it: which pose belongs to a speed and to a time in the pushing phase.

The clips come from whoever builds the task; here they are plain numbers. Each begins with the left foot's
touchdown, where dismounting ends, and repeats without a seam.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim.skate.arrays import constant, namespace
from sim.skate.cycle.clock import CONTROL_PERIOD
from sysid.roll import Array

Clip = tuple[float, Array]
"""Mean speed of the pelvis in the plane [m/s], and joint angles [rad], shape (frames, 23), one frame a policy step."""


class PushReference:
    """All clips as one array, of the kind, precision and device of the first speeds that it is asked for."""

    def __init__(self, clips: Sequence[Clip]) -> None:
        """Take the clips over.

        Raises:
            ValueError: There is no clip.
        """
        if not clips:
            raise ValueError("pushing by tracking needs at least one reference clip")
        speeds, joints = zip(*clips, strict=True)
        lengths = np.array([len(one) for one in joints])
        self._arrays = np.array(speeds), lengths, np.cumsum(lengths) - lengths, np.concatenate(joints)
        self._placed: list[Any] | None = None

    def joints(self, speed: Any, time: Any) -> Any:
        """Return the joint angles of the clip whose speed is nearest [rad], shape (n, 23).

        Args:
            speed: Commanded speeds [m/s], shape (n,).
            time: Times since the pushing phase began [s], shape (n,).
        """
        xp = namespace(speed)
        if self._placed is None:
            self._placed = [constant(array, speed) for array in self._arrays]
        speeds, lengths, first, joints = self._placed
        which = xp.abs(speed[:, None] - speeds).argmin(axis=-1)
        frame = xp.round(time / CONTROL_PERIOD) % lengths[which]
        index = first[which] + frame  # whole numbers below 2^24: exact in single precision
        return joints[index.astype(int) if xp is np else index.long()]
