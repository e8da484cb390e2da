"""What a tracker is: it finds something in a film that can be followed, and says how its points make an angle."""

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
"""Points, camera matrix and what is known of the camera beforehand to the angle."""

DIRECTION_STD = np.radians(15.0)
"""Standard deviation of the camera's direction before the film shows it: people stand about square [rad]."""
UNSEEN_DIRECTION_STD = np.radians(5.0)
"""Standard deviation of the camera's direction where nothing in the film shows it [rad]."""
MIN_SWING = np.radians(1.0)
"""What turns by less does not turn [rad]."""
DEAD_ZONE = 0.15
"""Motion of the outermost points of colour or faint texture that compression may leave out of a film, to either
side [px]: as found in films of 0.1 bit a pixel. A phone's have two to four times as many. Black on white shows more."""


class Follower(Protocol):
    """Follows points on the board from frame to frame."""

    @property
    def points(self) -> int:
        """Number of points N."""
        ...

    def update(self, frame: Frame) -> Array | None:
        """Return the points in this frame [px], shape (N, 2), NaN where one is not seen; None if none is."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """Something in a film that can be followed, how its points make an angle, and what to tell people."""

    follower: Follower
    what: str
    """What is followed, for messages."""
    why: str
    """What was found, for people."""
    solve: Solve
    zero: Callable[[AngleTrack], float]
    """What to add so that zero is where it should be [rad]."""
    zero_note: str
    shows_level: bool = True
    """Whether zero is a horizontal, rather than where the board rests or runs by chance."""
    direction_from: str = "how the points move"
    """What shows from where the camera looks; empty where nothing does."""
    warnings: tuple[str, ...] = ()
    shows_body: bool = True
    """Whether two or more of its points stay where they are on the board, so that they tell how all of it moved."""
    shows_turn: bool = True
    """Whether its points are places on the board, so that all of it turns as far as they do; texture's are means over depths."""
    joined: tuple[tuple[int, int], ...] = ()
    """Points between which a line is drawn, so that a person sees what they are."""

    @property
    def direction_std(self) -> float:
        """Standard deviation of yaw and pitch before the film is looked at [rad]."""
        return DIRECTION_STD if self.direction_from else UNSEEN_DIRECTION_STD


@dataclass(frozen=True, slots=True, kw_only=True)
class Tracker:
    """One way to follow a board."""

    rank: int
    """Where none is asked for, that of the lowest rank is tried first."""
    find: Callable[[Reel], Target | None]
    not_found: str
    """What to tell people where it finds nothing; `{where}` is the region that they gave."""
    takes_pivot: bool = False
    """Whether it can use a pivot that the user gives."""
    last_resort: bool = False
    """Whether it is tried only where nothing else is found: it takes long."""


def rests_at(angle: Array) -> float:
    """Return the attitude at the end of the film, in the last tenth of what is seen of it [rad]; angle of shape (n,)."""
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
