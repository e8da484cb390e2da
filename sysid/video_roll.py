"""Roll of the deck from a film taken from behind.

A tracker (`sysid.video.trackers`) follows points on the deck. They are corrected for lens, camera shake and rolling shutter. They give
the angle of a body that turns about an axis at a slant to the camera.
"""

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.errors import SysidError
from sysid.noise.outliers import lone_outliers
from sysid.roll import Roll
from sysid.video.options import VideoOptions as VideoOptions

if TYPE_CHECKING:
    from sysid.video.film.camera import Lens
    from sysid.video.film.frames import Clip
    from sysid.video.select import Followed
    from sysid.video.types import Rows

MIN_FRAMES_PER_PERIOD = 8
"""Fewest frames a period; with fewer the fastest part of a swing is a guess."""


def roll_from_video(path: Path, options: VideoOptions | None = None) -> Roll:
    """Read the roll of a board from a film.

    Roll zero is the picture's horizontal if the target shows it, else the rest at the end of the film. Times are those of the
    container, from the film's first frame on, corrected for the readout of the sensor.

    Args:
        path: Film taken from behind the board, one uncut take.
        options: Options that overrule inference.

    Raises:
        SysidError: The file is not a film, is damaged, cut or too large, shows no board, or has fewer than 8 frames a period.
    """
    from sysid.video.film.camera import lens_of
    from sysid.video.film.frames import open_clip
    from sysid.video.film.reel import Reel
    from sysid.video.select import follow_board

    options = options or VideoOptions()
    clip = open_clip(path, options.progress)
    lens = lens_of(clip, options.calibration)
    with closing(Reel(clip, lens, options)) as reel:
        followed = follow_board(reel)
    roll, rows = roll_of(clip, lens, followed, options)
    if options.overlay is not None:
        from sysid.video.overlay import draw_overlay

        joined = followed.target.joined
        draw_overlay(clip, followed.track, roll, rows, options.overlay, joined)
    return roll


def roll_of(clip: "Clip", lens: "Lens", followed: "Followed", options: VideoOptions) -> "tuple[Roll, Rows]":
    """Return the roll of a target [rad], and the row of its track of each sample, shape (n,).

    Raises:
        SysidError: There are fewer than 8 frames for each period of the oscillation.
    """
    from sysid.video.film.pace import frames_per_period, speed_ramp
    from sysid.video.notes import faults, inferred
    from sysid.video.pose.view import View

    target, track, found = followed.target, followed.track, followed.found
    time = View.of(track, lens.straighten, clip.row_share).time(found.camera_state.readout)
    shaken = track.shake.std
    std = np.hypot(found.std, shaken)
    own = np.hypot(found.own, shaken)
    sign = -1.0 if options.front else 1.0
    angle = sign * (found.angle + target.zero(found))
    seen = np.flatnonzero(np.isfinite(angle))
    lone = lone_outliers(time[seen], angle[seen], rate=False) != 0
    rows = seen[~lone]
    time, angle, std, own = (one[rows] for one in (time, angle, std, own))
    if (ramp := speed_ramp(time, angle, own)) is not None:
        raise SysidError(
            f"{clip.path}: the frame rate changes at {ramp:.2f} s (edited slow motion?). Give the film as the camera took it."
        )
    rate = 1 / float(np.median(np.diff(track.time)))
    pace = frames_per_period(time, angle, own) if followed.turns else np.inf  # noise has no period
    if round(pace, 1) < MIN_FRAMES_PER_PERIOD:
        needed = rate * MIN_FRAMES_PER_PERIOD / pace
        raise SysidError(
            f"{clip.path}: {pace:.1f} frames a period ({rate:.3g} frames/s for an oscillation of {rate / pace:.3g} Hz); "
            f"{MIN_FRAMES_PER_PERIOD} are needed. Film at {needed:.3g} frames/s or more (slow motion), or use an IMU."
        )
    # The readout of the first frame keeps the frame's stamp: a delay common to all frames has no effect.
    delay = time[0] - track.time[rows[0]]
    notes = list(inferred(clip, lens, target, track, followed.before, found, options))
    if lone.any():
        notes.append(f"frames: {np.sum(lone)} outliers are left out")
    warnings = list(faults(clip, target, track, found))
    if len(lost := np.delete(track.time, seen)):
        warnings.append(
            f"{len(lost)} of {len(track.time)} frames, between {lost[0]:.4g} and {lost[-1]:.4g} s, show too little of the target "
            "and are left out; --overlay shows the reason"
        )
    if not followed.turns:
        warnings.append(
            f"the target turns by {np.degrees(np.ptp(angle)):.2g}° in all, less than a release or than its noise: no measurement of a board. "
            "Look at --overlay. Then give the board's region with --roi, or film a release"
        )
    roll = Roll(
        log=str(clip.path), time=time - delay, roll=angle, std=std, own_std=own, origin="video", zero="constant",
        errors_last=True, notes=tuple(notes), warnings=tuple(warnings),
    )  # fmt: skip
    return roll, rows
