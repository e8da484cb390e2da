"""One pass through a clip: what is followed on the board, and how the camera moved."""

import numpy as np
import numpy.typing as npt

from sysid.errors import HuskyError
from sysid.video.film.background import Background
from sysid.video.film.camera import Lens
from sysid.video.film.frames import Clip, Frame
from sysid.video.film.track import Track
from sysid.video.trackers._base import Follower


def follow(clip: Clip, follower: Follower, lens: Lens, rate: float | None = None) -> Track:
    """Follow points through a clip, frame by frame; nothing but the points is kept.

    Raises:
        HuskyError: The clip is damaged or cut, or has fewer than 8 frames.
    """
    background = Background(follower.box, lens)
    stamps: list[float] = []
    indices: list[int] = []
    rows: list[npt.NDArray[np.float32]] = []
    repeated = 0
    nothing = np.full((follower.points, 2), np.nan, np.float32)
    for frame in clip.ahead():
        if rate is not None:
            frame = Frame(frame.index, frame.index / rate, frame.picture)
        if stamps and frame.time <= stamps[-1]:
            repeated += 1
            continue
        try:
            background.update(frame)
        except HuskyError as error:
            raise HuskyError(f"{clip.path}: {error}") from None
        found = follower.update(frame)
        stamps.append(frame.time)
        indices.append(frame.index)
        rows.append(nothing if found is None else found.astype(np.float32))
    if len(stamps) < 8:
        raise HuskyError(
            f"{clip.path}: {len(stamps)} frames are too few for a decay. Film at least a second."
        )
    return Track(np.array(stamps), np.array(rows), background.result(), np.array(indices, np.intp), repeated)
