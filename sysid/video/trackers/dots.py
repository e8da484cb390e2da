"""Coloured stickers: two on the deck's end, or one dot that swings about a pivot.

They are found by colour as people see it, which changes little with shade. They are followed by colour as films hold it: two
numbers for a square of 2x2 pixels, both 128 for grey.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations

import cv2
import numpy as np

from sysid.roll import Array
from sysid.video.film.frames import Frame, box_about
from sysid.video.film.reel import Reel
from sysid.video.film.survey import MIN_AREA, Survey
from sysid.video.pose.angle import AngleTrack, fit_angle
from sysid.video.pose.camera_state import READOUT, CameraState, spread_by
from sysid.video.pose.keyframes import keyframes_of
from sysid.video.pose.prior import BODY_FLOOR, POINT_FLOOR, SAME_PICTURE, BodyPrior
from sysid.video.pose.rectify import project, rectify, smear, unwrap, upright
from sysid.video.pose.view import View
from sysid.video.trackers._base import (
    DEAD_ZONE,
    MIN_SEEN_SHARE,
    MIN_SWING,
    Target,
    Tracker,
    level_angle,
    level_at_rest,
)
from sysid.video.types import Complex, Image, Picture

MIN_CHROMA = 28.0
"""Distance from grey, in CIELAB units, from which a colour is taken as a sticker's."""
MAX_STRETCH = 0.03
"""Largest scatter of the distance of two dots [1]."""
MAX_ASIDE = np.radians(3.0)
"""How far from straight below, above or beside its pivot a single dot may rest and still show level by that [rad]."""
RIM = 2
"""Width of the rim about a dot in which squares hold some of it [squares]."""
MIN_UNCOVERED = 0.85
"""A dot of which less than this share is left is covered in part."""


@dataclass(frozen=True, slots=True)
class Dot:
    """One patch of colour."""

    place: Array
    """Centre [px], shape (2,)."""
    radius: float
    """Radius of the circle of the same area [px]."""
    chroma: Array
    """Its colour, in a film's units, shape (2,)."""
    worth: float
    """How much it stands out: radius times distance from grey."""

    def is_at(self, place: Array) -> bool:
        """Return whether it covers a place [px], shape (2,)."""
        return bool(np.linalg.norm(self.place - place) < self.radius)


def find_dots(look: Survey, besides: tuple[Dot, ...] = ()) -> tuple[Dot, ...]:
    """Return the two dots that turn as one, or the only two, or the one that stands out most, other than some; none without colour."""
    dots = [dot for dot in _patches(look) if not any(other.is_at(dot.place) for other in besides)]
    dots.sort(key=lambda dot: -dot.worth)
    pairs = [(a, b) if a.place[0] < b.place[0] else (b, a) for a, b in combinations(dots, 2) if _alike(a, b)]
    pairs = sorted(pairs, key=lambda pair: -pair[0].worth - pair[1].worth)
    turning = (pair for pair in pairs if _turn_as_one(pair, look))
    return next(turning, pairs[0] if pairs and len(dots) == 2 else tuple(dots[:1]))


def _alike(a: Dot, b: Dot) -> bool:
    """Return whether two dots may be stickers of one deck: as large and well apart."""
    apart = np.linalg.norm(a.place - b.place) > 4 * max(a.radius, b.radius)
    return bool(0.65 < a.radius / b.radius < 1.55 and apart)


def _turn_as_one(pair: tuple[Dot, Dot], look: Survey) -> bool:
    """Whether two dots keep their distance in most frames, and turn."""
    follower = DotFollower(pair)
    seen = np.array([points for frame in look.frames if (points := follower.update(frame)) is not None])
    if len(seen) < MIN_SEEN_SHARE * len(look.frames):
        return False
    arm = (seen[:, 1] - seen[:, 0]) @ np.array([1, 1j])
    return bool(
        np.std(np.abs(arm)) < MAX_STRETCH * np.mean(np.abs(arm))
        and np.ptp(np.unwrap(np.angle(arm))) > MIN_SWING
    )


@dataclass(slots=True)
class DotFollower:
    """Follows dots by their colour; the centre of each is a mean weighted by how much dot a pixel holds."""

    dots: tuple[Dot, ...]
    _places: Array = field(init=False)
    _step: Array = field(init=False)
    """How far they went from the last but one frame to the last one [px]."""
    _lost: int = 0
    _size: Array = field(init=False)
    """How much dot there is of each, in pixels; NaN before it was seen."""

    def __post_init__(self) -> None:
        """Start where the dots were found."""
        self._size = np.full(len(self.dots), np.nan)
        self._places = np.array([dot.place for dot in self.dots])
        self._step = np.zeros_like(self._places)

    @property
    def points(self) -> int:
        """One or two."""
        return len(self.dots)

    def update(self, frame: Frame) -> Array | None:
        """Return the dots' centres [px], shape (N, 2); None unless all are seen."""
        # A moving dot is expected further on; a lost one is searched at its last place.
        ahead = self._step * (1 + self._lost) * (self._lost < 2)
        apart = float(np.linalg.norm(np.ptp(self._places, axis=0))) or np.inf
        reach = np.array([(3.0 + 2.0 * min(self._lost, 5)) * dot.radius for dot in self.dots])
        reach = np.minimum(reach + 0.5 * np.linalg.norm(ahead, axis=1), 0.6 * apart).tolist()
        found = [
            self._near(frame, *each) for each in zip(self._places + ahead, reach, self.dots, strict=True)
        ]
        places, sizes = np.array([place for place, _ in found]), np.array([size for _, size in found])
        length, usual = (
            np.linalg.norm(np.ptp(both, axis=0)) for both in (places, [dot.place for dot in self.dots])
        )
        # A hand before a part of a dot moves the middle of the rest; blur only spreads it.
        covered = np.isnan(sizes).any() or np.any(sizes < MIN_UNCOVERED * self._size)
        if covered or not 0.75 * usual <= length <= 1.35 * usual:
            self._lost += 1
            return None
        self._step = (places - self._places) * (self._lost == 0)
        self._places, self._lost = places, 0
        self._size = np.where(np.isfinite(self._size), 0.9 * self._size + 0.1 * sizes, sizes)
        return places

    def _near(self, frame: Frame, place: Array, reach: float, dot: Dot) -> tuple[Array, float]:
        """Find a dot; return its centre [px] and how much of it there is [px]; NaN where it is not seen."""
        nothing = np.full(2, np.nan), np.nan
        part = frame.cut(box_about(place[None], reach))
        if min(part.picture.shape) < 4:
            return nothing
        weight = _dot_share(np.dstack(part.chroma), dot)
        count, labels, stats, centres = cv2.connectedComponentsWithStats((weight > 0.5).astype(np.uint8))
        if count < 2:
            return nothing
        area = 4 * stats[1:, cv2.CC_STAT_AREA] / (np.pi * dot.radius**2)
        distance = np.linalg.norm(_in_film(np.asarray(centres[1:], np.float64), part) - place, axis=1)
        score = distance / reach + np.abs(np.log(np.maximum(area, 1e-3)))
        best = int(np.argmin(score))
        if not 0.4 < area[best] < 2.5:
            return nothing
        rim = np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8)
        soft = weight * cv2.dilate((labels == best + 1).astype(np.uint8), rim)
        if soft[[0, -1]].any() or soft[:, [0, -1]].any():
            return nothing  # it is cut, by the picture's border or that of the search
        sums = cv2.moments(soft)
        middle = np.array([sums["m10"], sums["m01"]]) / sums["m00"]
        return _in_film(middle, part), 4 * sums["m00"]


def fit_pivot(
    view: View, matrix: Array, before: CameraState, *, pivot: tuple[float, float] | None = None
) -> AngleTrack:
    """Return the angle [rad] of one dot about a pivot: given [px], or the centre of the circle that the dot runs on.

    One dot shows neither direction of the axis nor read-out: they stay as they are known beforehand. The camera matrix [px] has
    shape (3, 3).
    """
    flat, dot = upright(matrix, before.value), view.points[:, 0]
    covariance = np.zeros((6, 6))
    covariance[:4, :4] = before.covariance
    if pivot is not None:
        about = np.array(pivot, np.float64)
    else:
        some = keyframes_of(view, SAME_PICTURE)
        there = project(flat, dot[some.rows])
        centre, covariance[4:, 4:] = _centre(there[:, 0] + 1j * there[:, 1], some.share)
        about = project(np.asarray(np.linalg.inv(flat), np.float64), centre[None])[0]

    def arm(x: Array) -> Complex:
        """From the pivot to the dot as a camera along the axis sees them, shape (n,), by camera and pivot, shape (6,)."""
        seen = rectify(dot + x[READOUT] * view.shear[:, 0], matrix, x[:4])
        return seen - rectify(x[None, 4:], matrix, x[:4])

    x = np.concatenate([before.value, about])
    angle, radius = np.angle(arm(x)), np.abs(arm(x))
    noise = float(np.nanstd(radius)) + POINT_FLOOR
    own = (noise / np.nanmean(radius)) ** 2 + smear(angle) ** 2 + 0 * angle
    time = view.time(before.readout)
    common = spread_by(x, covariance, angle, lambda x: np.angle(arm(x)), time, view.share, READOUT)
    std = np.sqrt(own + common)
    return AngleTrack(unwrap(angle), std, before, noise, 0, np.array([1 + 0j]), np.sqrt(own))


def _centre(z: Complex, share: Array) -> tuple[Array, Array]:
    """Centre of the circle that points [px] run on, shape (2,), and its covariance: least squares of the distances.

    As Gander, Golub and Strebel (1994), with a loss that ignores outliers. Frames of one still picture err alike: `share`,
    shape (m,), is one over their number.
    """
    from scipy.optimize import least_squares

    weight = np.sqrt(share)
    design = weight[:, None] * np.stack([z.real, z.imag, np.ones(len(z))], axis=1)
    guess, *_ = np.linalg.lstsq(design, -weight * np.abs(z) ** 2, rcond=None)
    x, y = -guess[:2] / 2
    start = [x, y, np.sqrt(max(x**2 + y**2 - guess[2], 1.0))]

    def distance(circle: Array) -> Array:
        return weight * (np.abs(z - complex(circle[0], circle[1])) - circle[2])

    usual = 1.4826 * float(np.median(np.abs(distance(np.array(start))))) + POINT_FLOOR
    fit = least_squares(distance, start, loss="soft_l1", f_scale=3 * usual, x_scale="jac")
    variance = np.sum(distance(fit.x) ** 2) / max(float(share.sum()) - 3, 1.0)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)[:2, :2] * variance
    return fit.x[:2], covariance


def _in_film(places: Array, part: Frame) -> Array:
    """Return where in the film squares of a part of a frame are [px], shape (..., 2)."""
    return 2 * places + 0.5 + part.corner


def _dot_share(colour: Picture, dot: Dot) -> Image:
    """How much of each square is dot, from 0 to 1: colours, shape (h, w, 2), mix linearly where a dot's rim is blurred.

    The surroundings' colour is the part's median; what lies off the line between both colours is
    something else.
    """
    around = np.median(colour[::2, ::2], axis=(0, 1))
    line = dot.chroma - around
    length = float(line @ line)
    if length < 100:
        return np.zeros(colour.shape[:2], np.float32)
    # Along the line, and off it, in units of its length.
    turn = np.array([[line[0], line[1]], [-line[1], line[0]]]) / length
    shift = turn @ around
    along, off = cv2.split(cv2.transform(colour.astype(np.float32), np.column_stack([turn, -shift])))
    return np.where((np.abs(off) < 0.45) & (along > 0.15), np.minimum(along, 1.0), np.float32(0))


def _patches(look: Survey) -> list[Dot]:
    """Return the patches that stand out from most of a picture by their colour, as round as stickers, where something moves."""
    part = look.frames[0].cut(look.box)
    # In whole units: a hundredth of a sticker's colour.
    smooth = cv2.cvtColor(cv2.GaussianBlur(part.colour, (0, 0), 1.0), cv2.COLOR_BGR2LAB)
    chroma = smooth[..., 1:].astype(np.float32)
    strength = np.linalg.norm(chroma - np.median(chroma.reshape(-1, 2), axis=0), axis=-1)
    strong = strength[strength > MIN_CHROMA]
    if len(strong) < MIN_AREA:
        return []
    colour = np.dstack(part.chroma)
    dots: list[Dot] = []
    # First by the strongest colour, so that a wooden deck is no dot where a sticker shines; then paler ones.
    for level in (max(MIN_CHROMA, 0.6 * float(np.sort(strong)[-MIN_AREA])), MIN_CHROMA):
        mask = cv2.morphologyEx(
            (strength > level).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
        )
        _, labels, stats, centres = cv2.connectedComponentsWithStats(mask)
        for label, (_, _, width, height, area) in enumerate(stats.tolist()):
            # A disc fills 0.79 of its box.
            if label == 0 or area < max(MIN_AREA, 0.55 * width * height) or not 0.5 < width / height < 2:
                continue
            place = centres[label] + part.corner
            x, y = np.round(place).astype(int)
            if look.moving[y, x] and not any(dot.is_at(place) for dot in dots):
                own, radius = (
                    np.median(colour[labels[::2, ::2] == label], axis=0),
                    float(np.sqrt(area / np.pi)),
                )
                dots.append(Dot(place, radius, own, radius * float(strength[labels == label].mean())))
    return dots


def _find(reel: Reel) -> Target | None:
    dots = find_dots(reel.look)
    if reel.options.pivot is not None:  # a single dot turns about it
        dots = dots[:1]
    return _target(reel, dots, lambda: _other_pair(reel, dots)) if dots else None


def _target(reel: Reel, dots: tuple[Dot, ...], other: Callable[[], Target | None] | None) -> Target:
    options = reel.options
    follower = DotFollower(dots)
    size = ", ".join(f"{2 * dot.radius:.0f} px wide at {dot.place[0]:.0f},{dot.place[1]:.0f}" for dot in dots)
    if len(dots) == 2:
        pair = Target(
            follower=follower,
            kind="pair of dots",
            other=other,
            what="the pair of dots",
            why=f"two coloured dots ({size})",
            # Films hold colour at half the resolution of brightness.
            solve=partial(fit_angle, prior=BodyPrior(floor=2 * BODY_FLOOR, dead_zone=DEAD_ZONE)),
            zero=lambda track: level_angle(track, complex(track.shape[1] - track.shape[0]), 2),
            joined=((0, 1),),
            zero_note="where the line between the dots is level in the picture",
        )
        if not _among_others(reel.look, dots):
            return pair
        return replace(
            pair,
            what="the pair of patches of colour",
            why=f"two patches of colour ({size})",
            zero=level_at_rest,
            shows_level=False,
            zero_note="where the deck is at the end of the film: a print shows no level",
        )
    return Target(
        follower=follower,
        what="the dot",
        why=f"one coloured dot ({size}) about a {'fitted' if options.pivot is None else 'given'} pivot",
        solve=partial(fit_pivot, pivot=options.pivot),
        zero=_level_arm,
        zero_note=f"straight below, above or beside the pivot, if the dot rests within {np.degrees(MAX_ASIDE):.0f}° of that; "
        "else its place at the end of the film",
        shows_level=False,
        shows_body=False,
        direction_from="",
    )


def _among_others(look: Survey, dots: tuple[Dot, ...]) -> bool:
    """Return whether a third patch turns with two dots: they are specks of a print, not two stickers."""
    some = (dot for dot in _patches(look) if not any(other.is_at(dot.place) for other in dots))
    return any(_turn_as_one((dots[0], dot), look) for dot in some)


def _other_pair(reel: Reel, dots: tuple[Dot, ...]) -> Target | None:
    """Return a second pair that turns as one, if there is one."""
    other = find_dots(reel.look, dots)
    return _target(reel, other, None) if len(other) == 2 and _turn_as_one(other, reel.look) else None


def _level_arm(track: AngleTrack) -> float:
    zero = level_angle(track, 1 + 0j, 4)
    return zero if abs(np.nanmedian(track.angle) + zero) < MAX_ASIDE else level_at_rest(track)


TRACKER = Tracker(
    rank=1,
    find=_find,
    not_found="no coloured dot that moves is seen{where}. Use stickers of a colour of their own",
    takes_pivot=True,
)
