"""The camera's own motion: a rotation, frame by frame, as the background shows it.

A camera that turns moves every point of the picture by a homography, whatever its depth. With places from the middle of the picture, the focal length f in pixels and κ = 1/f²:

    q(p) = p + a (1 + κ x p) + b (i + κ y p) + i θ p + z p,   p = x + i y,

to first order. a and b are the shift of the middle, θ is the turn and z a breathing of the focus.
"""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.types import Complex

MIN_PATCHES = 4
"""Least number of patches that show a rotation: it has four numbers, and a patch shows two."""


@dataclass(frozen=True, slots=True)
class Shake:
    """Rotation of the camera against the first frame."""

    motion: Array
    """a, b [px], θ [rad] and z of each frame, shape (n, 4); zero where the camera stands still."""
    std: Array
    """Standard deviation of θ [rad], shape (n,)."""
    focal: float
    """Focal length [px]."""
    centre: complex
    """Middle of the picture [px]."""
    found: bool
    """Whether some background was followed, or the user says that the camera stands still."""

    @property
    def moves(self) -> bool:
        """Whether the camera moves."""
        return bool(self.motion.any())

    @property
    def size(self) -> float:
        """Standard deviation of the camera's rotation about the axis where it is largest [rad]."""
        return float((np.std(self.motion[:, :3], axis=0) / [self.focal, self.focal, 1.0]).max())

    def undo(self, points: Array) -> Array:
        """Return the points of all frames, shape (n, N, 2) [px], as a still camera shows them."""
        place = points[..., 0] + 1j * points[..., 1] - self.centre
        still = still_places(place, self.motion[:, None], self.focal) + self.centre
        return np.stack([still.real, still.imag], axis=-1)


def seen_places(home: Complex, motion: Array, focal: float) -> Complex:
    """Return where a turned camera sees points, about the picture's middle [px], shape (n, m).

    Args:
        home: Points as the still camera sees them [px], shape (m,) or (n, m).
        motion: a, b [px], θ [rad] and z of each frame, shape (n, 1, 4).
        focal: Focal length [px].
    """
    return (1 + motion[..., 3]) * _turned(home, motion, focal)


def still_places(seen: Complex, motion: Array, focal: float) -> Complex:
    """Return the `home` [px], shape (n, m), that `seen_places` takes to `seen` (n, m) with the same motion; exact."""
    with np.errstate(invalid="ignore"):
        return _turned(seen / (1 + motion[..., 3]), -motion, focal)


def _turned(place: Complex, motion: Array, focal: float) -> Complex:
    """Rotate rays by the vector (-b/f, a/f, θ), by Rodrigues' formula."""
    wx, wy, wz = -motion[..., 1] / focal, motion[..., 0] / focal, motion[..., 2]
    x, y = place.real / focal, place.imag / focal
    square = wx**2 + wy**2 + wz**2
    sine = np.sinc(np.sqrt(square) / np.pi)
    versed = np.sinc(np.sqrt(square) / (2 * np.pi)) ** 2 / 2
    cosine = 1 - versed * square
    along = (wx * x + wy * y + wz) * versed
    depth = cosine + sine * (wx * y - wy * x) + wz * along
    across = cosine * x + sine * (wy - wz * y) + wx * along
    down = cosine * y + sine * (wz * x - wx) + wy * along
    with np.errstate(invalid="ignore"):  # places that are not seen are NaN, and stay so
        return focal * (across + 1j * down) / depth


def find_shake(
    home: Complex, seen: Complex, focal: float, centre: complex, turn: Array, focal_std: float = 0.0
) -> Shake:
    """Fit the camera's motion to patches of background, if it is likelier than none.

    A patch belongs to the body if a circle about the body's pivot explains its path better than the camera does. Both
    comparisons use the Bayesian information criterion with robust scales.

    Args:
        home: Places of the patches in the first frame of the film, about the picture's middle [px], shape (m,).
        seen: Their places in n frames [px], shape (n, m); NaN where one is not found.
        focal: Focal length [px].
        centre: Middle of the picture [px].
        turn: The body's turn [rad], shape (n,).
        focal_std: Standard deviation of the focal length's logarithm [1]; 0 for a known lens.
    """
    count = len(seen)
    if focal_std:
        focal = _likeliest_focal(home, seen, focal, focal_std)
    motion, rest, spread = fit_rotations(home, seen, focal)
    circle = _rest_of_circles(seen, turn)
    # Four numbers a patch for the body, and each patch's share of the camera's four numbers a frame.
    freedom = max(1 - 2 / len(home), 1 / len(home))
    apart = count * np.log(_scale(rest, 0) ** 2 / freedom / _scale(circle, 0) ** 2) < 2 * np.log(count)
    if apart.sum() < MIN_PATCHES:
        return still(count, focal, centre)
    home, seen = home[apart], seen[:, apart]
    motion, rest, spread = fit_rotations(home, seen, focal)
    scale, moved = (float(_scale(one.reshape(-1, 1), 0)[0]) for one in (rest, seen - home))
    gain = np.isfinite(rest).sum() * np.log(moved**2 / scale**2)
    good = np.isfinite(motion[:, 0])
    if gain < 2 * count * np.log(2 * len(home)) or good.sum() < count / 2:
        return still(count, focal, centre, found=True)
    # Frames without background take the motion of their neighbours, with the scatter of all frames.
    std = np.where(good, scale * np.sqrt(spread), np.std(motion[good, 2]))
    number = np.arange(count)
    motion = np.stack([np.interp(number, number[good], column[good]) for column in motion.T], axis=1)
    return Shake(motion, std, focal, centre, True)


def _likeliest_focal(home: Complex, seen: Complex, focal: float, std: float) -> float:
    """Return the focal length [px] with which patches (m,) in n frames (n, m) fit best, by likelihood and prior.

    A pan bends the picture the more, the shorter the lens. Fifty frames are used: neighbours err alike.
    """
    seen = seen[np.unique(np.linspace(0, len(seen) - 1, 50).astype(int))]
    tried = std * np.linspace(-2.5, 2.5, 11)
    rest = [fit_rotations(home, seen, focal * np.exp(one))[1].reshape(-1, 1) for one in tried]
    scale = np.array([_scale(one, 0)[0] for one in rest])
    score = -2 * np.isfinite(rest[0]).sum() * np.log(scale) - (tried / std) ** 2 / 2
    return float(focal * np.exp(tried[np.argmax(score)]))


def still(count: int, focal: float, centre: complex, *, found: bool = False) -> Shake:
    """Return the shake of a camera that stands still; `found` tells whether something shows it."""
    return Shake(np.zeros((count, 4)), np.zeros(count), focal, centre, found)


def _rest_of_circles(seen: Complex, turn: Array) -> Complex:
    """Return how far patches (n, m) are from circles that they run on with the body's turn (n,) [px], shape (n, m)."""
    design = np.stack([np.ones(len(turn)), np.exp(1j * turn)], axis=1)
    rest = np.full(seen.shape, np.nan + 0j)
    for one, path in enumerate(seen.T):
        good = np.isfinite(path)
        fit, *_ = np.linalg.lstsq(design[good], path[good], rcond=None)
        rest[good, one] = path[good] - design[good] @ fit
    return rest


def _scale(rest: Complex, axis: int) -> Array:
    """Return the standard deviation in each direction [px] of the finite values, by the median of a Rayleigh distribution."""
    return np.nanmedian(np.abs(rest), axis=axis) / np.sqrt(2 * np.log(2)) + 0.01


def fit_rotations(home: Complex, seen: Complex, focal: float) -> tuple[Array, Complex, Array]:
    """Fit a camera's motion to each of n frames, ignoring patches that move on their own.

    Args:
        home: Places of the patches in the first frame, about the picture's middle [px], shape (m,).
        seen: Their places in n frames [px], shape (n, m); NaN where one is not found.
        focal: Focal length [px].

    Returns:
        Motion, shape (n, 4), NaN if fewer than four patches agree; residuals [px], shape (n, m);
        variance of θ for patches of 1 px², shape (n,).
    """
    # A hundred frames at once take little longer than one, and little memory.
    parts = [_fit(home, seen[at : at + 100], focal) for at in range(0, len(seen), 100)]
    motion, rest, spread = (np.concatenate(each) for each in zip(*parts, strict=True))
    return motion, np.asarray(rest, np.complex128), spread


def _fit(home: Complex, seen: Complex, focal: float) -> tuple[Array, Complex, Array]:
    """Fit a camera's motion to each of some frames: as `fit_rotations`."""
    found = np.isfinite(seen)
    place = np.where(found, seen, home)
    motion, weight = np.zeros((len(seen), 4)), found.astype(np.float64)
    gap, inverse = np.zeros(seen.shape, complex), np.zeros((len(seen), 4, 4))
    for _ in range(8):  # weighed anew by how far each patch is off; converges by half or better each time
        there = seen_places(home, motion[:, None], focal)
        gap = place - there
        scale = _median(np.where(found, np.abs(gap), np.nan)) + 0.01
        weight = found / (1 + (np.abs(gap) / (3 * scale[:, None])) ** 2) ** 2
        bend = there / focal**2
        design = np.stack([1 + there.real * bend, 1j + there.imag * bend, 1j * there, there], axis=-1)
        weighted = (design * weight[..., None]).conj().transpose(0, 2, 1)
        # A hair's breadth of damping, so that frames without patches are no error.
        normal = (weighted @ design).real + np.diag([1e-6, 1e-6, 1e-2, 1e-2])
        inverse = np.asarray(np.linalg.inv(normal), np.float64)
        motion = motion + (inverse @ (weighted @ gap[:, :, None]).real)[..., 0]
    motion[weight.sum(axis=1) < MIN_PATCHES - 1] = np.nan
    return motion, np.where(found, gap, np.nan), inverse[:, 2, 2]


def _median(values: Array) -> Array:
    """Return the median of the finite values along the second axis, else 0."""
    ordered = np.sort(values, axis=1)
    count = np.isfinite(ordered).sum(axis=1)
    return np.nan_to_num(ordered[np.arange(len(values)), np.maximum(count - 1, 0) // 2])
