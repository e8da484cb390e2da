"""A rigid body that turns about an axis, as a camera along that axis sees it.

Every point of the body, whatever its depth, runs on a circle: with complex numbers for picture
coordinates,

    z_ij = τ_i + c_j + exp(i φ_i) q_j.

φ_i is the roll in frame i, τ_i a shift of the whole body (a truck that gives way; never an angle), q_j
the body's shape and c_j the centres of its points' circles, which differ if their depths do and the
axis is not in the middle of the picture.

Angles and shifts follow from a frame alone, so that they are eliminated; what all frames have in
common, c, q and a few numbers that z itself depends on, is one least-squares problem.
"""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.types import Complex, Mask


@dataclass(frozen=True, slots=True)
class Body:
    """Shape and circles of a body's points, in the rectified picture."""

    shape: Complex
    """q, shape (N,)."""
    centre: Complex
    """c, shape (N,)."""

    def moved(self, step: Array) -> "Body":
        """Return the body changed by a step of Re c, Im c, Re q and Im q [px], shape (4N,) or longer."""
        n = len(self.shape)
        parts = step[: 4 * n].reshape(4, n)
        shape = self.shape + parts[2] + 1j * parts[3]
        return Body(shape - shape.mean(), self.centre + parts[0] + 1j * parts[1])


def first_body(z: Complex, mask: Mask) -> Body:
    """Return the body as the frame that shows most of it has it; its circles all about one centre.

    Args:
        z: Rectified points [px], shape (n, N).
        mask: Which are seen, shape (n, N).
    """
    row = int(np.argmax(mask.sum(axis=1)))
    middle = z[row, mask[row]].mean()
    return Body(np.where(mask[row], z[row] - middle, 0), np.zeros(z.shape[1], np.complex128))


def turn_of(z: Complex, mask: Mask, body: Body) -> tuple[Array, Complex, Complex]:
    """Find the angle of each frame.

    Args:
        z: Rectified points [px], shape (n, N); anything finite where not seen.
        mask: Which are seen, shape (n, N).
        body: Shape and circles.

    Returns:
        The angles [rad], shape (n,); what does not fit [px], shape (n, N), 0 where not seen; and the points
        seen about their middle, turned [px], shape (n, N).
    """
    weight = mask.astype(np.float64)
    count = np.maximum(weight.sum(axis=1, keepdims=True), 1)
    place = np.where(mask, z - body.centre, 0)
    place = place - weight * (place.sum(axis=1, keepdims=True) / count)
    shape = weight * (body.shape - (weight @ body.shape)[:, None] / count)
    angle = np.angle((place * shape.conj()).sum(axis=1))
    turned = np.exp(1j * angle)[:, None] * shape
    return angle, place - turned, turned


def common_problem(
    rest: Complex, angle: Array, turned: Complex, mask: Mask, weight: Array, slopes: Complex
) -> tuple[Array, Array]:
    """Normal equations for what all frames have in common: Re c, Im c, Re q, Im q and the rest.

    Args:
        rest: What does not fit, shape (n, N).
        angle: Angles [rad], shape (n,).
        turned: The points seen, turned, shape (n, N).
        mask: Which are seen.
        weight: One over the variance of a point's place, by frame, shape (n,).
        slopes: Derivatives of z with respect to the further numbers, shape (p, n, N).

    Returns:
        Normal matrix, shape (4N + p, 4N + p), and minus the gradient. Both are singular for what frames
        eliminate: a shift or a turn of the whole body.
    """
    size = mask.shape[1]
    slopes = np.asarray(slopes * mask, np.complex128)
    spin = np.exp(1j * angle)[:, None]
    weights = mask * weight[:, None]
    zero = np.zeros((size, size))
    ones, cosine = np.diag(weights.sum(axis=0)), np.diag((weights * np.cos(angle)[:, None]).sum(axis=0))
    sine = np.diag((weights * np.sin(angle)[:, None]).sum(axis=0))
    still = np.concatenate([-np.real(slopes), -np.imag(slopes)], axis=2)
    back: Complex = np.asarray(spin.conj() * slopes, np.complex128)
    spun = np.concatenate([-back.real, -back.imag], axis=2)
    side = np.einsum("n,pnk->pk", weight, np.concatenate([still, spun], axis=2))
    own = np.einsum("n,pnj,qnj->pq", weight, slopes.conj(), slopes).real
    plain = np.block(
        [[ones, zero, cosine, -sine], [zero, ones, sine, cosine], [cosine, sine, ones, zero], [-sine, cosine, zero, ones]]
    )  # fmt: skip
    plain = np.block([[plain, side.T], [side, own]])
    columns = _absorbed(angle, turned, mask, slopes)
    absorbed = (columns * np.sqrt(weight)[:, None, None]).reshape(-1, columns.shape[2])
    pull: Complex = np.asarray(weight[:, None] * rest, np.complex128)
    turned_pull: Complex = np.asarray(spin.conj() * pull, np.complex128)
    down = [
        pull.real.sum(axis=0),
        pull.imag.sum(axis=0),
        turned_pull.real.sum(axis=0),
        turned_pull.imag.sum(axis=0),
    ]
    along = -np.einsum("nj,pnj->p", pull.conj(), slopes).real
    return plain - absorbed.T @ absorbed, np.concatenate([*down, along])


def angle_slopes(angle: Array, turned: Complex, mask: Mask, slopes: Complex) -> Array:
    """Derivatives of each angle with respect to Re c, Im c, Re q, Im q and the rest, shape (n, 4N + p).

    [rad/px] for the body, rad by the unit of each of the p further numbers. Arguments are as in `common_problem`.
    """
    length = np.sqrt(np.maximum((np.abs(turned) ** 2).sum(axis=1), 1e-18))
    return _absorbed(angle, turned, mask, slopes * mask)[:, 2] / length[:, None]


def _absorbed(angle: Array, turned: Complex, mask: Mask, slopes: Complex) -> Array:
    """What a frame's own shift and turn absorb of a change of each number, shape (n, 3, 4N + p).

    The columns of the residual's derivative (-1, -i, -exp(iφ), -i exp(iφ) and the slopes) times three
    unit vectors: both shifts, and the turn.
    """
    spin = np.exp(1j * angle)[:, None]
    even = mask / np.sqrt(np.maximum(mask.sum(axis=1, keepdims=True), 1))
    length = np.sqrt(np.maximum((np.abs(turned) ** 2).sum(axis=1, keepdims=True), 1e-18))
    units = (even.astype(np.complex128), 1j * even, 1j * turned / length)
    rows: list[Array] = []
    for unit in units:
        back = unit.conj()
        body = [-back.real, back.imag, -(back * spin).real, (back * spin).imag]
        rest = np.einsum("nj,pnj->np", back, slopes).real
        rows.append(np.concatenate([*body, rest], axis=1))
    return np.stack(rows, axis=1)
