"""What the camera itself does: a rotation, frame by frame, as the still background shows it.

A camera that turns moves every picture point by a homography, whatever its depth. About the picture's
middle, with focal length f in pixels and κ = 1/f²,

    q(p) = p + a (1 + κ x p) + b (i + κ y p) + i θ p + z p,   p = x + i y,

to first order: a and b are the shift of the middle, θ the turn and z a breathing of the focus. The terms
with κ bend the picture. Without them a pan would pass for a turn and a turn for a zoom, so that a few
patches on one side tell another rotation than those on the other. Where the focal length is not known,
κ is found from how all frames bend.
"""

from dataclasses import dataclass, fields

import numpy as np

from sysid.roll import Array
from sysid.video.types import Complex, Rows

MIN_PATCHES = 4
"""Least number of patches that show a rotation."""
MAX_SCATTER = 1.5
"""Scatter of the patches about a common rotation above which they show none [px]."""
MIN_FRAMES_SEEN = 0.8
"""Share of the frames that must show the background for any of it to count."""
MAX_LIKENESS, MIN_SHARE = 0.8, 0.03
"""Correlation with the board's own turn, from frame to frame, and share of its size, from which on a motion is no
camera's. A hand-held camera turns by a few tenths of a degree where a board turns by twenty."""
POOLED_FREEDOM = 20.0
"""Degrees of freedom [1] that the clip's mean scatter counts for beside each frame's own."""
KAPPA_SPREAD = 0.5
"""Standard deviation of κ, as a share of it: twice that of the logarithm of a phone's focal length."""
DISTORTION_DOUBT = 0.1
"""Standard deviation of the logarithm of the focal length, as a lens that bends the picture itself hides it:
what a first coefficient of 0.03, usual in phones, does."""
CORRELATED_FRAMES = 10.0
"""[frames] In a row, whose patches err alike, so that they count as one where κ is concerned."""


@dataclass(frozen=True, slots=True)
class Sights:
    """How the background of n frames moved against the first frame of the film."""

    motion: Array
    """a, b [px], θ [rad] and z, shape (n, 4); NaN where too few patches agree."""
    bend: Array
    """Derivative of θ with respect to κ at the same picture, and those of a, b and z, shape (n, 4)."""
    variance: Array
    """Variance of a patch's place, in each direction [px²], shape (n,)."""
    freedom: Array
    """Degrees of freedom behind it, shape (n,)."""
    spread: Array
    """Variance of a and of θ for patches of variance 1 px², shape (n, 2)."""
    kappa: Array
    """Information on a change of κ, and that times the change, for patches of variance 1 px²; shape (n, 2)."""


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
    mistaken: bool = False
    """Whether what was taken for background turned with the board, so that none of it is believed."""

    @property
    def size(self) -> float:
        """Standard deviation of the camera's rotation about the axis where it is largest [rad]."""
        turns = self.motion[:, :3] / np.array([self.focal, self.focal, 1.0])
        return float(np.std(turns, axis=0).max())

    @property
    def significant(self) -> bool:
        """Whether the camera moved by more than what noise alone would show."""
        noise = float(np.sqrt(np.mean(self.std**2)))
        turned = float(np.std(self.motion[:, 2])) > 2.5 * noise + 1e-5
        shifted = float(np.std(self.motion[:, :2], axis=0).max()) > 2.5 * self.shift_std + 0.1
        return self.found and (turned or shifted)

    def goes_with(self, turn: Array) -> bool:
        """Return whether the motion follows the board's own turn [rad], shape (n,), from frame to frame.

        A camera shakes as it likes: it was the board, or its shadow, that was taken for background.
        """
        step = np.diff(turn)
        moved = np.diff(self.motion[:, :3] / [self.focal, self.focal, 1.0], axis=0)
        size = np.maximum(np.linalg.norm(moved, axis=0), 1e-12)
        likeness = np.abs(step @ moved) / size / max(float(np.linalg.norm(step)), 1e-12)
        return bool(np.any((likeness > MAX_LIKENESS) & (size > MIN_SHARE * np.linalg.norm(step))))

    def undo(self, points: Array, rows: Rows) -> Array:
        """Return points (m, N, 2) [px] of the frames `rows` (m,) where they would be with the camera still."""
        place = points[..., 0] + 1j * points[..., 1] - self.centre
        still = still_places(place, self.motion[rows, None], self.focal) + self.centre
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


def fit_rotations(home: Complex, seen: Complex, focal: float) -> Sights:
    """Fit the camera's motion to patches of background, ignoring those that move on their own.

    Args:
        home: Places of the patches in the first frame, about the picture's middle [px], shape (m,).
        seen: Their places in n frames [px], shape (n, m); NaN where one is not found.
        focal: Focal length [px].
    """
    found = np.isfinite(seen)
    seen = np.where(found, seen, home)
    motion = np.zeros((len(seen), 4))
    motion[:, 0] = _middle(np.where(found, (seen - home).real, np.nan))
    motion[:, 1] = _middle(np.where(found, (seen - home).imag, np.nan))
    motion[~np.isfinite(motion)] = 0.0
    gap, design = _against(home, seen, motion, focal)
    scale = np.zeros(len(seen))
    for _ in range(6):
        distance = np.abs(gap)
        # 1.18: the median of a Rayleigh distribution.
        scale = np.nan_to_num(_middle(np.where(found, distance, np.nan))) / 1.18 + 0.02
        motion = motion + _solve(design, found / (1 + (distance / (2.5 * scale[:, None])) ** 2), gap)[0]
        gap, design = _against(home, seen, motion, focal)
    # Those that agree, once more with equal weights: their scatter is then that of a patch.
    good = (found & (np.abs(gap) < 3.5 * scale[:, None])).astype(np.float64)
    step, inverse = _solve(design, good, gap)
    motion = motion + step
    rest = np.where(good, gap - (design @ step[:, :, None])[..., 0], 0)
    bent = (motion[:, :1] * home.real + motion[:, 1:2] * home.imag) * home * good
    bend = -(inverse @ _inner(design, bent)[:, :, None])[..., 0]
    own = bent + (design @ bend[:, :, None])[..., 0] * good
    freedom = 2.0 * good.sum(axis=1) - 4
    lost = (good.sum(axis=1) < MIN_PATCHES) | (scale > MAX_SCATTER)
    motion[lost] = np.nan
    return Sights(
        motion,
        bend,
        (np.abs(rest) ** 2).sum(axis=1) / np.maximum(freedom, 1),
        freedom,
        np.stack([inverse[:, 0, 0], inverse[:, 2, 2]], axis=1),
        np.stack([(np.abs(own) ** 2).sum(axis=1), (own.conj() * rest).real.sum(axis=1)], axis=1),
    )


def whole_shake(sights: list[Sights], focal: float, centre: complex, *, known: bool) -> Shake:
    """Gather what all frames show, with one focal length for all unless it is known.

    Args:
        sights: What the film shows, some frames each.
        focal: Focal length with which they were fitted [px].
        centre: Middle of the picture [px].
        known: The lens is calibrated.
    """
    motion, bend, own, freedom, spread, kappa = (
        np.concatenate([getattr(sight, field.name) for sight in sights]) for field in fields(Sights)
    )
    seen = np.asarray(np.isfinite(motion).all(axis=1), np.bool_)
    if seen.mean() <= MIN_FRAMES_SEEN:
        return still(len(seen), focal, centre)
    before = 1 / focal**2
    change, doubt, left = 0.0, 0.0, own[seen]
    for _ in range(0 if known else 3):  # the scatter about the right bend is less
        mean = max(float(np.average(left, weights=freedom[seen])), 1e-4)
        information = kappa[seen].sum(axis=0) / (CORRELATED_FRAMES * mean)
        prior = 1 / (KAPPA_SPREAD * before) ** 2
        change = float(np.clip(information[1] / (information[0] + prior), -0.9 * before, 3 * before))
        doubt = float(1 / np.sqrt(information[0] + prior))
        less = (change**2 * kappa[seen, 0] - 2 * change * kappa[seen, 1]) / freedom[seen]
        left = np.maximum(own[seen] + less, 0)
    mean = float(np.average(left, weights=freedom[seen]))
    variance = (freedom[seen] * left + POOLED_FREEDOM * mean) / (freedom[seen] + POOLED_FREEDOM)
    std = np.zeros(len(seen))
    std[seen] = np.hypot(np.sqrt(variance * spread[seen, 1]), doubt * bend[seen, 2])
    motion = motion + change * bend
    # Where the background is hidden: carried on, and as uncertain as the camera is restless.
    std[~seen] = np.hypot(std[seen].max(), np.std(motion[seen, 2]))
    number, known_at = np.arange(len(seen)), np.flatnonzero(seen)
    motion = np.stack([np.interp(number, known_at, column[seen]) for column in motion.T], axis=1)
    shift_std = float(np.sqrt(mean * np.median(spread[seen, 0])))
    kappa_found = before + change
    focal_std = 0.0 if known else float(np.hypot(doubt / kappa_found / 2, DISTORTION_DOUBT))
    return Shake(motion, std, shift_std, float(kappa_found**-0.5), focal_std, centre, True)


def still(count: int, focal: float, centre: complex, *, found: bool = False) -> Shake:
    """Return the shake of a film whose background shows none, or of a camera that is known to stand still."""
    return Shake(np.zeros((count, 4)), np.zeros(count), 0.0, focal, np.inf, centre, found)


def _against(home: Complex, seen: Complex, motion: Array, focal: float) -> tuple[Complex, Complex]:
    """What `motion` leaves open, shape (n, m), and the derivatives of the places seen, shape (n, m, 4)."""
    place = seen_places(home, motion[:, None], focal)
    bend = place / focal**2
    columns = np.stack([1 + place.real * bend, 1j + place.imag * bend, 1j * place, place], axis=-1)
    return seen - place, columns


def _solve(design: Complex, weight: Array, rest: Complex) -> tuple[Array, Array]:
    """Least squares of each frame: the step, shape (n, 4), and the inverse of the normal matrix."""
    weighted = design * weight[..., None]
    normal = (weighted.conj().transpose(0, 2, 1) @ design).real
    # A hair's breadth of damping, so that frames which show nothing are no error.
    inverse = np.asarray(np.linalg.inv(normal + np.diag([1e-6, 1e-6, 1e-2, 1e-2])), np.float64)
    return (inverse @ _inner(weighted, rest)[:, :, None])[..., 0], inverse


def _inner(design: Complex, values: Complex) -> Array:
    return (design.conj().transpose(0, 2, 1) @ values[:, :, None]).real[..., 0]


def _middle(values: Array) -> Array:
    """Median along the second axis of what is finite; NaN, without a warning, where nothing is."""
    ordered = np.sort(values, axis=1)
    count = np.isfinite(ordered).sum(axis=1)
    return ordered[np.arange(len(values)), np.maximum(count - 1, 0) // 2]
