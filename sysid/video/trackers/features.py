"""No mark at all: the deck's own texture, always compared with one and the same frame.

The picture is turned back by the motion expected so far, so that patches look as they did in the
reference frame whatever the roll, and only a small rest is left to be measured. As the reference
never changes, nothing drifts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.frames import Frame, grey
from sysid.video.film.reel import Reel
from sysid.video.film.survey import Survey
from sysid.video.film.track import Track
from sysid.video.pose.angle import AngleTrack, fit_angle
from sysid.video.pose.camera_state import CameraState
from sysid.video.pose.prior import BodyPrior
from sysid.video.pose.rigid_group import rigid_group, similarities
from sysid.video.pose.view import View
from sysid.video.trackers._base import DEAD_ZONE, Target, Tracker, rests_at
from sysid.video.types import Complex, Mask, Picture

MAX_FEATURES, MIN_FEATURES = 60, 10
"""Patches that are followed at most, and at least."""
WINDOW = 21
"""Side of a patch [px]."""
SHAKE_MARGIN = 40
"""What is looked at beside what moves, for a camera that shakes [px]."""
CORRELATION_LENGTH = 80.0
"""Distance over which the errors of patches are alike, in a triangle [px]."""
STATIC_LIKENESS = 0.75
"""Correlation with the same place in other frames above which a patch stands still; noise lowers it, so that it
counts against the highest that the patch reaches."""
TURN_GUESSES = np.radians([0.0, 6.0, -6.0, 12.0, -12.0, 20.0, -20.0])
"""Turns that are tried, added to the expected one, where too few patches are found again."""
AS_EXPECTED = np.radians(1.0)
"""Difference of turns at which patches look as they did in the reference [rad]."""
CENTRE_STD = 0.03
"""Standard deviation of the circles' centres where points may lie anywhere on the deck, in focal lengths: a
tenth of a focal length aside, at depths that differ by a third."""
SAME_ERRORS = 3.0
"""Motion up to which patches of texture err alike [px]: as the deck turns they are seen at another slant, of which
the reference knows nothing."""
INLIER_DISTANCE = 1.2
"""Distance from the common motion within which a patch takes part in it [px]."""


def find_features(look: Survey) -> Array:
    """Return corners in the first frame that belong to what moves [px], shape (m, 2)."""
    left, top, right, bottom = look.box
    around = (left - SHAKE_MARGIN, top - SHAKE_MARGIN, right + SHAKE_MARGIN, bottom + SHAKE_MARGIN)
    frames = [frame.dark(around) for frame in look.frames[::2]]
    part, corner = frames[0].part(look.box)
    mask = 255 * look.moving[top:bottom, left:right].astype(np.uint8)
    edge = WINDOW // 2 + 3
    mask[:edge], mask[-edge:], mask[:, :edge], mask[:, -edge:] = 0, 0, 0, 0
    spacing = max(6.0, 0.5 * np.sqrt(max(int((mask > 0).sum()), 1) / MAX_FEATURES))
    corners: Any = cv2.goodFeaturesToTrack(
        cv2.GaussianBlur(part, (0, 0), 0.8), 4 * MAX_FEATURES, 0.01, spacing, mask=mask
    )
    if corners is None:
        return np.zeros((0, 2))
    places = np.asarray(corners, np.float64).reshape(-1, 2) + corner
    moved = np.array([_moves(frames, place) for place in places])
    return places[moved][:MAX_FEATURES] if moved.any() else np.zeros((0, 2))


@dataclass(slots=True)
class FeatureFollower:
    """Follows patches of texture that move as one rigid body."""

    reference: Frame
    """The first frame."""
    places: Array
    """Centres of the patches in it [px], shape (N, 2)."""
    box: tuple[int, int, int, int]
    _pose: Complex = field(default_factory=lambda: np.array([1 + 0j, 0j]))
    """The body's motion since the reference, x' = pose[0] x + pose[1] in complex pixels."""
    _rate: Array = field(default_factory=lambda: np.zeros(2))
    """AngleTrack rate [rad/s], and nothing more: the shift follows from the middle's velocity."""
    _velocity: complex = 0j
    _time: float | None = None
    _usual: int = 0
    """Patches that were found last; if the expected turn shows about as many, no other is tried."""
    _corner: tuple[int, int] = (0, 0)
    _patch: Picture = field(init=False)

    def __post_init__(self) -> None:
        """Cut the board out of the reference."""
        margin = 3 * WINDOW
        low, high = self.places.min(axis=0) - margin, self.places.max(axis=0) + margin
        patch, self._corner = self.reference.part((int(low[0]), int(low[1]), int(high[0]), int(high[1])))
        self._patch = grey(patch)

    @property
    def points(self) -> int:
        """Number of patches."""
        return len(self.places)

    def settle(self, track: Track) -> Track:
        """Leave out the patches that do not belong to what turns; return the track of the others."""
        belongs = rigid_group(track.points.astype(np.float64), MIN_FEATURES)
        self.places = self.places[belongs]
        return replace(track, points=track.points[:, belongs])

    def update(self, frame: Frame) -> Array | None:
        """Return the patches' centres [px], shape (N, 2), NaN where one is not found; None if most are not."""
        interval = 0.0 if self._time is None else frame.time - self._time
        middle = complex(*self.places.mean(axis=0))
        now = self._pose[0] * middle + self._pose[1]
        best: tuple[int, Complex, Array] | None = None
        for guess in TURN_GUESSES:
            turn = self._pose[0] * np.exp(1j * (self._rate[0] * interval + guess))
            pose = np.array([turn, now + self._velocity * interval - turn * middle])
            found = self._measure(frame, pose)
            if found is not None and (best is None or found[0] > best[0]):
                best = found
            if best is not None and (best[0] > 0.6 * len(self.places) or best[0] >= 0.8 * self._usual > 0):
                break
        if best is None or best[0] < max(MIN_FEATURES // 2, 0.3 * len(self.places)):
            self._rate[:], self._velocity = 0, 0j
            return None
        self._usual, pose, points = best
        if interval > 0:
            self._rate[0] = np.angle(pose[0] / self._pose[0]) / interval
            self._velocity = (pose[0] * middle + pose[1] - now) / interval
        self._pose, self._time = pose, frame.time
        return points

    def _measure(self, frame: Frame, pose: Complex) -> tuple[int, Complex, Array] | None:
        """Find the patches near an expected pose, again if they turn otherwise; return their number, pose and places."""
        good, seen = np.zeros(len(self.places), bool), np.zeros(len(self.places), complex)
        near = good
        for _ in range(2):
            matches = self._match(frame, pose)
            if matches is None or matches[0].sum() < MIN_FEATURES // 2:
                return None
            good, seen = matches
            home = self.places[:, 0] + 1j * self.places[:, 1]
            expected, (pose, near) = pose[0], _rigid(home, seen, good)
            if near.sum() < MIN_FEATURES // 2:
                return None
            if abs(np.angle(pose[0] / expected)) < AS_EXPECTED:
                break
        places = np.stack([np.real(seen), np.imag(seen)], axis=1)
        points = np.where(near[:, None], places, np.nan)
        return int(near.sum()), pose, points

    def _match(self, frame: Frame, pose: Complex) -> tuple[Mask, Complex] | None:
        """Turn the picture back by `pose` and measure where each patch is; in picture coordinates."""
        height, width = self._patch.shape
        a, b = pose
        corner = complex(*self._corner)
        # Reference patch pixel p is at a (p + corner) + b in the picture; cut that part out first.
        ends = a * (np.array([0, width, 1j * height, width + 1j * height]) + corner) + b
        box = (
            int(ends.real.min()) - 4,
            int(ends.imag.min()) - 4,
            int(ends.real.max()) + 5,
            int(ends.imag.max()) + 5,
        )
        part, shift = frame.part(box)
        if min(part.shape[:2]) < WINDOW:
            return None
        offset = a * corner + b - complex(*shift)
        move = np.array([[a.real, -a.imag, offset.real], [a.imag, a.real, offset.imag]])
        turned = cv2.warpAffine(
            grey(part), move, (width, height), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE
        )  # fmt: skip
        start = (self.places - np.array(self._corner)).astype(np.float32)[:, None]
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01)
        moved, status, error = cv2.calcOpticalFlowPyrLK(
            self._patch, turned, start, start.copy(), winSize=(WINDOW, WINDOW), maxLevel=2, criteria=criteria,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )  # fmt: skip
        found = moved[:, 0].astype(np.float64) + np.array(self._corner)
        good = (status.ravel() > 0) & (error.ravel() < 40)
        return good, a * (found[:, 0] + 1j * found[:, 1]) + b


def _rigid(home: Complex, seen: Complex, good: Mask) -> tuple[Complex, Mask]:
    """Similarity that most patches agree on (random pairs, then least squares), and who they are."""
    pose, best = np.array([1 + 0j, 0j]), np.zeros(len(home), bool)
    one, other = (np.stack([place[good].real, place[good].imag], axis=1) for place in (home, seen))
    estimate: Any = cv2.estimateAffinePartial2D  # its stubs do not know that it may find nothing
    found, agree = estimate(one, other, ransacReprojThreshold=2 * INLIER_DISTANCE)
    if found is None or not 0.8 < float(np.hypot(found[0, 0], found[1, 0])) < 1.25:
        return pose, best
    best[np.flatnonzero(good)[agree.ravel() > 0]] = True
    if best.sum() < 3:
        return pose, best
    (turn,), (shift,) = similarities(home, seen[None], best[None])
    # The body is deep and the camera near: patches may leave the common motion a little.
    distance = np.abs(seen - turn * home - shift)
    near = good & (distance < max(INLIER_DISTANCE, 3 * float(np.median(distance[best]))))
    return np.array([turn, shift]), near


def count_alike(places: Array) -> float:
    """How many patches share their errors, so that they count as one where the angle is concerned.

    Neighbours are measured in part on the same pixels, of films that are compressed in blocks; how far apart
    two still err alike was found in rendered films.

    Args:
        places: Centres of the patches [px], shape (N, 2).
    """
    apart = np.abs(places[:, None] - places[None])
    common = np.prod(np.maximum(1 - apart / CORRELATION_LENGTH, 0), axis=2)
    # The angle is a sum of the errors across each patch's arm, weighted by the arm.
    arm = places - places.mean(axis=0)
    return float(np.einsum("ia,ij,ja->", arm, common, arm) / np.sum(arm**2))


def _moves(frames: Sequence[Frame], place: Array) -> bool:
    """Whether a patch of the first of some grey frames is not where it was in a tenth of the others, or more."""
    half = WINDOW // 2
    x, y = np.round(place).astype(int)
    patch = frames[0].part((x - half, y - half, x + half + 1, y + half + 1))[0]
    likeness: list[float] = []
    for other in frames[1:]:
        u, v = np.round(place + other.shift - frames[0].shift).astype(int)
        around = other.part((u - half - 3, v - half - 3, u + half + 4, v + half + 4))[0]
        if min(around.shape) >= WINDOW:
            likeness.append(float(cv2.matchTemplate(around, patch, cv2.TM_CCOEFF_NORMED).max()))
    if not likeness:
        return False
    low, high = np.quantile(likeness, [0.1, 0.9])
    return bool(low < STATIC_LIKENESS * min(float(high), 1.0))


def _find(reel: Reel) -> Target | None:
    look = reel.look
    places = find_features(look)
    if len(places) < MIN_FEATURES:
        return None
    follower = FeatureFollower(look.frames[0], places, look.box)
    return Target(
        follower=follower,
        what="the deck's texture",
        why=f"{len(places)} patches of texture that move",
        settle=follower.settle,
        solve=_fit,
        zero=_rest_at_the_end,
        shows_level=False,
        zero_note="where the deck is at the end of the film (its last tenth): texture shows no horizontal",
    )


def _fit(view: View, matrix: Array, before: CameraState) -> AngleTrack:
    points = view.track.points
    most = points[int(np.argmax(np.isfinite(points).all(axis=2).sum(axis=1)))].astype(np.float64)
    alike = count_alike(most[np.isfinite(most).all(axis=1)])
    prior = BodyPrior(
        centre_std=CENTRE_STD, alike=alike, dead_zone=DEAD_ZONE, still=SAME_ERRORS, shows_lens=False
    )
    return fit_angle(view, matrix, before, prior)


def _rest_at_the_end(track: AngleTrack) -> float:
    return -rests_at(track.angle)


TRACKER = Tracker(
    rank=2,
    find=_find,
    not_found=f"fewer than {MIN_FEATURES} patches of texture move as one{{where}}. Film the deck larger or in more light",
)
