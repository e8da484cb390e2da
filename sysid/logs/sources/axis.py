"""The axis that the deck turns about, in the axes of a sensor that is mounted anyhow."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sysid.logs.table.choose import Choice
from sysid.logs.table.remarks import Remarks, note, warning
from sysid.roll import Array

ONE_AXIS = 0.8
"""Share of the rotation about one axis from which on a motion counts as one-axis."""
VERTICAL_COSINE = 0.8
"""Cosine between roll axis and vertical beyond which gravity tells too little of roll."""


def find_roll_axis(rates: Array, choice: Choice) -> tuple[Array, Remarks]:
    """Return the unit vector forward, shape (3,), and how it was chosen: the user's axis, or the one that the sensor turns about most.

    The rates are in sensor axes [rad/s], shape (n, 3).
    """
    free = rates - np.median(rates, axis=0)
    moments, axes = np.linalg.eigh(free.T @ free)
    if choice.axis:
        vector = np.eye(3)["xyz".index(choice.axis)]
        share = float(np.sum((free @ vector) ** 2) / max(moments.sum(), 1e-30))
        remarks = note("axis", f"the sensor's {'-' if choice.sign < 0 else '+'}{choice.axis}, as --axis says")
    else:
        vector = axes[:, -1] * np.sign(axes[np.argmax(np.abs(axes[:, -1])), -1])
        share = float(moments[-1] / max(moments.sum(), 1e-30))
        main = "xyz"[int(np.argmax(np.abs(vector)))]
        shown = ", ".join(f"{value:.2f}" for value in vector)
        remarks = note(
            "axis",
            f"({shown}) of the sensor, {100 * share:.0f} % of its rotation, taken as forward; "
            f"--axis -{main} if the sensor's {main} points backward",
        )
    if share < ONE_AXIS:
        remarks += warning(
            f"the sensor turns about several axes (only {100 * share:.0f} % about the roll axis): not a one-axis motion"
        )
    return vector * choice.sign, remarks


@dataclass(frozen=True, slots=True)
class Plane:
    """Axes square to the roll axis, in sensor axes: roll is zero where gravity is felt along `top`."""

    top: Array
    """Unit vector, shape (3,)."""
    left: Array
    """Unit vector to the left of it, seen along the roll axis from behind, shape (3,)."""
    zero: Remarks
    """The zero of roll in words."""

    def of(self, vectors: Array) -> npt.NDArray[np.complex128]:
        """Return the parts of vectors, shape (n, 3), along top and left as complex numbers in their unit, shape (n,)."""
        return np.asarray(vectors @ self.top + 1j * (vectors @ self.left))


def plane_about(axis: Array, up: Array) -> Plane | None:
    """Return the plane square to the roll axis; None if the axis is upright, where gravity tells no roll.

    Roll is zero where the sensor axis nearest to the vertical points along it, seen along the roll axis. So a sensor
    that lies flat reads the true roll, on any of its faces.

    Args:
        axis: Unit vector forward in sensor axes, shape (3,).
        up: Vectors against gravity in sensor axes [1], shape (n, 3).
    """
    mean = up.mean(axis=0) / np.linalg.norm(up, axis=1).mean()
    if np.median(np.abs(up @ axis) / np.linalg.norm(up, axis=1)) > VERTICAL_COSINE:
        return None
    square = np.eye(3) - np.outer(axis, axis)
    facing = (square @ mean) / np.linalg.norm(square, axis=0).clip(1e-9)
    facing[np.linalg.norm(square, axis=0) < 0.5] = 0.0  # nearly along the roll axis
    nearest = int(np.argmax(np.abs(facing)))
    sign = 1.0 if facing[nearest] >= 0 else -1.0
    top = square[:, nearest] * sign
    top /= np.linalg.norm(top)
    zero = note("zero", f"where the sensor's {'+' if sign > 0 else '-'}{'xyz'[nearest]} points up")
    return Plane(top, np.cross(top, axis), zero)
