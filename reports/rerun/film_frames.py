"""Frames of a film with the tracked points, for a recording.

Every frame is a JPEG picture, which Rerun shows on every system. Many systems lack a decoder for H.264, and Rerun has none for
MPEG-4.
"""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from reports.rerun.stream import TIMELINE
from sysid.logs import LogOptions, read_roll
from sysid.roll import Array, Roll
from sysid.video.options import VideoOptions

if TYPE_CHECKING:
    import rerun as rr

MOST_FRAMES = 1500
"""Frames of one film in a recording; of a longer one every second, third, ... is taken."""
WIDTH = 640
QUALITY = 75
"""Width of the pictures kept [px] and their JPEG quality, of 100 (choices: a deck's end is still sharp)."""


@dataclass(frozen=True, slots=True)
class FilmFrames:
    """Encoded pictures and when they were taken."""

    time: Array
    """[s] on the recording's time line, shape (n,)."""
    pictures: tuple[bytes, ...]
    """JPEG."""

    def aligned(self, first: float) -> "FilmFrames":
        """Return the frames with time since the first release [s], and not more than `MOST_FRAMES` of them."""
        stride = max(1, -(-len(self.pictures) // MOST_FRAMES))
        return FilmFrames(self.time[::stride] - first, self.pictures[::stride])

    def log(self, stream: "rr.RecordingStream", entity: str) -> None:
        """Log the film under an entity."""
        import rerun as rr

        stream.log(entity, rr.EncodedImage.from_fields(media_type="image/jpeg"), static=True)
        stream.send_columns(
            entity,
            indexes=[rr.TimeColumn(TIMELINE, duration=self.time)],
            columns=rr.EncodedImage.columns(blob=list(self.pictures)),
        )


def read_film(path: Path, options: LogOptions) -> tuple[Roll, FilmFrames]:
    """Read the roll of a film together with its pictures on the roll's clock, as `sysid.video.overlay` draws them.

    Raises:
        SysidError: The film cannot be read as roll.
    """
    video = options.video or VideoOptions()
    times: list[float] = []
    pictures: list[bytes] = []

    def keep(time: float, picture: npt.NDArray[np.uint8]) -> None:
        times.append(time)
        pictures.append(_encoded(picture))

    with tempfile.TemporaryDirectory() as folder:
        overlay = video.overlay or Path(folder) / "overlay.avi"
        roll = read_roll(path, replace(options, video=replace(video, overlay=overlay, on_frame=keep)))
    return roll, FilmFrames(np.array(times), tuple(pictures))


def _encoded(picture: npt.NDArray[np.uint8]) -> bytes:
    import cv2

    scale = min(1.0, WIDTH / picture.shape[1])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
