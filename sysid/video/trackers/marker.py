"""An ArUco or AprilTag marker on the deck's end: found once, then followed edge by edge."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import cv2
import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video.film.background import LIKENESS
from sysid.video.film.frames import Frame, box_about
from sysid.video.film.reel import Reel
from sysid.video.pose.angle import AngleTrack, fit_angle
from sysid.video.pose.prior import BodyPrior
from sysid.video.trackers._base import Target, Tracker, level_angle
from sysid.video.trackers._edge_profile import corners, find_steps
from sysid.video.types import Box, Picture

PRINTED = "ArUco 4x4"
"""What `husky-sysid marker` prints."""
DICTIONARIES = {
    PRINTED: cv2.aruco.DICT_4X4_50,
    "AprilTag 36h11": cv2.aruco.DICT_APRILTAG_36h11,
    "ArUco 5x5": cv2.aruco.DICT_5X5_250,
    "ArUco 6x6": cv2.aruco.DICT_6X6_250,
    "AprilTag 16h5": cv2.aruco.DICT_APRILTAG_16h5,
    "AprilTag 25h9": cv2.aruco.DICT_APRILTAG_25h9,
}
SEARCH_FRAMES = 5
"""Frames in which a marker is looked for: that is slow."""
MIN_SIDE = 24
"""Shortest side of a marker that is followed [px]."""
STEP_WINDOW = 2.8
"""Width of the window on an edge, over the width of its step [1]. Narrower windows show the pixels' grid: a long film is off by 0.040° at
1.4, 0.027° at 2.8."""
CORNER_DEAD_ZONE = 0.03
"""Motion that compression drops from black on white, to either side [px]: the error of corners in long films. Their scatter within a
frame is 0.015 px."""


@dataclass(frozen=True, slots=True)
class Marker:
    """A marker as found in one picture."""

    kind: str
    number: int
    corners: Array
    """Upper left, upper right, lower right, lower left of the marker [px], shape (4, 2)."""


def find_marker(frame: Frame, region: Box) -> Marker | None:
    """Return the largest marker of any known dictionary in a region of a frame [px], or None."""
    order = {kind: rank for rank, kind in enumerate(DICTIONARIES)}
    # A marker of one dictionary may look like a poor one of another: the first that has any.
    return min(
        _detect(frame, region, *DICTIONARIES),
        key=lambda marker: (order[marker.kind], -float(np.ptp(marker.corners, axis=0).max())),
        default=None,
    )


@dataclass(slots=True)
class MarkerFollower:
    """Follows one marker: its four edges from frame to frame, found anew where that fails."""

    marker: Marker
    points: int = 4
    """Its corners."""
    _cells: Picture = field(init=False)
    _corners: Array = field(init=False)
    _step: Array = field(default_factory=lambda: np.zeros((4, 2)))
    """How far the corners went from the last but one frame to the last one [px]."""
    _lost: int = 0

    def __post_init__(self) -> None:
        """Look up what the marker's cells should look like."""
        self._cells = marker_cells(self.marker.number, self.marker.kind)
        self._corners = self.marker.corners

    def update(self, frame: Frame) -> Array | None:
        """Return the corners in this frame [px], shape (4, 2), or None where the marker is not seen."""
        predicted = self._corners + self._step
        found = self._refine(frame, predicted)
        if found is None:
            margin = 0.8 * np.ptp(self._corners, axis=0).max() * (1 + self._lost)
            found = self._search(frame, box_about(np.concatenate([predicted, self._corners]), margin))
        if found is None:
            self._lost, self._step = self._lost + 1, np.zeros((4, 2))
            return None
        self._step = (found - self._corners) * (self._lost == 0)
        self._corners, self._lost = found, 0
        return found

    def _search(self, frame: Frame, box: Box) -> Array | None:
        seen = _detect(frame, box, self.marker.kind)
        same = (one.corners for one in seen if one.number == self.marker.number)
        return next((self._refine(frame, corners) for corners in same), None)

    def _refine(self, frame: Frame, rough: Array) -> Array | None:
        """Fit the four edges near `rough`; None where the picture does not show this marker there."""
        side = np.linalg.norm(np.roll(rough, -1, axis=0) - rough, axis=1)
        if side.min() < MIN_SIDE / 2 or side.max() > 3 * side.min():
            return None
        cell = side.mean() / len(self._cells)
        limits = np.reshape(frame.box, (2, 2))
        if np.any(rough < limits[0] + 2) or np.any(rough > limits[1] - 3):
            return None
        place = rough
        for reach in (min(0.75 * cell, 12.0), min(0.6 * cell, 5.0)):
            ends = np.stack([place, np.roll(place, -1, axis=0)], axis=1)
            edges = find_steps(frame, ends, reach, STEP_WINDOW)
            if np.isnan(edges).any(axis=2).mean(axis=1).max() > 0.5:
                return None
            place = corners([edge[np.isfinite(edge).all(axis=1)] for edge in edges])
            if not np.isfinite(place).all() or np.abs(place - rough).max() > 2 * cell:
                return None
        return place if self._likeness(frame, place) > LIKENESS else None

    def _likeness(self, frame: Frame, place: Array) -> float:
        """Correlation of the cells seen with the cells that the marker should have."""
        count = len(self._cells)
        unit = np.array([[0, 0], [count, 0], [count, count], [0, count]], np.float32) - np.float32(0.5)
        there = cv2.getPerspectiveTransform(unit, (place - frame.corner).astype(np.float32))
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(frame.picture, there, (count, count), flags=flags)  # the cells' middles
        return float(cv2.matchTemplate(seen, self._cells, cv2.TM_CCOEFF_NORMED)[0, 0])


def _detect(frame: Frame, box: Box, *kinds: str, mirrored: bool = False) -> list[Marker]:
    part, corner = frame.part(box)
    if min(part.shape[:2]) < MIN_SIDE:
        return []
    dark = np.asarray(cv2.flip(part, 1), np.uint8) if mirrored else part
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = 4 * MIN_SIDE / max(dark.shape)
    # Thresholding windows up to a marker's cell: blurred and small markers both.
    parameters.adaptiveThreshWinSizeMin, parameters.adaptiveThreshWinSizeMax = 5, 37
    parameters.adaptiveThreshWinSizeStep = 16
    dictionaries = [cv2.aruco.getPredefinedDictionary(DICTIONARIES[kind]) for kind in kinds]
    found: Any = cv2.aruco.ArucoDetector(dictionaries, parameters).detectMarkersMultiDict(dark)
    places, numbers, _, whose = found
    if numbers is None:  # the stubs say that there always are some
        return []
    every = np.reshape(places, (-1, 4, 2)).astype(np.float64) + corner
    return [
        Marker(kinds[kind], number, place)
        for kind, number, place in zip(np.ravel(whose), np.ravel(numbers).tolist(), every, strict=True)
    ]


def marker_cells(number: int, kind: str = PRINTED) -> Picture:
    """Return the cells of a marker, its black border included [grey levels, 0 or 255], shape (6, 6) or larger."""
    dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARIES[kind])
    return np.asarray(dictionary.generateImageMarker(number, dictionary.markerSize + 2), np.uint8)


def _find(reel: Reel) -> Target | None:
    look = reel.look
    # In the part that moves, at last anywhere: a board may hardly move.
    places = [(frame, look.box) for frame in look.frames[:: max(1, len(look.frames) // SEARCH_FRAMES)]]
    markers = (find_marker(*place) for place in [*places, (look.frames[0], look.frames[0].box)])
    marker = next((one for one in markers if one is not None), None)
    if marker is None or marker.kind != PRINTED:  # in a mirror, it may pass for another maker's
        _refuse_mirrored(reel, places)
    if marker is None:
        return None
    return Target(
        follower=MarkerFollower(marker),
        what=f"{marker.kind} marker {marker.number}",
        why=f"{marker.kind} marker {marker.number}",
        solve=partial(fit_angle, prior=BodyPrior(square=True, dead_zone=CORNER_DEAD_ZONE)),
        zero=_level_square,
        joined=((0, 1), (1, 2), (2, 3), (3, 0)),
        zero_note="where the marker's edges are level in the picture",
    )


def _refuse_mirrored(reel: Reel, places: Sequence[tuple[Frame, Box]]) -> None:
    """Refuse a film in most of whose frames a mirror would show one of the markers that `husky-sysid marker` prints."""
    seen = Counter(one.number for place in places for one in _detect(*place, PRINTED, mirrored=True))
    for number, count in seen.most_common(1):
        if 2 * count > len(places):
            raise SysidError(
                f"{reel.clip.path}: marker {number} is seen in a mirror: a selfie camera or an editor mirrored the film, and roll "
                "would have the wrong sign. Give the film as it was taken, or mirror it back (ffmpeg -i FILM -vf hflip NEW)."
            )


def _level_square(track: AngleTrack) -> float:
    upper_left = np.exp(1j * np.pi / 4 * np.array([-3, -1, 1, 3]))
    return level_angle(track, complex(np.vdot(upper_left, track.shape)), 4)


TRACKER = Tracker(
    rank=0,
    find=_find,
    not_found="no ArUco or AprilTag marker is seen{where}. Print a larger one with a white margin, film it sharp and "
    "large (50 px or more)",
)
