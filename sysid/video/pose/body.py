"""A rigid body that turns about an axis, as a camera along that axis sees it.

Every point of the body, whatever its depth, runs on a circle: with complex numbers for picture
coordinates,

    z_ij = τ_i + c_j + exp(i φ_i) q_j.

φ_i is the roll in frame i, τ_i a shift of the whole body (a truck that gives way; never an angle), q_j
the body's shape and c_j the centres of its points' circles, which differ if their depths do and the
axis is not in the middle of the picture. Angles and shifts follow from a frame alone.
"""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.types import Complex


@dataclass(frozen=True, slots=True)
class Body:
    """Shape and circles of a body's points, in the rectified picture [px]; of several bodies along further first axes."""

    shape: Complex
    """q, shape (..., N)."""
    centre: Complex
    """c, shape (..., N)."""

    def laid(self, z: Complex) -> tuple[Array, Complex]:
        """Return angle [rad], shape (n,), and places [px], shape (n, N), for one body or more, where the body fits z [px], as they, best."""
        shape = self.shape - self.shape.mean(axis=-1, keepdims=True)
        place = z - self.centre[..., None, :]
        shift = place.mean(axis=-1, keepdims=True)
        angle = np.angle(((place - shift) @ shape.conj()[..., None])[..., 0])
        turned = np.exp(1j * angle)[..., None] * shape[..., None, :]
        return angle, self.centre[..., None, :] + shift + turned
