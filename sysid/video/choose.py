"""What to follow in a film, and why."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.errors import HuskyError
from sysid.roll import Array
from sysid.video.dots import DotTracker, find_dots, fit_pivot
from sysid.video.frames import Clip
from sysid.video.marker import MarkerTracker, find_marker
from sysid.video.options import VideoOptions
from sysid.video.survey import Survey, survey
from sysid.video.track import Tracker
from sysid.video.turning import Turning, fit_turning

Solve = Callable[[Array, Array, tuple[float, float] | None], Turning]
"""Points [px], camera matrix and direction of the axis, where known, to the angle."""

MARKER_SEARCH = 20
"""Frames in which a marker is looked for."""


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
    finds_direction: bool
    warnings: tuple[str, ...] = ()


def choose(clip: Clip, options: VideoOptions) -> Chosen:
    """Choose what to follow: what the user says, else the first that is there of marker, dots, texture, edge.

    Raises:
        HuskyError: Nothing that can be followed is found.
    """
    if options.method in ("auto", "marker"):
        chosen = _marker(clip, options.method == "auto")
        if chosen is not None:
            return chosen
        if options.method == "marker":
            raise HuskyError(
                f"{clip.path}: no ArUco or AprilTag marker is seen. Print a larger one with a white margin, film "
                "it sharp and large (50 px or more), or choose another --method."
            )
    look = survey(clip, options.roi)
    tried = [_dots] if options.method == "auto" else [{"dots": _dots}[options.method]]
    for attempt in tried:
        chosen = attempt(clip, look, options)
        if chosen is not None:
            return chosen
    raise HuskyError(f"{clip.path}: no board is found")


def _marker(clip: Clip, auto: bool) -> Chosen | None:
    every = max(1, clip.announced // MARKER_SEARCH)
    for frame in clip.frames(every):
        marker = find_marker(frame.picture)
        if marker is not None:
            break
    else:
        return None
    return Chosen(
        tracker=MarkerTracker(marker),
        what=f"{marker.kind} marker {marker.number}",
        why=f"follows {marker.kind} marker {marker.number}" + (", as one is in the picture" if auto else ""),
        solve=lambda points, matrix, direction: fit_turning(points, matrix, direction=direction, square=True),
        zero=lambda turning: _level(
            turning, np.vdot(np.exp(1j * np.pi / 4 * np.array([-3, -1, 1, 3])), turning.shape), 4
        ),
        zero_note="roll zero is where the marker's edges are level in the picture",
        finds_direction=True,
    )


def _dots(clip: Clip, look: Survey, options: VideoOptions) -> Chosen | None:
    dots = find_dots(look)
    if not dots:
        return None
    auto = ", as no marker is in the picture and they stand out" if options.method == "auto" else ""
    size = ", ".join(f"{2 * dot.radius:.0f} px wide at {dot.place[0]:.0f},{dot.place[1]:.0f}" for dot in dots)
    tracker = DotTracker(dots, look.box)
    if len(dots) == 2:
        return Chosen(
            tracker=tracker,
            what="the pair of dots",
            why=f"follows two coloured dots ({size}){auto}",
            solve=lambda points, matrix, direction: fit_turning(points, matrix, direction=direction),
            zero=lambda turning: _level(turning, complex(turning.shape[1] - turning.shape[0]), 2),
            zero_note="roll zero is where the line between the dots is level in the picture",
            finds_direction=True,
        )
    if options.method == "auto" and options.pivot is None and dots[0].radius < 6:
        return None
    where = "fitted" if options.pivot is None else "given"
    return Chosen(
        tracker=tracker,
        what="the dot",
        why=f"follows one coloured dot ({size}) about a {where} pivot{auto}",
        solve=lambda points, matrix, direction: fit_pivot(
            points, matrix, direction=direction, pivot=options.pivot
        ),
        zero=lambda turning: _level(turning, 1 + 0j, 4),
        zero_note="roll zero is where the dot is straight below, above or beside the pivot in the picture",
        finds_direction=False,
    )


def _level(turning: Turning, direction: complex, symmetry: int) -> float:
    """Turn the angles so that a body of this symmetry, seen along `direction` at angle 0, starts level."""
    tilt = float(np.angle(direction))
    rest = float(np.nanmedian(turning.angle)) + tilt
    quarter = 2 * np.pi / symmetry
    return tilt - quarter * round(rest / quarter)
