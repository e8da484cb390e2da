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
from sysid.video.types import Box, Complex, Picture

MAX_FEATURES, MIN_FEATURES = 40, 10
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
    box: Box
    _pose: Complex = field(default_factory=lambda: np.array([1 + 0j, 0j]))
    """The body's motion since the reference: it turns by pose[0], its middle is shifted by pose[1], in complex pixels."""
    _step: Complex = field(default_factory=lambda: np.zeros(2, np.complex128))
    """How far it turned in the last frame, as i times the angle [rad], and how far it was shifted [px]."""
    _usual: int = 0
    """Patches that were found last; if the expected turn shows about as many, no other is tried."""
    _patch: Picture = field(init=False)
    _corner: Array = field(init=False)

    def __post_init__(self) -> None:
        """Cut the board out of the reference."""
        low, high = self.places.min(axis=0) - 3 * WINDOW, self.places.max(axis=0) + 3 * WINDOW
        patch, corner = self.reference.part((int(low[0]), int(low[1]), int(high[0]), int(high[1])))
        self._patch, self._corner = grey(patch), np.array(corner)

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
        turn, shift = self._pose
        best, pose, points = 0, self._pose, self.places
        for guess in TURN_GUESSES:
            expected = turn * np.exp(self._step[0] + 1j * guess), shift + self._step[1]
            for _ in range(2):  # once more if it turns otherwise
                found = self._match(frame, *expected)
                if found is None:
                    break
                near = int(np.isfinite(found[1]).all(axis=1).sum())
                if near > best:
                    best, (pose, points) = near, found
                if abs(np.angle(found[0][0] / expected[0])) < AS_EXPECTED:
                    break
                expected = complex(found[0][0]), complex(found[0][1])
            if best > 0.6 * len(self.places) or best >= 0.8 * self._usual > 0:
                break
        if best < max(MIN_FEATURES // 2, 0.3 * len(self.places)):
            self._step[:] = 0
            return None
        self._step = np.array([1j * np.angle(pose[0] / turn), pose[1] - shift])
        self._usual, self._pose = best, pose
        return points

    def _match(self, frame: Frame, turn: complex, shift: complex) -> tuple[Complex, Array] | None:
        """Turn the picture back and measure where each patch is; return the pose on which most agree, and their places."""
        height, width = self._patch.shape
        middle = complex(*self.places.mean(axis=0))
        # From pixels of the reference's patch to those of the frame.
        offset = middle + shift + turn * (complex(*self._corner) - middle)
        ends = offset + turn * np.array([0, width, 1j * height, width + 1j * height])
        low, high = ends.real.min() + 1j * ends.imag.min(), ends.real.max() + 1j * ends.imag.max()
        part, corner = frame.part(
            (int(low.real) - 4, int(low.imag) - 4, int(high.real) + 5, int(high.imag) + 5)
        )
        if min(part.shape[:2]) < WINDOW:
            return None
        begin = offset - complex(*corner)
        move = np.array([[turn.real, -turn.imag, begin.real], [turn.imag, turn.real, begin.imag]])
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        turned = cv2.warpAffine(
            grey(part), move, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
        start = (self.places - self._corner).astype(np.float32)
        flow: Any = cv2.calcOpticalFlowPyrLK  # its stubs do not know the type of points
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01)
        there, status, error = flow(
            self._patch, turned, start, None, winSize=(WINDOW, WINDOW), criteria=criteria, maxLevel=2
        )
        good = (status.ravel() > 0) & (error.ravel() < 40)
        if good.sum() < MIN_FEATURES // 2:
            return None
        estimate: Any = cv2.estimateAffinePartial2D  # its stubs do not know that it may find nothing
        found, agree = estimate(start[good], there[good], ransacReprojThreshold=2 * INLIER_DISTANCE)
        if (
            found is None
            or not 0.8 < np.hypot(found[0, 0], found[1, 0]) < 1.25
            or agree.sum() < MIN_FEATURES // 2
        ):
            return None
        group = np.zeros(len(good), np.bool_)
        group[np.flatnonzero(good)[agree.ravel() > 0]] = True
        home = np.asarray(self.places @ np.array([1, 1j]), np.complex128)
        seen = offset + turn * (there.astype(np.float64) @ np.array([1, 1j]))
        (own,), (went,) = similarities(home, seen[None], group[None])
        # The body is deep and the camera near: patches may leave the common motion a little.
        off = np.abs(seen - own * home - went)
        near = good & (off < max(INLIER_DISTANCE, 3 * float(np.median(off[group]))))
        points = np.where(near[:, None], np.stack([seen.real, seen.imag], axis=1), np.nan)
        return np.array([own, went + (own - 1) * middle]), points


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
