"""Trackers: each finds something in a film that can be followed, and says how its points make an angle."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sysid.roll import Array
from sysid.video.film.frames import Frame
from sysid.video.film.reel import Reel
from sysid.video.pose.angle import AngleTrack
from sysid.video.pose.camera_state import CameraState
from sysid.video.pose.view import View

Solve = Callable[[View, Array, CameraState], AngleTrack]
"""Points, camera matrix and prior knowledge of the camera to the angle."""

DIRECTION_STD, UNSEEN_DIRECTION_STD = np.radians([15.0, 5.0])
"""Standard deviation of the camera's direction [rad]: people stand about square; where nothing shows it, they are asked to."""
MIN_SWING = np.radians(1.0)
"""Least turn of a release [rad]."""
SAME_SCALE = 0.1
"""Difference of two angles of one body, at most, as a share of the swing [1]. A scale with a larger standard deviation is unknown."""
MIN_SEEN_SHARE = 0.6
"""Least share of the frames that must show a target."""
DEAD_ZONE = 0.15
"""Motion of the outermost points of colour or faint texture that compression drops, to either side [px], in films of 0.1 bit a pixel. A phone's have two to four times as many. Black on white shows more."""


class Follower(Protocol):
    """Follows points on the board from frame to frame."""

    @property
    def points(self) -> int:
        """Number of points N."""
        ...

    def update(self, frame: Frame) -> Array | None:
        """Return the points in this frame [px], shape (N, 2), NaN where one is not seen; None without any."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """Something in a film that can be followed, how its points make an angle, and the words for people."""

    follower: Follower
    what: str
    """Its name in messages."""
    why: str
    """Description for people."""
    solve: Solve
    zero: Callable[[AngleTrack], float]
    """Returns the shift that puts zero in its place [rad]."""
    zero_note: str
    kind: str = ""
    """Name shared by targets of which a film should show one only: two of them that swing apart are two bodies."""
    other: Callable[[], "Target | None"] | None = None
    """Returns a second target of this kind, once this one was followed."""
    shows_level: bool = True
    """Whether zero is a horizontal, rather than where the board rests or runs by chance."""
    direction_from: str = "how the points move"
    """The source of the camera's direction; empty without one."""
    warnings: tuple[str, ...] = ()
    shows_body: bool = True
    """Whether two or more of its points stay where they are on the board, so that they show how all of it moved."""
    shows_turn: bool = True
    """Whether its points are places on the board, so that all of it turns as far as they do; texture's are means over depths."""
    joined: tuple[tuple[int, int], ...] = ()
    """Points between which a line is drawn for people."""

    @property
    def direction_std(self) -> float:
        """Standard deviation of yaw and pitch before the film is looked at [rad]."""
        return float(DIRECTION_STD if self.direction_from else UNSEEN_DIRECTION_STD)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracker:
    """One way to follow a board."""

    rank: int
    """Trackers of lower rank come first."""
    find: Callable[[Reel], Target | None]
    not_found: str
    """Message where it finds nothing; `{where}` is the region that the user gave."""
    takes_pivot: bool = False
    """Whether it can use a pivot that the user gives."""
    last_resort: bool = False
    """Whether it takes long, and is tried only where nothing else gives a good angle."""


def rests_at(angle: Array) -> float:
    """Return the attitude in the last tenth of the frames that show one [rad]; angle of shape (n,)."""
    seen = angle[np.isfinite(angle)]
    return float(np.median(seen[-max(5, len(seen) // 10) :]))


def level_at_rest(track: AngleTrack) -> float:
    """Return what turns the angles so that the body is level at the end of the film [rad]."""
    return -rests_at(track.angle)


def level_angle(track: AngleTrack, direction: complex, symmetry: int) -> float:
    """Return what turns the angles so that a body of this symmetry, seen along `direction` at angle 0, starts level."""
    tilt = float(np.angle(direction))
    rest = float(np.nanmedian(track.angle)) + tilt
    step = 2 * np.pi / symmetry
    return tilt - step * round(rest / step)
