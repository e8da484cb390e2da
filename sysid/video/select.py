"""The one decision which tracker: of all that is found, the one that gives the angle best, with level from one that shows it."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video import trackers
from sysid.video.film.frames import MAX_MISSING_SHARE, Frame, ahead
from sysid.video.film.reel import Reel
from sysid.video.film.track import Track
from sysid.video.pose.angle import AngleTrack, fit_angle
from sysid.video.pose.camera_state import CameraState, before_looking
from sysid.video.pose.prior import BODY_FLOOR, BodyPrior
from sysid.video.pose.rectify import upright
from sysid.video.pose.view import View
from sysid.video.registration import BodyPicture, picture_of_body
from sysid.video.trackers._base import (
    DEAD_ZONE,
    MIN_SEEN_SHARE,
    MIN_SWING,
    SAME_SCALE,
    Follower,
    Target,
    level_at_rest,
    rests_at,
)
from sysid.video.types import Points

ADVICE = (
    "Keep the board in the picture. Film all of its swing straight from behind, in more light (less blur). Or choose another "
    "target (--method, --roi, docs/video.md)."
)
VAGUE, MAX_STD = np.radians([0.3, 3.0])
"""Standard deviation above which a last resort is tried as well, and above which an angle is refused [rad]."""
MAX_STRAY = 0.3
"""Distance from a circle about a fixed pivot, as a share of its own motion, above which a point is carried along [1]. A truck that gives way reaches 0.1."""
MAX_BENT = 0.007
"""Misfit of a rigid body at rest, as a share of its size, beyond compression (`BODY_FLOOR`) [1]. It is up to 0.005 in films of
many kinds; bodies at several depths, with angles off by 2 to 20 %, are beyond."""
MAX_ASKEW = np.radians(20.0)
"""Attitude at rest beyond which a target does not show level [rad]: prints do not, stickers are put on level."""


@dataclass(frozen=True, slots=True)
class Followed:
    """A target with the angle that it gives."""

    target: Target
    track: Track
    before: CameraState
    """Prior knowledge of the camera."""
    found: AngleTrack
    laid: tuple[BodyPicture, list[Points]] | None = None
    """The body that turns with it, and its corners in each frame in memory; None where that was not looked for."""

    @property
    def std(self) -> float:
        """Typical standard deviation of the angle [rad]: noise, misfit and unknown camera."""
        return float(np.nanmedian(self.found.std))

    @property
    def turns(self) -> bool:
        """Whether it turns at all: a marker on the wall does not."""
        return float(np.ptp(self.found.angle[np.isfinite(self.found.angle)])) > max(6 * self.std, MIN_SWING)

    @property
    def swing(self) -> float:
        """Largest angle from the median [rad]."""
        return float(np.nanmax(np.abs(self.found.angle - np.nanmedian(self.found.angle))))

    @property
    def level(self) -> Array:
        """The angle with zero where this target has it [rad], shape (n,)."""
        return self.found.angle + self.target.zero(self.found)

    @property
    def region(self) -> str:
        """The part of the picture that its points pass through, as `--roi` takes it [px]."""
        places = self.track.points[np.isfinite(self.track.points).all(axis=2)]
        margin = np.ptp(places, axis=0).max() / 4
        low = np.maximum(places.min(axis=0) - margin, 0)
        return " ".join(f"{number:.0f}" for number in (*low, *(places.max(axis=0) + margin - low)))


def follow_board(reel: Reel) -> Followed:
    """Follow the target that gives the angle best; level is where the first one that shows it has it.

    All targets are followed in the frames that are in memory, the best one in the rest of the film.

    Raises:
        SysidError: No target gives an angle, or two bodies swing.
    """
    usable: list[Followed] = []
    failed: list[str] = []
    missed: list[str] = []  # somebody may have put these there to be followed
    for targets in find_targets(reel):
        with ThreadPoolExecutor() as pool:
            several = list(pool.map(partial(_followed_in_memory, reel), targets))
        seconds = [one.target.other() for one in several if isinstance(one, Followed) and one.target.other]
        targets += (others := [other for other in seconds if other is not None])
        several += [_followed_in_memory(reel, other) for other in others]
        for one, target in zip(several, targets, strict=True):
            if isinstance(one, Followed):
                usable.append(one)
            else:
                failed.append(one)
                missed += [one] if target.shows_level else []
        if min((one.std for one in usable if one.turns), default=np.inf) < VAGUE:
            break
    if not usable:
        raise SysidError(f"{reel.clip.path}: {'; '.join(failed)}. {ADVICE}")
    if turning := [one for one in usable if one.turns]:
        missed += [f"{one.target.what} does not turn" for one in usable if not one.turns]
    best = _best(reel, turning or usable)
    why = "; ".join([best.target.why, *missed])
    return _to_the_end(reel, replace(best, target=replace(best.target, why=why)))


def _followed_in_memory(reel: Reel, target: Target) -> Followed | str:
    """Return a target with its angle in the frames in memory; or why it has none."""
    follower, lost = target.follower, 0
    points = np.full((len(reel.kept), follower.points, 2), np.nan, np.float32)
    for row, frame in enumerate(reel.kept):
        points[row] = _seen(follower, frame)
        lost += bool(np.isnan(points[row]).all())
        if lost > (1 - MIN_SEEN_SHARE) * len(reel.kept):  # too few frames can show it
            break
    one = _followed(reel, target, _track_of(reel, [(frame.index, frame.time) for frame in reel.kept], points))
    if isinstance(one, str) or target.shows_level or not target.shows_body or not one.turns:
        return one
    # Patches of anything agree on some motion: those of a rigid body only if pictures turned back by it agree.
    laid = _lay_body(reel, one)
    if laid is None or _whole_body(reel, one, laid[1]) is None:
        return f"{target.what} is not of the board: pictures turned back by it differ"
    size = float(np.abs(one.found.shape - one.found.shape.mean()).mean())
    if (bent := np.sqrt(max(one.found.noise**2 - BODY_FLOOR**2, 0.0)) / size) > MAX_BENT:
        return (
            f"{target.what} lies at several depths or bends: by {100 * bent:.1f} % of its size when it rests"
        )
    return replace(one, laid=laid)


def _to_the_end(reel: Reel, led: Followed) -> Followed:
    """Follow a target through the rest of the film, and everything that turns as it does."""
    target, points = led.target, list(led.track.points)
    stamps = [(frame.index, frame.time) for frame in reel.kept]
    body, corners = led.laid or (_lay_body(reel, led) if target.shows_body else None) or (None, [])
    whole = _whole_body(reel, led, corners) if corners else None
    last = next((seen for seen in reversed(corners) if np.isfinite(seen).all()), None)
    rest = ((frame, _seen(target.follower, frame)) for frame in reel.others())
    with closing(ahead(rest, 1)) as others:
        for frame, seen in others:
            stamps.append((frame.index, frame.time))
            points.append(seen)
            if body is not None and whole is not None:
                corners.append(body.seen(frame, seen, last))
                last = corners[-1] if np.isfinite(corners[-1]).all() else last
    if len(points) > len(led.track.points):
        whole_film = _followed(reel, target, _track_of(reel, stamps, np.array(points)))
        if isinstance(whole_film, str):
            raise SysidError(f"{reel.clip.path}: {whole_film}. {ADVICE}")
        led = whole_film
        whole = None if whole is None else _whole_body(reel, led, corners)
    return whole or led


def _seen(follower: Follower, frame: Frame) -> Points:
    """Return the points in the next frame [px], shape (N, 2); NaN where not seen."""
    found = follower.update(frame)
    return np.full((follower.points, 2), np.nan, np.float32) if found is None else found.astype(np.float32)


def _track_of(reel: Reel, frames: Sequence[tuple[int, float]], points: Points) -> Track:
    """Return points (n, N, 2) [px] in frames of these numbers and times [s], with the camera's shake.

    Raises:
        SysidError: There are fewer than 8 frames, or their stamps are garbled.
    """
    if len(frames) < 8:
        raise SysidError(
            f"{reel.clip.path}: {len(frames)} frames are too few for a decay. Film at least a second."
        )
    if reel.repeated > MAX_MISSING_SHARE * len(frames):
        raise SysidError(
            f"{reel.clip.path}: {reel.repeated} frames carry no later time stamp than the one before: its times are not those of "
            "the board. Give the film as the camera wrote it, or its frame rate with --rate."
        )
    shake = reel.background.shake(reel.skipped, len(frames))
    index, time = (np.array(each) for each in zip(*frames, strict=True))
    return Track(time, points, shake, index, reel.repeated)


def _lay_body(reel: Reel, led: Followed) -> tuple[BodyPicture, list[Points]] | None:
    """Return everything that turns with a target, and its corners in each frame in memory; None where nothing does."""
    flat = upright(reel.lens.matrix, led.found.camera_state.value)
    body = picture_of_body(reel.kept, reel.look.box, led.track, flat)
    if body is None:
        return None
    with ThreadPoolExecutor() as pool:
        return body, list(pool.map(body.seen, reel.kept, led.track.points))


def _best(reel: Reel, usable: list[Followed]) -> Followed:
    """Return the target with the smallest uncertainty of those that agree with the first one that shows level."""
    if len(usable) == 1:
        return usable[0]
    first = next((one for one in usable if one.target.shows_level), min(usable, key=lambda one: one.std))
    best = min((one for one in usable if _same_swing(one, first)), key=lambda one: one.std)
    # A target too uncertain to agree contradicts nothing.
    stray = [one for one in usable if one.std < SAME_SCALE * first.swing and not _same_swing(one, first)]
    for one in stray:
        if one.target.kind == first.target.kind:
            raise SysidError(
                f"{reel.clip.path}: two bodies swing, each with {first.target.what}. Give the region of the one that is to "
                f"be measured: --roi {first.region} or --roi {one.region}."
            )
    others = ", ".join(
        f"{one.target.what} ±{2 * np.degrees(one.std):.2g}°" for one in usable if one is not best
    )
    target = replace(
        best.target, why=f"{best.target.why}: ±{2 * np.degrees(best.std):.2g}° in this film ({others})"
    )
    if stray:
        names = " and ".join(one.target.what for one in stray)
        words = f"{names} moves otherwise than {first.target.what} and is not used; --roi keeps to the board"
        target = replace(target, warnings=(*target.warnings, words))
    if first is not best and first.target.shows_level:
        zero = partial(_level_of, first.level)
        target = replace(target, zero=zero, zero_note=first.target.zero_note, shows_level=True)
    return replace(best, target=target)


def _followed(reel: Reel, target: Target, track: Track) -> Followed | str:
    """Return a target with its angle; or why its points give none."""
    seen, frames = len(track.time) - track.lost, len(track.time)
    if seen < MIN_SEEN_SHARE * frames:
        return f"{target.what} is seen in only {seen} of {frames} frames"
    lens, options = reel.lens, reel.options
    readout = reel.clip.readout if options.readout is None else options.readout
    before = before_looking(track, lens, target.direction_std, readout, options.camera_angle)
    try:
        found = target.solve(View.of(track, lens.straighten, reel.clip.row_share), lens.matrix, before)
    except np.linalg.LinAlgError:
        return f"{target.what} shows too few different attitudes for an angle"
    one = Followed(target, track, before, found)
    if (fault := _fault(one)) is not None:
        return fault
    if not target.shows_level or not abs(askew := rests_at(one.level)) > MAX_ASKEW:
        return one
    note = f"where the deck is at the end of the film: {target.what} is {abs(np.degrees(askew)):.0f}° off level there"
    return replace(one, target=replace(target, shows_level=False, zero=level_at_rest, zero_note=note))


def _fault(one: Followed) -> str | None:
    """Return why an angle is to be refused; None if it is not."""
    frames, what = len(one.found.angle), one.target.what
    # An edge that is lost in the swing, and found again at rest, was another line.
    edge = not one.target.shows_body and one.track.points.shape[1] > 1
    least = (1 + MIN_SEEN_SHARE) / 2 if edge else MIN_SEEN_SHARE
    if (kept := int(np.isfinite(one.found.angle).sum())) < least * frames:
        return (
            f"{what} is seen in {frames - one.track.lost} of {frames} frames, but turns as one body in only {kept}: something "
            "else was followed in the others"
        )
    if one.target.shows_body and _strays(one.track, one.found.angle):
        return f"{what} moves along rather than turns about a point: a foot, a hand, or a camera that moves"
    # A single dot on a short arc leaves the scale open, which is no reason to refuse its period.
    std = one.std if one.target.shows_body else float(np.nanmedian(one.found.own))
    if std > MAX_STD:
        return f"{what} tells the angle to ±{2 * np.degrees(std):.2g}° only"
    # A marker or stickers on a board may stand still; patches and lines may be of anything.
    placed = one.target.shows_body and one.target.shows_turn
    return None if placed or one.turns else f"{what} does not turn: it is behind the board"


def _strays(track: Track, angle: Array) -> bool:
    """Return whether the point that is seen most leaves the circle about any fixed pivot, as it turns by an angle (n,) [rad]."""
    points = track.shake.undo(track.points.astype(np.float64)) @ [1, 1j]
    path = points[:, int(np.argmax(np.isfinite(points).sum(axis=0)))]
    seen = np.isfinite(path) & np.isfinite(angle)
    path, circle = path[seen], np.stack([np.ones(seen.sum()), np.exp(1j * angle[seen])], axis=1)
    off = path - circle @ np.linalg.lstsq(circle, path, rcond=None)[0]
    middle = np.median(path.real) + 1j * np.median(path.imag)
    stray, moved = np.quantile(np.abs([off, path - middle]), 0.8, axis=1)
    # A hundredth of the picture's width is the play of trucks.
    return bool(stray > max(MAX_STRAY * moved, track.shake.matrix[0, 2] / 50))


def _whole_body(reel: Reel, led: Followed, corners: list[Points]) -> Followed | None:
    """Return the angle of everything that turns with a target, if that agrees with the target."""
    body = replace(
        led.target,
        what=f"the body of {led.target.what}",
        why=f"{led.target.why}; the angle is that of everything that turns with it",
        solve=partial(_solve_whole, led),
        zero=lambda _: 0.0,
        joined=((0, 1), (1, 2), (2, 3), (3, 0)),
    )
    own = _followed(reel, body, replace(led.track, points=np.array(corners)))
    return None if isinstance(own, str) or not _same_swing(own, led) else own


def _solve_whole(led: Followed, view: View, matrix: Array, before: CameraState) -> AngleTrack:
    """Return the angle of the whole body, with zero where the target that led to it has it.

    Places on the board (marker, dots) decide the camera direction and the total turn: pixels at several depths seem to turn up to
    2 % further. The whole body replaces patches of texture, which err more.
    """
    points, prior = led.found, BodyPrior(floor=BODY_FLOOR, dead_zone=DEAD_ZONE)
    if led.target.shows_turn:
        camera = replace(points.camera_state, covariance=np.zeros((4, 4)))
        found = fit_angle(view, matrix, camera, prior)
        apart = np.abs(found.angle - points.angle - np.nanmedian(found.angle - points.angle))
        both = apart < SAME_SCALE * led.swing
        trust = 1 / points.own[both]
        gain = (
            float(np.polyfit(found.angle[both], points.angle[both], 1, w=trust)[0]) if both.sum() > 2 else 1.0
        )
        common = np.sqrt(np.maximum(points.std**2 - points.own**2, 0))
        common = np.where(np.isfinite(common), common, np.nanmax(common))
        # Their own doubt of the scale contradicts nothing: Stein's shrinkage.
        apart, doubt = np.log(gain) ** 2, (np.max(common) / led.swing) ** 2
        angle = gain ** (apart / (apart + doubt + 1e-12)) * found.angle
        found = replace(found, angle=angle, std=np.hypot(found.own, common), camera_state=points.camera_state)
    else:
        found = fit_angle(view, matrix, before, replace(prior, any_side=True))
    # A hand may hide the body and leave the points.
    whole = np.isfinite(found.angle)
    return replace(
        found,
        angle=np.where(whole, found.angle + _level_of(led.level, found), led.level),
        std=np.where(whole, found.std, points.std),
        own=np.where(whole, found.own, points.own),
    )


def _same_swing(one: Followed, other: Followed) -> bool:
    """Return whether two angles are one but for a constant."""
    apart = one.found.angle - other.found.angle
    apart = np.abs(apart - np.nanmedian(apart))
    return bool(np.nanquantile(apart, 0.9) < SAME_SCALE * other.swing)


def _level_of(level: Array, found: AngleTrack) -> float:
    """Return what to add to an angle so that its zero is another one's, in the frames of both [rad]."""
    return float(np.nanmedian(level - found.angle[: len(level)]))


def find_targets(reel: Reel) -> Iterator[list[Target]]:
    """Yield what can be followed: by the tracker that the user names, else by all; last resorts come last.

    Raises:
        SysidError: The tracker is unknown, or nothing that can be followed is found.
    """
    path, options, found = reel.clip.path, reel.options, False
    known = {name: one for name, one in trackers.ranked().items() if options.pivot is None or one.takes_pivot}
    if options.method not in ("auto", *known):
        pivot = "" if options.pivot is None else f" --pivot {options.pivot[0]:g} {options.pivot[1]:g}"
        raise SysidError(f"--method {options.method}{pivot}: known are auto, {', '.join(known)}.")
    tried = {name: one for name, one in known.items() if options.method in ("auto", name)}
    for last in (False, True):
        several = [tracker.find(reel) for tracker in tried.values() if tracker.last_resort == last]
        targets = [target for target in several if target is not None]
        if targets:
            found = True
            yield targets
    if not found:
        where = "" if options.roi is None else f" in --roi {' '.join(map(str, options.roi))}"
        if options.method == "auto":
            raise SysidError(
                f"{path}: no board is found{where} by any of {', '.join(tried)}. Put something on the deck that "
                "stands out (docs/video.md)."
            )
        words = tried[options.method].not_found.format(where=where)
        raise SysidError(f"{path}: {words}, or choose another --method.")
