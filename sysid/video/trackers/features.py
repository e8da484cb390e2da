"""No mark at all: the deck's own texture, always compared with one and the same frame.

The picture is turned back by the expected motion. Patches then look as in the reference frame, and a small rest is measured. As the reference
never changes, nothing drifts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import Any

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.background import LIKENESS, PATCHES, SMALL_SIDE, WINDOW
from sysid.video.film.frames import Frame, box_about, halved
from sysid.video.film.reel import Reel
from sysid.video.film.shake import MIN_PATCHES
from sysid.video.film.survey import Survey
from sysid.video.pose.angle import fit_angle
from sysid.video.pose.prior import ATTITUDE_STEP, BODY_FLOOR, BodyPrior
from sysid.video.pose.rectify import pose_between, principal_corners, project, shifted, turn_of
from sysid.video.trackers._base import DEAD_ZONE, Target, Tracker, level_at_rest
from sysid.video.types import Mask, Picture

SAME_ERRORS = 3.0
"""Motion up to which patches of texture err alike [px]: as the deck turns they are seen at another slant."""
TEXTURE = BodyPrior(floor=BODY_FLOOR, dead_zone=DEAD_ZONE, still=SAME_ERRORS, any_side=True)
"""Prior knowledge of patches: they lie on any side of the deck."""


def find_features(look: Survey) -> Array:
    """Return corners in the first frame that belong to what moves [px], shape (m, 2)."""
    left, top, right, bottom = look.kept
    frames = look.frames[::2]
    part, corner = frames[0].part(look.kept)
    mask = 255 * look.moving[top:bottom, left:right].astype(np.uint8)
    edge = WINDOW // 2 + 3
    mask[:edge], mask[-edge:], mask[:, :edge], mask[:, -edge:] = 0, 0, 0, 0
    spacing = max(6.0, 0.5 * np.sqrt(max(int((mask > 0).sum()), 1) / PATCHES))
    corners: Any = cv2.goodFeaturesToTrack(
        cv2.GaussianBlur(part, (0, 0), 0.8), 4 * PATCHES, 0.01, spacing, mask=mask
    )
    if corners is None:
        return np.zeros((0, 2))
    places = np.asarray(corners, np.float64).reshape(-1, 2) + corner
    moving = (place for place in places if _moves(frames, place))
    return np.array([*islice(moving, PATCHES)]).reshape(-1, 2)


@dataclass(slots=True)
class FeatureFollower:
    """Follows patches of texture that move as one body; four points stand for it."""

    reference: Frame
    """The first frame."""
    places: Array
    """Centres of the patches in it [px], shape (m, 2)."""
    points: int = 4
    _agreed: Array = field(init=False)
    """Frames in which each patch took part in the common motion, shape (m,)."""
    _frames: int = 0
    _home: Array = field(init=False)
    """The four points in the reference, as wide apart as the patches are on average [px], shape (4, 2)."""
    _pose: Array = field(default_factory=lambda: np.eye(3))
    """Takes places in the reference to those in the last frame [px], shape (3, 3), as all poses."""
    _step: Array = field(default_factory=lambda: np.eye(3))
    """How it moved in the last frame."""
    _patch: Picture = field(init=False)
    _cut: Array = field(init=False)
    """Takes places in the patch [px], which is halved if it is large, to those in the reference."""

    def __post_init__(self) -> None:
        """Cut the board out of the reference."""
        patch, corner = self.reference.part(box_about(self.places, 2 * WINDOW))
        self._patch, times = halved(patch, SMALL_SIDE)
        self._cut = shifted(np.array(corner) + (times - 1) / 2) @ np.diag([times, times, 1.0])
        self._agreed = np.zeros(len(self.places))
        self._home = principal_corners(self.places, np.ones(len(self.places)))[0]

    def update(self, frame: Frame) -> Array | None:
        """Return the four points [px], shape (4, 2); None if most patches are not found."""
        expected, best, pose, agree = self._step @ self._pose, 0, self._pose, np.zeros(0, np.bool_)
        for _ in range(2):  # once more if it turns otherwise
            found, mask = self._match(frame, expected)
            if (near := int(mask.sum())) > best:
                best, pose, agree = near, found, mask
            if near == 0 or abs(turn_of(found) - turn_of(expected)) < ATTITUDE_STEP:
                break
            expected = found
        if best < max(MIN_PATCHES, 0.3 * len(self.places)):
            self._step = np.eye(3)
            return None
        step = pose_between(project(self._pose, self._home), project(pose, self._home))
        self._step = np.eye(3) if step is None else step
        self._pose = pose
        self._agreed[agree] += 1
        self._frames += 1
        return project(pose, self._home)

    def others(self) -> Array:
        """Return the patches that did not take part in most frames: those of another body [px], shape (k, 2)."""
        return self.places[self._agreed < 0.5 * self._frames]

    def _match(self, frame: Frame, expected: Array) -> tuple[Array, Mask]:
        """Turn the picture back and measure where each patch is; return the pose on which most agree, and which do, shape (m,)."""
        nothing = np.zeros(len(self.places), np.bool_)
        height, width = self._patch.shape
        begin = expected @ self._cut
        ends = project(begin, np.array([[0, 0], [width, 0], [0, height], [width, height]], float))
        part, corner = frame.part(box_about(ends, 4))
        if min(part.shape[:2]) < WINDOW:
            return expected, nothing
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        move = (shifted(-np.array(corner)) @ begin)[:2]
        back = cv2.warpAffine(part, move, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        start = project(np.asarray(np.linalg.inv(self._cut), np.float64), self.places).astype(np.float32)
        flow: Any = cv2.calcOpticalFlowPyrLK  # its stubs do not know the type of points
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 0.01)
        there, status, _ = flow(
            self._patch, back, start, None, winSize=(WINDOW, WINDOW), criteria=criteria, maxLevel=2
        )
        good = status.ravel() > 0
        if good.sum() < MIN_PATCHES:
            return expected, nothing
        estimate: Any = cv2.estimateAffine2D  # its stubs do not know that it may find nothing
        found, agree = estimate(self.places[good], project(begin, there[good].astype(np.float64)))
        if found is None or not 0.8 < np.sqrt(abs(np.linalg.det(found[:, :2]))) < 1.25:
            return expected, nothing
        nothing[np.flatnonzero(good)[agree.ravel() > 0]] = True
        return np.vstack([found, [0, 0, 1]]), nothing


def _moves(frames: Sequence[Frame], place: Array) -> bool:
    """Whether a patch of the first of some frames is not where it was in a tenth of the others, or more."""
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
    return bool(low < LIKENESS * min(float(high), 1.0))


def _find(reel: Reel) -> Target | None:
    return _target(reel.look, find_features(reel.look))


def _target(look: Survey, places: Array) -> Target | None:
    if len(places) < MIN_PATCHES:
        return None
    follower = FeatureFollower(look.frames[0], places)
    return Target(
        follower=follower,
        kind="texture",
        other=lambda: _target(look, follower.others()),
        what="the deck's texture",
        why=f"{len(places)} patches of texture that move",
        solve=partial(fit_angle, prior=TEXTURE),
        zero=level_at_rest,
        shows_level=False,
        shows_turn=False,
        zero_note="where the deck is at the end of the film (its last tenth): texture shows no horizontal",
    )


TRACKER = Tracker(
    rank=2,
    find=_find,
    not_found=f"fewer than {MIN_PATCHES} patches of texture move as one{{where}}. Film the deck larger or in more light",
)
