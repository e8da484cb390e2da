"""What to follow in a film, and why: of all that is found, what tells the angle best."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video import trackers
from sysid.video.film.frames import ahead
from sysid.video.film.reel import Reel
from sysid.video.film.track import Track
from sysid.video.follow import MIN_SEEN_SHARE, follow, follow_all, track_of
from sysid.video.options import VideoOptions
from sysid.video.pose.angle import AngleTrack, fit_angle
from sysid.video.pose.camera_state import CameraState, before_looking
from sysid.video.pose.prior import ANY_SIDE, BODY_FLOOR, BodyPrior
from sysid.video.pose.rectify import upright
from sysid.video.pose.view import View
from sysid.video.registration import BodyPicture, picture_of_body
from sysid.video.trackers._base import DEAD_ZONE, MIN_SWING, Target, Tracker, level_at_rest, rests_at
from sysid.video.types import Points

MAX_LOST = 0.9
"""Share of the frames from which on what is lost in them was nothing [1]."""
ADVICE = (
    "Keep the board in the picture, film all of its swing straight from behind and in more light (less blur), or follow "
    "something else (--method, --roi, docs/video.md)."
)
VAGUE, MAX_STD = np.radians([0.3, 3.0])
"""Standard deviation above which what takes long is tried as well, and above which an angle is none [rad]."""
MAX_STRAY, MIN_STRAY = 0.3, 0.01
"""How far a point may be from a circle about a fixed pivot, as a share of its own motion and of the picture's width: beyond
both it was carried, not turned."""
CLEARLY = 0.7
"""What shows level is left for another one only if that has less than this share of its uncertainty."""
WHOLE_BODY = 3.0
"""The whole body is preferred even where it states so many times the uncertainty: it states what lasts (`BODY_FLOOR`),
which a few points do not know of. In rendered films it takes off most of the error of texture and half of that of dots; a
marker on a bare deck, which is sure of its corners, reads damping with less bias alone."""
MAX_ASIDE = 4.0
"""What runs on circles only for a camera that stands so many standard deviations from where people stand turns about no axis of a board."""
MAX_BENT_PATCHES, MAX_BENT = 0.007, 0.002
"""Share of its size by which a rigid body may be bent when it rests, beyond what compression does (`BODY_FLOOR`): as its patches show it,
which agree on an affine motion, and as all of it does to a camera along the axis [1]. In films of many kinds up to 0.005 and 0.001; where
it bends, or lies at several depths so that angles are 2 to 20 % off, one of them is beyond."""
MAX_ASKEW = np.radians(20.0)
"""A board does not come to rest further from level: what says so are prints on it, not stickers put on level [rad]."""
MAX_DISAGREEMENT = 0.1
"""Share of the swing by which two that are followed may differ and still be parts of one board."""


@dataclass(frozen=True, slots=True)
class Followed:
    """A target with the angle that it gives."""

    target: Target
    track: Track
    before: CameraState
    """What was known of the camera before its points were looked at."""
    found: AngleTrack
    laid: tuple[BodyPicture, list[Points]] | None = None
    """What turns with it, and its corners in each frame that is in memory; None where that was not looked for."""
    whole: AngleTrack | None = None
    """The angle of that, in these frames."""

    @property
    def std(self) -> float:
        """Typical standard deviation of the angle [rad]: noise, misfit, and what is unknown of the camera."""
        return float(np.nanmedian(self.found.std))

    @property
    def turns(self) -> bool:
        """Whether it turns at all: a marker on the wall does not."""
        return float(np.ptp(self.found.angle[np.isfinite(self.found.angle)])) > max(6 * self.std, MIN_SWING)

    @property
    def swing(self) -> float:
        """How far the angle goes from its middle [rad]."""
        return float(np.nanmax(np.abs(self.found.angle - np.nanmedian(self.found.angle))))

    @property
    def level(self) -> Array:
        """The angle with zero where this target has it [rad], shape (n,)."""
        return self.found.angle + self.target.zero(self.found)


def follow_board(reel: Reel) -> Followed:
    """Follow what tells the angle best; level is where the first of them that shows it has it.

    All of them are followed in the frames that are in memory, the best one in the rest of the film.

    Raises:
        SysidError: There is none.
    """
    usable: list[Followed] = []
    failed: list[str] = []
    missed: list[str] = []  # what somebody may have put there to be followed
    for targets in find_targets(reel):
        stamps = [(frame.index, frame.time) for frame in reel.kept]
        with ThreadPoolExecutor() as pool:
            places = pool.map(lambda one: follow_all(one.follower, reel.kept), targets)
        for target, points in zip(targets, places, strict=True):
            track = track_of(reel, stamps, np.array(points))
            one = _followed(reel, target, track)
            if isinstance(one, Followed) and target.shows_body and not target.shows_level and one.turns:
                one = _borne_out(reel, one)
            if isinstance(one, Followed):
                usable.append(one)
            else:
                failed.append(one)
                missed += [one] if target.shows_level and track.lost < MAX_LOST * len(track.time) else []
        if min((one.std for one in usable if one.turns), default=np.inf) < VAGUE:
            break
    if not usable:
        raise SysidError(f"{reel.clip.path}: {'; '.join(failed)}. {ADVICE}")
    if turning := [one for one in usable if one.turns]:
        missed += [f"{one.target.what} does not turn" for one in usable if not one.turns]
    best = _best(turning or usable)
    best = replace(best, target=replace(best.target, why="; ".join([best.target.why, *missed])))
    return _to_the_end(reel, best)


def _to_the_end(reel: Reel, led: Followed) -> Followed:
    """Follow a target through the rest of the film, and everything that turns as it does."""
    target, points = led.target, list(led.track.points)
    stamps = [(frame.index, frame.time) for frame in reel.kept]
    body, corners = led.laid or (_lay_body(reel, led) if target.shows_body else None) or (None, [])
    whole = _whole_body(reel, led, corners) if corners else None
    last = next((seen for seen in reversed(corners) if np.isfinite(seen).all()), None)
    rest = ((frame, follow(target.follower, frame)) for frame in reel.others())
    with closing(ahead(rest, 1)) as others:
        for frame, seen in others:
            stamps.append((frame.index, frame.time))
            points.append(seen)
            if body is not None and whole is not None:
                corners.append(body.seen(frame, seen, last))
                last = corners[-1] if np.isfinite(corners[-1]).all() else last
    if len(points) > len(led.track.points):
        whole_film = _followed(reel, target, track_of(reel, stamps, np.array(points)))
        if isinstance(whole_film, str):
            raise SysidError(f"{reel.clip.path}: {whole_film}. {ADVICE}")
        led = whole_film
        whole = None if whole is None else _whole_body(reel, led, corners)
    return whole or led


def _lay_body(reel: Reel, led: Followed) -> tuple[BodyPicture, list[Points]] | None:
    """Return everything that turns with a target, and its corners in each frame in memory; None where nothing does."""
    flat = upright(reel.lens.matrix, led.found.camera_state.value)
    body = picture_of_body(reel.kept, reel.look.box, led.track, flat)
    if body is None:
        return None
    with ThreadPoolExecutor() as pool:
        return body, list(pool.map(body.seen, reel.kept, led.track.points))


def _borne_out(reel: Reel, one: Followed) -> Followed | str:
    """Return texture with what turns as it does; or why it is none of the board: patches of anything agree on some motion."""
    laid = _lay_body(reel, one)
    whole = None if laid is None else _whole_body(reel, one, laid[1])
    if whole is None:
        return f"{one.target.what} is none of the board: pictures turned back by it do not agree"
    for found, most in ((one.found, MAX_BENT_PATCHES), (whole.found, MAX_BENT)):
        if (bent := _bent(found)) > most:
            return f"{one.target.what} lies at several depths or bends: by {100 * bent:.1f} % of its size when it rests"
    return replace(one, laid=laid, whole=whole.found)


def _bent(found: AngleTrack) -> float:
    """Return how far a body's points are off when it rests, beyond what compression does, as a share of its size [1]."""
    size = float(np.abs(found.shape - found.shape.mean()).mean())
    return float(np.sqrt(max(found.noise**2 - BODY_FLOOR**2, 0.0))) / size


def _best(usable: list[Followed]) -> Followed:
    """Judge by the uncertainty that each reaches in this film; one that contradicts the first is none of the board."""
    if len(usable) == 1:
        return usable[0]
    surest = min(usable, key=lambda one: one.std)
    first = next((one for one in usable if one.target.shows_level), surest)
    agreeing = [one for one in usable if _same_swing(one, first)]
    best = min(
        agreeing, key=lambda one: one.std * (CLEARLY if one is first and one.target.shows_level else 1.0)
    )
    others = ", ".join(
        f"{one.target.what} ±{2 * np.degrees(one.std):.2g}°" for one in usable if one is not best
    )
    why = f"{best.target.why}: ±{2 * np.degrees(best.std):.2g}° in this film"
    target = replace(best.target, why=f"{why} ({others})" if others else why)
    stray = [  # what is too uncertain to agree contradicts nothing
        one.target.what
        for one in usable
        if one.std < MAX_DISAGREEMENT * first.swing and not _same_swing(one, first)
    ]
    if stray:
        words = f"{' and '.join(stray)} moves otherwise than {first.target.what} and is not used; --roi keeps to the board"
        target = replace(target, warnings=(*target.warnings, words))
    if first is not best and first.target.shows_level:
        target = replace(
            target,
            zero=partial(_level_of, first.level),
            zero_note=first.target.zero_note,
            shows_level=True,
        )
    return replace(best, target=target)


def _followed(reel: Reel, target: Target, track: Track) -> Followed | str:
    """Return a target with its angle; or why its points do not tell any."""
    seen, frames = len(track.time) - track.lost, len(track.time)
    if seen < MIN_SEEN_SHARE * frames:
        return f"{target.what} is seen in only {seen} of {frames} frames"
    lens, options = reel.lens, reel.options
    readout = reel.clip.readout if options.readout is None else options.readout
    before = before_looking(track, lens, target.direction_std, readout, options.camera_angle)
    try:
        found = target.solve(View(track, lens.straighten, reel.clip.row_share), lens.matrix, before)
    except np.linalg.LinAlgError:
        return f"{target.what} shows too few different attitudes for an angle to be told"
    one = Followed(target, track, before, found)
    if (fault := _fault(one)) is not None:
        return fault
    if not target.shows_level or not abs(askew := rests_at(one.level)) > MAX_ASKEW:
        return one
    off = f"what is followed is {abs(np.degrees(askew)):.0f}° off level there"
    target = replace(
        target,
        shows_level=False,
        zero=level_at_rest,
        zero_note=f"where the deck is at the end of the film: {off}",
    )
    return replace(one, target=target)


def _fault(one: Followed) -> str | None:
    """Say why an angle is none, if it is not."""
    frames, what = len(one.found.angle), one.target.what
    if (kept := int(np.isfinite(one.found.angle).sum())) < MIN_SEEN_SHARE * frames:
        return (
            f"{what} is seen in {frames - one.track.lost} of {frames} frames, but turns as one body in only {kept}: something "
            "else was followed in the others"
        )
    state = one.found.camera_state
    if np.any(np.abs(state.value - one.before.value)[:2] > MAX_ASIDE * one.before.std[:2]):
        return f"{what} turns about an axis that no camera behind a board looks along"
    if one.target.shows_body and _strays(one.track, one.found.angle):
        return f"{what} moves along rather than turns about a point: a foot, a hand, or a camera that moves"
    if one.std > MAX_STD:
        return f"{what} tells the angle to ±{2 * np.degrees(one.std):.2g}° only"
    # A marker or stickers on a board may stand still; patches and lines may be of anything.
    placed = one.target.shows_body and one.target.shows_turn
    return None if placed or one.turns else f"{what} does not turn, as what is behind the board"


def _strays(track: Track, angle: Array) -> bool:
    """Return whether the point that is seen most leaves the circle about any fixed pivot, as it turns by an angle (n,) [rad]."""
    points = track.shake.undo(track.points.astype(np.float64))
    path = points[:, int(np.argmax(np.isfinite(points[..., 0]).sum(axis=0)))] @ np.array([1, 1j])
    seen = np.isfinite(path) & np.isfinite(angle)
    circle = np.stack([np.ones(seen.sum()), np.exp(1j * angle[seen])], axis=1)
    fit, *_ = np.linalg.lstsq(circle, path[seen], rcond=None)
    stray = float(np.quantile(np.abs(path[seen] - circle @ fit), 0.8))
    moved = float(
        np.quantile(np.abs(path[seen] - np.median(path.real[seen]) - 1j * np.median(path.imag[seen])), 0.8)
    )
    return stray > max(MAX_STRAY * moved, MIN_STRAY * 2 * track.shake.centre.real)


def _whole_body(reel: Reel, led: Followed, corners: list[Points]) -> Followed | None:
    """Let everything that turns with a target tell the angle, if that contradicts it nowhere and tells it as well."""
    target = led.target
    body = replace(
        target,
        what=f"the body of {target.what}",
        why=f"{target.why}; the angle is that of everything that turns with it",
        solve=partial(_solve_whole, led),
        zero=lambda _: 0.0,
        joined=((0, 1), (1, 2), (2, 3), (3, 0)),
    )
    own = _followed(reel, body, replace(led.track, points=np.array(corners)))
    if isinstance(own, str) or not _same_swing(own, led):
        return None
    return own if own.std < WHOLE_BODY * led.std else None


def _solve_whole(led: Followed, view: View, matrix: Array, before: CameraState) -> AngleTrack:
    """Return the angle of the whole body, with zero where the target that led to it has it.

    Its points err less than patches of texture do, so that they take their place. Where places on the board led to it, they tell where
    the camera stands, and how far it turned where the body contradicts them: pixels at several depths, made upright by a wrong slant,
    seem to turn up to 2 % further.
    """
    points, prior = led.found, BodyPrior(floor=BODY_FLOOR, dead_zone=DEAD_ZONE)
    if led.target.shows_turn:
        camera = replace(points.camera_state, covariance=np.zeros((4, 4)))
        found = _as_places_have_it(fit_angle(view, matrix, camera, prior), points)
    else:
        found = led.whole or fit_angle(view, matrix, before, replace(prior, slopes=ANY_SIDE))
    # Where the body is not made out, for a hand before it say, the points may be.
    whole = np.isfinite(found.angle)
    return replace(
        found,
        angle=np.where(whole, found.angle + _level_of(led.level, found), led.level),
        std=np.where(whole, found.std, points.std),
        own=np.where(whole, found.own, points.own),
    )


def _as_places_have_it(found: AngleTrack, points: AngleTrack) -> AngleTrack:
    """Return the angle of a body as far as places on it turn, and with what they leave open of the camera."""
    common = np.maximum(points.std**2 - points.own**2, 0)
    swing = np.nanmax(np.abs(points.angle - np.nanmedian(points.angle)))
    doubt = float(np.sqrt(np.nanmax(common)) / swing)
    return replace(
        found,
        camera_state=points.camera_state,
        angle=_as_far(found.angle, points.angle, points.own, doubt),
        # The body may be made out where the points contradict each other, as in a blurred frame.
        std=np.sqrt(found.own**2 + np.where(np.isfinite(common), common, np.nanmax(common))),
    )


def _as_far(angle: Array, other: Array, std: Array, doubt: float) -> Array:
    """Return an angle that turns as far as another one with this standard deviation, all of shape (n,) [rad].

    What is within the other's doubt of its own scale [1] is no contradiction and stays; the share that is taken is that of
    Stein's shrinkage: of what is taken and what is doubted, squared.
    """
    apart = np.abs(angle - other - np.nanmedian(angle - other))
    both = apart < MAX_DISAGREEMENT * np.nanmax(np.abs(other - np.nanmedian(other)))
    line = np.stack([angle[both], np.ones(both.sum())], axis=1) / std[both, None]
    fit, *_ = np.linalg.lstsq(line, other[both] / std[both], rcond=None)
    contradiction = np.log(fit[0]) ** 2
    return fit[0] ** (contradiction / (contradiction + doubt**2)) * angle


def _same_swing(one: Followed, other: Followed) -> bool:
    """Whether two angles are one but for a constant."""
    apart = one.found.angle - other.found.angle
    apart = np.abs(apart - np.nanmedian(apart))
    return bool(np.nanquantile(apart, 0.9) < MAX_DISAGREEMENT * other.swing)


def _level_of(level: Array, found: AngleTrack) -> float:
    """What to add to an angle so that zero is where another one has it, in the first frames or in all [rad]."""
    return float(np.nanmedian(level - found.angle[: len(level)]))


def find_targets(reel: Reel) -> Iterator[list[Target]]:
    """Yield what can be followed: by the tracker that the user names, else by all; what takes long at last.

    Raises:
        SysidError: Nothing that can be followed is found.
    """
    path, options = reel.clip.path, reel.options
    tried = _asked_for(options)
    found = False
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


def _asked_for(options: VideoOptions) -> dict[str, Tracker]:
    """Return the trackers that may be used, by name."""
    known = trackers.ranked()
    if options.pivot is not None:
        known = {name: one for name, one in known.items() if one.takes_pivot}
    if options.method not in ("auto", *known):
        pivot = "" if options.pivot is None else f" --pivot {options.pivot[0]:g} {options.pivot[1]:g}"
        raise SysidError(f"--method {options.method}{pivot}: known are auto, {', '.join(known)}.")
    return {name: one for name, one in known.items() if options.method in ("auto", name)}
