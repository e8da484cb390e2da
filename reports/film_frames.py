"""The frames of a film with what was followed drawn in, for a recording.

Every frame is a JPEG picture of its own: players of Rerun show it on every system, where a film in
H.264 needs a decoder that many lack, and MPEG-4 has none.
"""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from reports.recording import TIMELINE
from sysid.logs import VIDEO_SUFFIXES, LogOptions, read_roll
from sysid.roll import Array, Roll
from sysid.video.options import VideoOptions

if TYPE_CHECKING:
    import rerun as rr

MOST_FRAMES = 1500
"""Frames of one film in a recording; of a longer one every second, third, ... is taken."""
WIDTH = 640
QUALITY = 75


@dataclass(frozen=True, slots=True)
class FilmFrames:
    """Encoded pictures and when they were taken."""

    time: Array
    """[s] on the recording's time line, shape (n,)."""
    pictures: tuple[bytes, ...]
    """JPEG."""

    def log(self, stream: "rr.RecordingStream", entity: str) -> None:
        """Log the film under an entity."""
        import rerun as rr

        stream.log(entity, rr.EncodedImage.from_fields(media_type="image/jpeg"), static=True)
        stream.send_columns(
            entity,
            indexes=[rr.TimeColumn(TIMELINE, duration=self.time)],
            columns=rr.EncodedImage.columns(blob=list(self.pictures)),
        )


def is_film(path: Path) -> bool:
    """Return whether a log is a film."""
    return path.suffix.lower() in VIDEO_SUFFIXES


def read_film(path: Path, options: LogOptions) -> tuple[Roll, tuple[bytes, ...]]:
    """Read the roll of a film together with its pictures, as `sysid.video.overlay` draws them.

    Args:
        path: The film.
        options: How it is read; an overlay asked for there is written too.

    Returns:
        The roll, and one picture a sample of it.

    Raises:
        HuskyError: The film cannot be read as roll.
    """
    import cv2

    video = options.video or VideoOptions()
    with tempfile.TemporaryDirectory() as folder:
        overlay = video.overlay or Path(folder) / "overlay.avi"
        roll = read_roll(path, replace(options, video=replace(video, overlay=overlay)))
        pictures: list[bytes] = []
        clip = cv2.VideoCapture(str(overlay))
        while True:
            seen, picture = clip.read()
            if not seen:
                break
            scale = min(1.0, WIDTH / picture.shape[1])
            small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            pictures.append(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes())
        clip.release()
    return roll, tuple(pictures)


def film_frames(roll: Roll, pictures: tuple[bytes, ...], first: float) -> FilmFrames:
    """Put a film on the time line of a recording.

    Args:
        roll: The roll made from it.
        pictures: One a followed frame.
        first: Time of the first release on the roll's clock [s].
    """
    # Frames in which nothing was seen have a picture but no sample; between samples time runs evenly.
    time = np.interp(np.linspace(0, 1, len(pictures)), np.linspace(0, 1, len(roll.time)), roll.time)
    stride = -(-len(pictures) // MOST_FRAMES)
    return FilmFrames(time[::stride] - first, pictures[::stride])
