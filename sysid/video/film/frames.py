"""Frames of a clip with the container's own time stamps, one at a time."""

import os
from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video.film.container import read_container
from sysid.video.types import Box, Picture

Item = TypeVar("Item")
MAX_SIZE = (4096, 2304)
"""Largest picture that is read [px]: 4K; 8K would take seconds a frame and tell no more."""
BYTES_AHEAD = 48_000_000
"""Bytes of frames that are decoded ahead of the one that is worked on."""
SLOW_MOTION = 1.5
"""A film plays slowly if it was filmed at so many times the rate at which it plays."""
MAX_MISSING_SHARE = 0.05
"""Share of the announced frames that may be missing before a file counts as cut off."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame, upright; or the part of it that was kept."""

    index: int
    time: float
    """The container's stamp [s], of a film that plays slowly as it was filmed."""
    picture: Picture
    corner: tuple[int, int] = (0, 0)
    """Left and top of the picture in the film's [px]."""
    shift: Array = field(default_factory=lambda: np.zeros(2))
    """How far a camera that shakes has shifted what stands still since the first frame [px], shape (2,)."""

    @property
    def box(self) -> Box:
        """Left, top, right and bottom of the picture in the film's [px]."""
        left, top = self.corner
        return left, top, left + self.picture.shape[1], top + self.picture.shape[0]

    def part(self, box: Box) -> tuple[Picture, tuple[int, int]]:
        """Cut a box [px] out, as far as it was kept; return the part and its corner in the film's picture; shape (height, width, 3)."""
        left, top = self.corner
        part, (across, down) = crop(self.picture, (box[0] - left, box[1] - top, box[2] - left, box[3] - top))
        return part, (left + across, top + down)

    def dark(self, box: Box | None = None) -> "Frame":
        """Return the frame in grey, or a box [px] of it."""
        part, corner = self.part(box or self.box)
        return replace(self, picture=grey(part), corner=corner)


@dataclass(frozen=True, slots=True)
class Clip:
    """A film that opens and has a sane first frame; frames are decoded again at each iteration."""

    path: Path
    width: int
    """Width as shown, after turning by `rotation` [px]."""
    height: int
    rotation: int
    """Clockwise turn that the container asks for [deg]: 0, 90, 180 or 270."""
    announced: int
    """Number of frames that the container announces to show; 0 where it does not say."""
    codec: str = ""
    """Four letters that name the compression, in capitals, e.g. H264, HEVC, MJPG, FMP4; empty where not known."""
    slowed: float = 1.0
    """How many times slower it plays than it was filmed, as the file notes."""
    progress: Callable[[str, float], None] | None = None
    """Told which share of the film was decoded."""
    readout: float | None = None
    """Time from the sensor's first to its last row [s], as the phone notes it."""

    def frames(self, every: int = 1) -> Generator[Frame]:
        """Decode the clip from its start; only every `every`-th frame is converted to a picture.

        Raises:
            SysidError: The file ends before its announced length, or its stamps stand still.
        """
        count, last = 0, -np.inf
        with _quiet(), _opened(self.path) as capture:
            while capture.grab():
                if count % every == 0:
                    good, picture = capture.retrieve()
                    if not good:
                        break
                    time = capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3 / self.slowed
                    if count > 0 and time == last == 0.0:
                        raise SysidError(
                            f"{self.path}: the frames carry no time stamps. Wrap the film into an MP4 file, "
                            "or give its frame rate with --rate."
                        )
                    last = time
                    if self.progress is not None and self.announced:
                        what = f"{self.path.name}: {'reading' if every == 1 else 'looking through'}"
                        self.progress(what, min(count / self.announced, 1.0))
                    yield Frame(count, time, np.asarray(picture, np.uint8))
                count += 1
        missing = self.announced - count
        if missing > max(2, MAX_MISSING_SHARE * self.announced):
            raise SysidError(
                f"{self.path}: the file announces {self.announced} frames and ends after {count}: it is cut off. "
                "Copy it again from the camera."
            )

    def row_share(self, points: Array) -> Array:
        """Return when, from 0 to 1 of the read-out, the sensor reads points (n, N, 2) [px]; shape (n, N)."""
        across, down = points[..., 0] / self.width, points[..., 1] / self.height
        return {0: down, 90: 1 - across, 180: 1 - down, 270: across}[self.rotation]


def ahead(items: Generator[Item], count: int) -> Generator[Item]:
    """Yield items; up to `count` of the next ones are made in a thread while one is worked on."""
    with closing(items), ThreadPoolExecutor(1) as pool:
        waiting = deque(pool.submit(next, items, None) for _ in range(count))
        try:
            while (item := waiting.popleft().result()) is not None:
                waiting.append(pool.submit(next, items, None))
                yield item
        finally:
            pool.shutdown(cancel_futures=True)


def open_clip(path: Path, progress: Callable[[str, float], None] | None = None) -> Clip:
    """Check that a file is a film that can be read, without decoding more than one frame.

    Args:
        path: The file.
        progress: Told which share of the film was decoded, whenever it is.

    Raises:
        SysidError: It is missing, not a film, has no pictures (audio only), or too large ones.
    """
    if not path.is_file():
        raise SysidError(f"{path}: no such file. Check the name.")
    if path.stat().st_size == 0:
        raise SysidError(f"{path}: the file is empty. Copy it again from the camera.")
    with _quiet(), _opened(path) as capture:
        width, height = (
            int(capture.get(prop)) for prop in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        if width <= 0 or height <= 0:
            raise SysidError(f"{path}: no pictures in it (sound only?). Give the film of the board.")
        if max(width, height) > MAX_SIZE[0] or min(width, height) > MAX_SIZE[1]:
            raise SysidError(
                f"{path}: pictures of {width}x{height} are larger than {MAX_SIZE[0]}x{MAX_SIZE[1]}. Film in 4K or "
                "less: a higher frame rate tells more than more pixels."
            )
        said = read_container(path)
        if said.ramped:
            raise SysidError(
                f"{path}: parts of it play faster or slower than others (a speed ramp of slow motion): its times are not those "
                "of the board. Give the film as the camera took it, not as it was edited."
            )
        announced = max(0, int(said.shown * capture.get(cv2.CAP_PROP_FRAME_COUNT)))
        slowed = (said.capture_rate or 0.0) / max(float(capture.get(cv2.CAP_PROP_FPS)), 1e-9)
        if abs(slowed - round(slowed)) < 0.05 * slowed:  # the mean rate suffers from the last frame's length
            slowed = float(round(slowed))
        rotation = int(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 360
        letters = max(0, int(capture.get(cv2.CAP_PROP_FOURCC))).to_bytes(8, "little")[:4]
        codec = letters.decode("ascii", "ignore").strip("\0 ").upper()
        good, picture = capture.read()
    if not good:
        raise SysidError(f"{path}: no frame can be decoded; the file is damaged or empty. Copy it again.")
    turned = rotation if rotation % 90 == 0 else 0
    return Clip(
        path,
        picture.shape[1],
        picture.shape[0],
        turned,
        announced,
        codec,
        slowed if slowed > SLOW_MOTION else 1.0,
        progress,
        said.readout,
    )


def crop(picture: Picture, box: Box) -> tuple[Picture, tuple[int, int]]:
    """Cut left, top, right, bottom [px] out of a picture, as far as it reaches; return part and corner.

    The picture is of shape (height, width) or (height, width, 3), and so is the part.
    """
    left, top = max(box[0], 0), max(box[1], 0)
    right, bottom = min(box[2], picture.shape[1]), min(box[3], picture.shape[0])
    return picture[top : max(bottom, top), left : max(right, left)], (left, top)


def grey(picture: Picture) -> Picture:
    """Return a picture (height, width, 3) or (height, width) in grey [grey levels], shape (height, width)."""
    if picture.ndim == 2 or not picture.size:
        return picture.reshape(picture.shape[:2])
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)


def halved(picture: Picture, side: int) -> tuple[Picture, int]:
    """Halve a picture, shape (h, w) or (h, w, 3), until its longer side is at most `side` [px]; return it, and the film's px in one of it."""
    scale = 1
    while (
        max(picture.shape[:2]) > side
    ):  # by two at a time: OpenCV does that many times faster than all at once
        picture = np.asarray(
            cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8
        )
        scale *= 2
    return picture, scale


@contextmanager
def _opened(path: Path) -> Generator[cv2.VideoCapture]:
    try:
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    except cv2.error as error:
        raise SysidError(f"{path}: not a film that can be read ({error.err}).") from error
    try:
        if not capture.isOpened():
            raise SysidError(
                f"{path}: not a film that can be read: no pictures in it, cut off before its index, or "
                "another kind of file. Copy it again from the camera, or convert it to MP4."
            )
        yield capture
    finally:
        capture.release()


@contextmanager
def _quiet() -> Generator[None]:
    """Keep FFmpeg's and OpenCV's own complaints off the terminal: ours says what to do."""
    level = cv2.utils.logging.getLogLevel()
    before = os.environ.get("OPENCV_FFMPEG_LOGLEVEL")
    os.environ["OPENCV_FFMPEG_LOGLEVEL"] = "-8"
    cv2.utils.logging.setLogLevel(0)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
        if before is None:
            del os.environ["OPENCV_FFMPEG_LOGLEVEL"]
        else:
            os.environ["OPENCV_FFMPEG_LOGLEVEL"] = before
