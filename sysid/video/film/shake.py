"""What the camera itself does: a rotation, frame by frame, as the still background shows it.

A camera that turns moves every picture point by a homography, whatever its depth. About the picture's
middle, with focal length f in pixels and κ = 1/f²,

    q(p) = p + a (1 + κ x p) + b (i + κ y p) + i θ p + z p,   p = x + i y,

to first order: a and b are the shift of the middle, θ the turn and z a breathing of the focus. The terms
with κ bend the picture. Without them a pan would pass for a turn and a turn for a zoom, so that a few
patches on one side tell another rotation than those on the other. Where the focal length is not known,
κ is found from how all frames bend.
"""

from dataclasses import dataclass

import numpy as np

from sysid.roll import Array
from sysid.video.types import Complex

MIN_PATCHES = 4
"""Least number of patches that show a rotation."""
MAX_SCATTER = 3.0
"""Scatter of the patches about a common rotation above which they show none [px]."""
MIN_FRAMES_SEEN = 0.8
"""Share of the frames that must show the background for any of it to count."""
POOLED_FREEDOM = 20.0
"""Degrees of freedom [1] that the clip's mean scatter counts for beside each frame's own."""
KAPPA_SPREAD = 0.5
"""Standard deviation of κ, as a share of it: twice that of the logarithm of a phone's focal length."""
DISTORTION_DOUBT = 0.1
"""Standard deviation of the logarithm of the focal length, as a lens that bends the picture itself hides it:
what a first coefficient of 0.03, usual in phones, does."""
CORRELATED_FRAMES = 10.0
"""[frames] In a row, whose patches err alike, so that they count as one where κ is concerned."""
ROUNDS = 6
"""Times that patches are weighed anew by how far they are off."""
BATCH_FRAMES = 100
"""Frames that are worked out at once: that takes little longer than one; and that tell κ at most."""


@dataclass(frozen=True, slots=True)
class Shake:
    """Rotation of the camera against the first frame."""

    motion: Array
    """a, b [px], θ [rad] and z of each frame, shape (n, 4)."""
    std: Array
    """Standard deviation of θ [rad], shape (n,)."""
    shift_std: float
    """Standard deviation of a and b [px], typical."""
    focal: float
    """Focal length with which the picture bends [px]."""
    focal_std: float
    """Standard deviation of its logarithm."""
    centre: complex
    """Middle of the picture [px]."""
    found: bool
    """Whether there was enough background to see any of it."""

    @property
    def size(self) -> float:
        """Standard deviation of the camera's rotation about the axis where it is largest [rad]."""
        return float((np.std(self.motion[:, :3], axis=0) / [self.focal, self.focal, 1.0]).max())

    @property
    def significant(self) -> bool:
        """Whether the camera moved by more than what noise alone would show."""
        noise = float(np.sqrt(np.mean(self.std**2)))
        turned = float(np.std(self.motion[:, 2])) > 2.5 * noise + 1e-5
        shifted = float(np.std(self.motion[:, :2], axis=0).max()) > 2.5 * self.shift_std + 0.1
        return self.found and (turned or shifted)

    def undo(self, points: Array) -> Array:
        """Return the points of all frames, shape (n, N, 2) [px], where they would be with the camera still."""
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


def find_shake(home: Complex, seen: Complex, focal: float, centre: complex, *, known: bool) -> Shake:
    """Fit the camera's motion to patches of background, with one focal length for all frames.

    Args:
        home: Places of the patches in the first frame of the film, about the picture's middle [px], shape (m,).
        seen: Their places in n frames [px], shape (n, m); NaN where one is not found.
        focal: Focal length, as far as it is known beforehand [px].
        centre: Middle of the picture [px].
        known: The lens is calibrated: the focal length is not to be found.
    """

    def fitted(kappa: float) -> list[Array]:
        parts = [seen[at : at + BATCH_FRAMES] for at in range(0, len(seen), BATCH_FRAMES)]
        found = [fit_rotations(home, part, kappa**-0.5) for part in parts]
        return [np.concatenate(each) for each in zip(*found, strict=True)]

    kappa, doubt = (1 / focal**2, 0.0) if known else _bending(home, seen, 1 / focal**2)
    motion, square, freedom, spread, _ = fitted(kappa)
    good = np.asarray(np.isfinite(motion).all(axis=1), np.bool_)
    if good.mean() <= MIN_FRAMES_SEEN:
        return still(len(seen), focal, centre)
    mean = max(float(square[good].sum() / freedom[good].sum()), 1e-4)
    std = np.sqrt((square + POOLED_FREEDOM * mean) / (freedom + POOLED_FREEDOM) * spread[:, 1])
    if doubt:
        std = np.hypot(std, np.abs(fitted(kappa + doubt)[0][:, 2] - motion[:, 2]))
    # Where the background is hidden: carried on, and as uncertain as the camera is restless.
    good &= np.isfinite(std)
    std[~good] = np.hypot(std[good].max(), np.std(motion[good, 2]))
    number, known_at = np.arange(len(seen)), np.flatnonzero(good)
    motion = np.stack([np.interp(number, known_at, column[good]) for column in motion.T], axis=1)
    shift_std = float(np.sqrt(mean * np.median(spread[good, 0])))
    focal_std = 0.0 if known else float(np.hypot(doubt / kappa / 2, DISTORTION_DOUBT))
    return Shake(motion, std, shift_std, float(kappa**-0.5), focal_std, centre, True)


def still(count: int, focal: float, centre: complex, *, found: bool = False) -> Shake:
    """Return the shake of a film whose background shows none, or of a camera that is known to stand still."""
    return Shake(np.zeros((count, 4)), np.zeros(count), 0.0, focal, np.inf, centre, found)


def _bending(home: Complex, seen: Complex, before: float) -> tuple[float, float]:
    """Find κ by how all frames bend, with its standard deviation, both [1/px²]."""
    some = seen[np.unique(np.linspace(0, len(seen) - 1, BATCH_FRAMES).astype(int))]
    kappa, doubt, prior = before, KAPPA_SPREAD * before, (KAPPA_SPREAD * before) ** -2
    for _ in range(3):  # the scatter about the right bend is less
        motion, square, freedom, _, tells = fit_rotations(home, some, kappa**-0.5)
        if not (good := np.isfinite(motion[:, 0])).any():
            break
        unit = CORRELATED_FRAMES * max(float(square[good].sum() / freedom[good].sum()), 1e-4)
        information, pull = tells[good].sum(axis=0) / unit
        step = (pull - prior * (kappa - before)) / (information + prior)
        kappa, doubt = float(np.clip(kappa + step, 0.1 * before, 4 * before)), (information + prior) ** -0.5
    return kappa, doubt


def fit_rotations(home: Complex, seen: Complex, focal: float) -> tuple[Array, Array, Array, Array, Array]:
    """Fit a camera's motion to each of n frames, ignoring patches that move on their own.

    Args:
        home: Places of the patches in the first frame, about the picture's middle [px], shape (m,).
        seen: Their places in n frames [px], shape (n, m); NaN where one is not found.
        focal: Focal length [px].

    Returns:
        Motion, shape (n, 4), NaN where too few patches agree; sum of squares that is left [px²], and degrees of freedom behind
        it, shape (n,); variance of a and of θ for patches of variance 1 px², shape (n, 2); information on a change of κ, and that
        times the change, for such patches, shape (n, 2).
    """
    found = np.isfinite(seen)
    seen = np.where(found, seen, home)
    motion, weight = np.zeros((len(seen), 4)), found.astype(np.float64)
    gap = step = scale = design = weighted = inverse = np.zeros(0)
    for last in (*[False] * ROUNDS, True):
        place = seen_places(home, motion[:, None], focal)
        bend, gap = place / focal**2, seen - place
        design = np.stack([1 + place.real * bend, 1j + place.imag * bend, 1j * place, place], axis=-1)
        distance = np.abs(gap)
        # 1.18: the median of a Rayleigh distribution.
        scale = np.nan_to_num(_middle(np.where(found, distance, np.nan))) / 1.18 + 0.02
        share = distance / scale[:, None]
        # Those that agree, at last with equal weights: their scatter is then that of a patch.
        weight = found * ((share < 3.5) if last else 1 / (1 + (share / 2.5) ** 2))
        weighted = (design * weight[..., None]).conj().transpose(0, 2, 1)
        # A hair's breadth of damping, so that frames which show nothing are no error.
        normal = (weighted @ design).real + np.diag([1e-6, 1e-6, 1e-2, 1e-2])
        inverse = np.asarray(np.linalg.inv(normal), np.float64)
        step = (inverse @ (weighted @ gap[:, :, None]).real)[..., 0]
        motion = motion + step
    rest = weight * (gap - (design @ step[:, :, None])[..., 0])
    bent = (motion[:, :1] * home.real + motion[:, 1:2] * home.imag) * home
    own = weight * (bent - (design @ (inverse @ (weighted @ bent[:, :, None]).real))[..., 0])
    tells = np.stack([(np.abs(own) ** 2).sum(axis=1), (own.conj() * rest).real.sum(axis=1)], axis=1)
    motion[(weight.sum(axis=1) < MIN_PATCHES) | (scale > MAX_SCATTER)] = np.nan
    freedom = np.maximum(2 * weight.sum(axis=1) - 4, 1)
    spread = np.stack([inverse[:, 0, 0], inverse[:, 2, 2]], axis=1)
    return motion, (np.abs(rest) ** 2).sum(axis=1), freedom, spread, tells


def _middle(values: Array) -> Array:
    """Median along the second axis of what is finite; NaN, without a warning, where nothing is."""
    ordered = np.sort(values, axis=1)
    count = np.isfinite(ordered).sum(axis=1)
    return ordered[np.arange(len(values)), np.maximum(count - 1, 0) // 2]
