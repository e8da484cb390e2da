"""What to follow in a film, and why."""

from collections.abc import Iterator
from dataclasses import replace

from sysid.errors import HuskyError
from sysid.video import trackers
from sysid.video.film.camera import Lens
from sysid.video.film.frames import Clip
from sysid.video.film.track import Track
from sysid.video.follow import follow
from sysid.video.options import VideoOptions
from sysid.video.trackers._base import Scene, Target, Tracker

MIN_SEEN_SHARE = 0.6
"""Share of the frames in which what is followed must be seen."""


def follow_board(clip: Clip, lens: Lens, options: VideoOptions) -> tuple[Target, Track]:
    """Follow the first of the targets that is seen in most frames.

    Raises:
        HuskyError: There is none.
    """
    failed: list[str] = []
    for target in targets(clip, options):
        track = follow(clip, target.follower, lens, options.rate)
        track = track if target.settle is None else target.settle(track)
        seen = len(track.time) - track.lost
        if seen >= MIN_SEEN_SHARE * len(track.time):
            return target, track
        failed.append(f"{target.what} is seen in only {seen} of {len(track.time)} frames")
    raise HuskyError(
        f"{clip.path}: {'; '.join(failed)}. Keep the board in the picture, film in more light (less blur), or "
        "follow something else (--method)."
    )


def targets(clip: Clip, options: VideoOptions) -> Iterator[Target]:
    """Yield what can be followed: by the tracker that the user names, else by each in the order of rank.

    Raises:
        HuskyError: Nothing that can be followed is found.
    """
    tried = _asked_for(options)
    scene = Scene(clip, options)
    found, missing = False, list[str]()
    for name, tracker in tried.items():
        target = tracker.find(scene)
        if target is None:
            missing.append(name)
            continue
        found = True
        reason = f", as {' and '.join(missing)} found nothing" if missing else ", the first that is tried"
        yield target if len(tried) == 1 else replace(target, why=target.why + reason)
    if not found:
        where = "" if options.roi is None else f" in --roi {' '.join(map(str, options.roi))}"
        if options.method == "auto":
            raise HuskyError(
                f"{clip.path}: no board is found{where} by any of {', '.join(tried)}. Put something on the deck that "
                "stands out (docs/video.md)."
            )
        words = tried[options.method].not_found.format(where=where)
        raise HuskyError(f"{clip.path}: {words}, or choose another --method.")


def _asked_for(options: VideoOptions) -> dict[str, Tracker]:
    """Return the trackers that may be used, by name."""
    known = trackers.ranked()
    if options.method not in ("auto", *known):
        raise HuskyError(f"--method {options.method}: known are auto, {', '.join(known)}.")
    asked = {name: one for name, one in known.items() if options.method in ("auto", name)}
    if options.pivot is None:
        return asked
    turning = {name: one for name, one in asked.items() if one.takes_pivot}
    if not turning:
        takes = ", ".join(name for name, one in known.items() if one.takes_pivot)
        raise HuskyError(
            f"--pivot {options.pivot[0]:g} {options.pivot[1]:g}: --method {options.method} takes none, only {takes} "
            "does. Leave out one of the two."
        )
    return turning
