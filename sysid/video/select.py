"""What to follow in a film, and why."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sysid.errors import HuskyError
from sysid.roll import Array
from sysid.video.film.edge_profile import PIECES
from sysid.video.film.frames import Clip, grey
from sysid.video.film.survey import Survey, box_of, survey
from sysid.video.film.track import Box, Track, Tracker
from sysid.video.options import VideoOptions
from sysid.video.pose.angle import Turning, fit_turning
from sysid.video.pose.camera_state import Unknowns
from sysid.video.pose.prior import Solid
from sysid.video.pose.rigid_group import belonging
from sysid.video.pose.view import View
from sysid.video.trackers.dots import DotTracker, find_dots, fit_pivot
from sysid.video.trackers.edge.find import find_deck_end
from sysid.video.trackers.edge.slope import deck_slopes
from sysid.video.trackers.edge.tracker import EdgeTracker
from sysid.video.trackers.edge.turn import fit_direction
from sysid.video.trackers.marker import MarkerTracker, find_marker
from sysid.video.trackers.texture import FEWEST, FeatureTracker, count_alike, find_features

Solve = Callable[[View, Array, Unknowns], Turning]
"""Points, camera matrix and what is known of the camera beforehand to the angle."""

MARKER_SEARCH = 20
"""Frames in which a marker is looked for."""
SQUARE_DOUBT = np.radians(15.0)
"""Standard deviation of the camera's direction before the film shows it: people stand about square [rad]."""
EDGE_DOUBT = np.radians(5.0)
"""Standard deviation of the camera's direction where nothing in the film shows it [rad]."""
DEEP = 0.03
"""Standard deviation of the circles' centres where points may lie anywhere on the deck, in focal lengths: a
tenth of a focal length aside, at depths that differ by a third."""
DEAD_ZONE = 0.15
"""Motion of the outermost points of colour or faint texture that compression may leave out of a film, to either
side [px]: as found in films of 0.1 bit a pixel. A phone's have two to four times as many. A marker is too black
and white for that."""
SLANT = 3.0
"""Motion up to which patches of texture err alike [px]: as the deck turns they are seen at another slant, of which
the reference knows nothing."""
DOT_FLOOR = 0.08
"""Least standard deviation of a dot's place [px]: films hold colour at half the resolution of brightness."""
NOT_FOUND = {
    "marker": "no ArUco or AprilTag marker is seen{where}. Print a larger one with a white margin, film it sharp and "
    "large (50 px or more)",
    "dots": "no coloured dot that moves is seen{where}. Use stickers of a colour that nothing else has",
    "features": f"fewer than {FEWEST} patches of texture move as one{{where}}. Film the deck larger or in more light",
    "edge": "no straight edge that moves is seen{where}. Give its region with --roi LEFT TOP WIDTH HEIGHT",
    "auto": "no board is found{where}: neither marker, coloured dots, texture nor straight edge moves. Print a marker "
    "(docs/video.md)",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Chosen:
    """A tracker, how its points make an angle, and what to tell people."""

    tracker: Tracker
    what: str
    """What is followed, for messages."""
    why: str
    solve: Solve
    zero: Callable[[Turning], float]
    """What to add so that zero is where it should be [rad]."""
    zero_note: str
    finds_direction: bool = True
    """Whether the points show from where the camera looks."""
    warnings: tuple[str, ...] = ()
    settle: Callable[[Track], Track] | None = None
    """What to leave out of the track once the whole film is known."""
    joined: tuple[tuple[int, int], ...] = ()
    """Points between which a line is drawn, so that a person sees what they are."""

    @property
    def direction_doubt(self) -> float:
        """Standard deviation of yaw and pitch before the film is looked at [rad]."""
        return SQUARE_DOUBT if self.finds_direction else EDGE_DOUBT


def choices(clip: Clip, options: VideoOptions) -> Iterator[Chosen]:
    """Yield what can be followed: what the user says, else whatever is there of marker, dots, texture, edge.

    Raises:
        HuskyError: Nothing that can be followed is found.
    """
    if options.pivot is not None and options.method not in ("auto", "dots"):
        raise HuskyError(
            f"--pivot {options.pivot[0]:g} {options.pivot[1]:g}: it is what a single dot turns about, and --method "
            f"{options.method} follows no dot. Leave out one of the two."
        )
    method = "dots" if options.pivot is not None else options.method
    auto = method == "auto"
    found = False
    region = None if options.roi is None else box_of(clip, options.roi)
    if auto or method == "marker":
        chosen = _marker(clip, auto, region)
        if chosen is not None:
            yield chosen
            return
    if method != "marker":
        look = survey(clip, options.roi)
        ways = {"dots": _dots, "features": _features, "edge": partial(_edge, clip)}
        for way in ways.values() if auto else (ways[method],):
            chosen = way(look, options)
            if chosen is not None:
                found = True
                yield chosen
    if not found:
        other = "." if auto else ", or choose another --method."
        where = "" if options.roi is None else f" in --roi {' '.join(map(str, options.roi))}"
        raise HuskyError(f"{clip.path}: {NOT_FOUND[method].format(where=where)}{other}")


def _marker(clip: Clip, auto: bool, region: Box | None) -> Chosen | None:
    every = max(1, clip.announced // MARKER_SEARCH)
    region = region or (0, 0, clip.width, clip.height)
    for frame in clip.frames(every):
        marker = find_marker(frame.picture, region)
        if marker is not None:
            break
    else:
        return None
    return Chosen(
        tracker=MarkerTracker(marker, region),
        what=f"{marker.kind} marker {marker.number}",
        why=f"follows {marker.kind} marker {marker.number}" + (", as one is in the picture" if auto else ""),
        solve=partial(fit_turning, solid=Solid(square=True)),
        zero=_level_square,
        joined=((0, 1), (1, 2), (2, 3), (3, 0)),
        zero_note="roll zero is where the marker's edges are level in the picture",
    )


def _dots(look: Survey, options: VideoOptions) -> Chosen | None:
    dots = find_dots(look)
    auto = ", as no marker is in the picture and they stand out" if options.method == "auto" else ""
    if len(dots) == 2 and options.pivot is not None:
        raise HuskyError(
            f"--pivot {options.pivot[0]:g} {options.pivot[1]:g}: it is what a single dot turns about, and two dots move "
            "here, which need none. Leave it out, or give the region of the one with --roi LEFT TOP WIDTH HEIGHT."
        )
    size = ", ".join(f"{2 * dot.radius:.0f} px wide at {dot.place[0]:.0f},{dot.place[1]:.0f}" for dot in dots)
    if len(dots) == 2:
        return Chosen(
            tracker=DotTracker(dots, look.box, confined=options.roi is not None),
            what="the pair of dots",
            why=f"follows two coloured dots ({size}){auto}",
            solve=partial(fit_turning, solid=Solid(floor=DOT_FLOOR, dead_zone=DEAD_ZONE)),
            zero=_level_pair,
            joined=((0, 1),),
            zero_note="roll zero is where the line between the dots is level in the picture",
        )
    if not dots:
        return None
    return Chosen(
        tracker=DotTracker(dots, look.box, confined=options.roi is not None),
        what="the dot",
        why=f"follows one coloured dot ({size}) about a {'fitted' if options.pivot is None else 'given'} pivot{auto}",
        solve=partial(fit_pivot, pivot=options.pivot),
        zero=partial(_level, direction=1 + 0j, symmetry=4),
        zero_note="roll zero is where the dot is straight below, above or beside the pivot in the picture",
        finds_direction=False,
    )


def _features(look: Survey, options: VideoOptions) -> Chosen | None:
    places = find_features(look)
    if len(places) < FEWEST:
        return None
    auto = ", as neither marker nor dots are in the picture" if options.method == "auto" else ""
    return Chosen(
        tracker=FeatureTracker(grey(look.first.picture), places, look.box),
        what="the deck's texture",
        why=f"follows {len(places)} patches of texture that move{auto}",
        settle=_those_of_the_board,
        solve=_fit_texture,
        zero=_rest_at_the_end,
        zero_note="roll zero is where the deck is at the end of the film (its last tenth): texture shows no horizontal",
    )


def _edge(clip: Clip, look: Survey, options: VideoOptions) -> Chosen | None:
    end = find_deck_end(look, deck_slopes(clip, look))
    if end is None:
        return None
    count = len(end.ends)
    lengths = ", ".join(f"{length:.0f}" for length in np.ptp(end.ends[..., 0], axis=1))
    auto = ", as neither marker, dots nor texture are in the picture" if options.method == "auto" else ""
    tracker = EdgeTracker(end, look.pictures[0], look.box)
    warnings: tuple[str, ...] = ()
    if options.camera_angle is None:
        warnings = (
            "an edge does not show from where the camera looks: it is taken to look along the board's axis "
            "to within 5 degrees (say otherwise with --camera-angle)",
        )
    return Chosen(
        tracker=tracker,
        what="the deck's edge",
        why=f"follows {count} straight edge{'s' if count > 1 else ''} ({lengths} px long){auto}",
        solve=partial(fit_direction, pivot=end.pivot),
        zero=partial(_level, direction=1 + 0j, symmetry=2),
        zero_note="roll zero is where the edge is level in the picture",
        joined=tuple((point, point + 1) for point in range(PIECES * count) if (point + 1) % PIECES),
        finds_direction=False,
        warnings=warnings,
    )


def _those_of_the_board(track: Track) -> Track:
    return replace(track, points=track.points[:, belonging(track.points.astype(np.float64), FEWEST)])


def _fit_texture(view: View, matrix: Array, before: Unknowns) -> Turning:
    points = view.track.points
    most = points[int(np.argmax(np.isfinite(points).all(axis=2).sum(axis=1)))].astype(np.float64)
    alike = count_alike(most[np.isfinite(most).all(axis=1)])
    body = Solid(centre_std=DEEP, alike=alike, dead_zone=DEAD_ZONE, still=SLANT, shows_lens=False)
    return fit_turning(view, matrix, before, body)


def _level_square(turning: Turning) -> float:
    upper_left = np.exp(1j * np.pi / 4 * np.array([-3, -1, 1, 3]))
    return _level(turning, complex(np.vdot(upper_left, turning.shape)), 4)


def _level_pair(turning: Turning) -> float:
    return _level(turning, complex(turning.shape[1] - turning.shape[0]), 2)


def _rest_at_the_end(turning: Turning) -> float:
    return -float(np.nanmedian(turning.angle[-max(5, len(turning.angle) // 10) :]))


def _level(turning: Turning, direction: complex, symmetry: int) -> float:
    """Turn the angles so that a body of this symmetry, seen along `direction` at angle 0, starts level."""
    tilt = float(np.angle(direction))
    rest = float(np.nanmedian(turning.angle)) + tilt
    step = 2 * np.pi / symmetry
    return tilt - step * round(rest / step)
