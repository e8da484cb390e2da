"""Frames of a clip with the container's own time stamps, one at a time.

Films hold brightness pixel by pixel and colour at half the resolution. Nearly all of the work needs brightness alone, which
is used where the decoder left it. Colour is made of the parts that need it.
"""

from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import av
import cv2
import numpy as np
from av.error import FFmpegError

from sysid.errors import SysidError
from sysid.roll import Array
from sysid.video.types import Box, Picture

Item = TypeVar("Item")
MEMORY = 96_000_000
"""Bytes of pictures that are kept. Motion shows in two frames: 4K has 13e6 bytes a frame, 8K 50e6 and is refused."""
SURVEY_FRAMES = 40
"""Frames, spread over a film, in which something is looked for: a choice of time."""
MAX_MISSING_SHARE = 0.05
"""Share of a film's frames that may be missing at its end, or carry no later stamp than the one before [1]."""
NO_RATE_GUESS = {"fpsprobesize": "0"}
"""FFmpeg decodes up to 20 frames of a film as it opens it, to guess its rate: frames bring their own times."""
CAPTURE_RATE = "com.android.capture.fps"
READOUT = "com.apple.quicktime.camera.framereadouttimeinmicroseconds"
"""Notes of phones: the rate at which a film was taken [Hz], and the time for reading a frame [µs]."""
PLANES = "yuv420p"
"""How nearly all films hold pictures: 8 bits of brightness from 16 to 235, and chroma, 128 for grey, at half the resolution."""
TO_COLOUR = np.array([[1.164, 2.018, 0.0], [1.164, -0.391, -0.813], [1.164, 0.0, 1.596]])
"""Blue, green and red of brightness beyond black and chroma beyond grey (ITU-R BT.601)."""
TURNS = dict(
    zip(
        range(90, 360, 90),
        (cv2.ROTATE_90_CLOCKWISE, cv2.ROTATE_180, cv2.ROTATE_90_COUNTERCLOCKWISE),
        strict=True,
    )
)
"""Clockwise turns [deg] in OpenCV's names."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame, upright; or the part of it that was kept."""

    index: int
    time: float
    """The container's stamp since the film's first frame [s], of a film that plays slowly as it was filmed; NaN without a stamp."""
    picture: Picture
    """Brightness as films hold it, from 16 to 235, shape (height, width)."""
    chroma: tuple[Picture, Picture]
    """Blue and red beyond brightness in squares of 2x2 pixels, shape (height / 2, width / 2), rounded up."""
    corner: tuple[int, int] = (0, 0)
    """Left and top of the picture in the film's [px], both even."""
    shift: Array = field(default_factory=lambda: np.zeros(2))
    """How far a camera that shakes has shifted what stands still since the first frame [px], shape (2,)."""

    @property
    def box(self) -> Box:
        """Left, top, right and bottom of the picture in the film's [px]."""
        left, top = self.corner
        return left, top, left + self.picture.shape[1], top + self.picture.shape[0]

    @property
    def nbytes(self) -> int:
        """Memory that it takes [bytes]."""
        return sum(plane.nbytes for plane in (self.picture, *self.chroma))

    def part(self, box: Box) -> tuple[Picture, tuple[int, int]]:
        """Return the brightness in a box [px], as far as it was kept, and its corner in the film's picture; shape (height, width)."""
        left, top, right, bottom = self.within(box)
        x, y = self.corner
        return self.picture[top - y : bottom - y, left - x : right - x], (left, top)

    def cut(self, box: Box) -> "Frame":
        """Return the part of a box that was kept [px], up to a pixel larger: whole squares."""
        left, top, right, bottom = self.within(box)
        left, top = left - left % 2, top - top % 2
        x, y = left - self.corner[0], top - self.corner[1]
        picture = self.picture[y : bottom - self.corner[1], x : right - self.corner[0]]
        height, width = ((size + 1) // 2 for size in picture.shape)
        blue, red = (one[y // 2 : y // 2 + height, x // 2 : x // 2 + width] for one in self.chroma)
        return replace(self, picture=picture, chroma=(blue, red), corner=(left, top))

    @property
    def colour(self) -> Picture:
        """The picture in colour [grey levels], shape (height, width, 3)."""
        return in_colour(self.picture, self.chroma)

    def within(self, box: Box) -> Box:
        """Return the part of a box that was kept [px]."""
        left, top, right, bottom = self.box
        x, y = min(max(box[0], left), right), min(max(box[1], top), bottom)
        return x, y, max(min(box[2], right), x), max(min(box[3], bottom), y)


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
    """FFmpeg's name of the compression, e.g. h264, hevc, mjpeg, mpeg4."""
    slowed: float = 1.0
    """How many times slower it plays than it was filmed, as the file notes."""
    progress: Callable[[str, float], None] | None = None
    """Told which share of the film was decoded."""
    readout: float | None = None
    """Time from the sensor's first to its last row [s], as the phone notes it."""

    def frames(self) -> Generator[Frame]:
        """Decode the clip from its start.

        Raises:
            SysidError: The file ends before its announced length.
        """
        count, begin = 0, None
        for frame in _decoded(self.path):
            if begin is None and frame.pts is not None:
                begin = frame.time
            time = np.nan if begin is None or frame.pts is None else (frame.time - begin) / self.slowed
            if self.progress is not None and self.announced:
                self.progress(f"{self.path.name}: reading", min(count / self.announced, 1.0))
            yield Frame(count, time, *_planes(frame, self.rotation))
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

    Raises:
        SysidError: It is missing, not a film, has no pictures (audio only), or too large ones.
    """
    if not path.is_file():
        raise SysidError(f"{path}: no such file. Check the name.")
    try:
        with av.open(str(path)) as film:
            stream = next(iter(film.streams.video), None)
            if stream is None or not stream.codec_context.width:
                raise SysidError(f"{path}: no pictures in it (sound only?). Give the film of the board.")
            width, height = stream.codec_context.width, stream.codec_context.height
            # A frame has one byte for each pixel, and two for the colour of four.
            if 3 * width * height > MEMORY:
                raise SysidError(
                    f"{path}: pictures of {width}x{height} are larger than 4K. Film in 4K or less: a higher frame rate tells more than "
                    "more pixels."
                )
            rate = float(stream.average_rate or 0)
            # Frames that an edit list leaves out are still in the file. Without an index the length tells.
            shown = sum(not entry.is_discard for entry in stream.index_entries)
            announced = shown if stream.frames else round((film.duration or 0) / av.time_base * rate)
            slowed = _noted(film.metadata, CAPTURE_RATE) / max(rate, 1e-9)
            readout = 1e-6 * _noted(film.metadata, READOUT)
            codec = stream.codec_context.name
    except FFmpegError as error:
        raise SysidError(
            f"{path}: not a film that can be read: no pictures in it, cut off before its index, or "
            "another kind of file, or empty. Copy it again from the camera, or convert it to MP4."
        ) from error
    with closing(_decoded(path)) as frames:
        first = next(frames, None)
    if first is None:
        raise SysidError(f"{path}: no frame can be decoded; the file is damaged or empty. Copy it again.")
    if abs(slowed - round(slowed)) < 0.05 * slowed:  # the mean rate suffers from the last frame's length
        slowed = float(round(slowed))
    turned = -first.rotation % 360
    turned = turned if turned % 90 == 0 else 0
    size = (first.width, first.height) if turned % 180 == 0 else (first.height, first.width)
    return Clip(
        path, *size, turned, announced, codec, slowed if round(slowed) > 1 else 1.0, progress, readout if 0 < readout * rate <= 1 else None
    )  # fmt: skip


def _decoded(path: Path) -> Generator[av.VideoFrame]:
    """Yield the frames of a film as far as they can be decoded."""
    try:
        with av.open(str(path), options=NO_RATE_GUESS) as film:
            stream = film.streams.video[0]
            stream.thread_type = "AUTO"
            for packet in film.demux(stream):
                with suppress(FFmpegError):  # damage costs its own frames only
                    yield from packet.decode()
    except FFmpegError:  # the caller counts the frames that are missing
        return


def _planes(frame: av.VideoFrame, rotation: int) -> tuple[Picture, tuple[Picture, Picture]]:
    """Return brightness and chroma of a frame, upright; where the decoder left them, if it is not to be turned."""
    if frame.format.name != PLANES:
        frame = frame.reformat(format=PLANES, dst_color_range="MPEG")
    some: list[Picture] = []
    for plane in frame.planes:
        buffer: Any = plane  # its stubs do not know that it is one
        whole = np.frombuffer(buffer, np.uint8).reshape(plane.height, plane.line_size)[:, : plane.width]
        some.append(np.asarray(cv2.rotate(whole, TURNS[rotation]), np.uint8) if rotation else whole)
    bright, blue, red = some
    return bright, (blue, red)


def _noted(metadata: dict[str, str], name: str) -> float:
    """Return a number that the phone notes; 0 where it notes none."""
    try:
        number = float(metadata.get(name, 0))
    except ValueError:
        return 0.0
    return number if 0 < number < np.inf else 0.0


def box_about(places: Array, margin: float) -> Box:
    """Return left, top, right and bottom of places (m, 2) and a margin about them, all [px]; it may reach out of the picture."""
    left, top = np.floor(places.min(axis=0) - margin).astype(int).tolist()
    right, bottom = np.ceil(places.max(axis=0) + margin).astype(int).tolist()
    return left, top, right, bottom


def in_colour(bright: Picture, chroma: Sequence[Picture]) -> Picture:
    """Return blue, green and red [grey levels], shape (h, w, 3), of brightness (h, w) and chroma of full or half resolution."""
    planes = [cv2.resize(one, bright.shape[::-1], interpolation=cv2.INTER_NEAREST) for one in chroma]
    grey = np.array([[16], [128], [128]])
    turn = np.hstack([TO_COLOUR, -TO_COLOUR @ grey])
    return np.asarray(cv2.transform(cv2.merge([bright, *planes]), turn), np.uint8)


def halved(picture: Picture, side: int) -> tuple[Picture, int]:
    """Halve a picture, shape (h, w) or (h, w, 3), down to a longer side of `side` [px]; return it and the factor."""
    scale = 1
    while (
        max(picture.shape[:2]) > side
    ):  # by two at a time: OpenCV does that many times faster than all at once
        picture = np.asarray(
            cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8
        )
        scale *= 2
    return picture, scale
