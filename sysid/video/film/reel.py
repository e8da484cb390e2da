"""A film that is decoded once: kept in memory until it shows what moves, from then on frame by frame."""

from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import cached_property

import cv2
import numpy as np

from sysid.errors import SysidError
from sysid.video.film.background import Background
from sysid.video.film.camera import Lens
from sysid.video.film.frames import MEMORY, SURVEY_FRAMES, Clip, Frame, ahead
from sysid.video.film.survey import Motion, Survey, box_around
from sysid.video.options import VideoOptions
from sysid.video.types import Box, Mask

MARGIN = 0.35
"""Margin about the part that has moved so far, in widths of it [1]: a tilted board will swing to the other side."""


@dataclass
class Reel:
    """The frames of a clip, with the camera's shake."""

    clip: Clip
    lens: Lens
    options: VideoOptions
    skipped: int = 0
    """Frames at the beginning that are not kept as nothing moves in them."""
    repeated: int = 0
    """Frames left out because their stamp was not later than the one before."""
    background: Background = field(init=False)
    _frames: list[Frame] = field(default_factory=list)
    _source: Generator[Frame] = field(init=False)
    _threads: int = field(init=False)

    def __post_init__(self) -> None:
        """Start to decode; OpenCV's own threads would only wait for each other beside those of the film."""
        self._threads = cv2.getNumThreads()
        cv2.setNumThreads(1)
        self._begin()

    def _begin(self) -> None:
        """Decode from the first frame on, with nothing in memory."""
        self._frames.clear()
        self.skipped = self.repeated = 0
        self.background = Background(self.lens, self.options.no_shake)
        self._source = ahead(self._held(ahead(self._stamped(), 2)), 1)

    @cached_property
    def region(self) -> Box | None:
        """Left, top, right and bottom [px] of where the user says the board moves: all that is kept of the frames.

        Raises:
            SysidError: It is too small or outside the picture.
        """
        if self.options.roi is None:
            return None
        left, top, width, height = self.options.roi
        inside = min(left, top) >= 0 and left + width <= self.clip.width and top + height <= self.clip.height
        if not inside or min(width, height) < 1:
            raise SysidError(
                f"--roi {left} {top} {width} {height}: left, top, width and height in px, "
                f"inside the picture of {self.clip.width}x{self.clip.height}."
            )
        return left, top, left + width, top + height

    @property
    def kept(self) -> list[Frame]:
        """The frames in memory: of the whole film, or until what moves was seen."""
        self.look  # noqa: B018  fills the memory
        return self._frames

    @cached_property
    def look(self) -> Survey:
        """What moves.

        Raises:
            SysidError: Nothing does, or the film is damaged or cut.
        """
        motion, part = self._fill(None, 1)
        moving = motion.mask(self.region)
        # A speck may have moved first: most of the motion must lie in the part that was kept, and shows that the board moves.
        most = moving.sum() / 2
        if part is not None and moving[part[1] : part[3], part[0] : part[2]].sum() < most:
            self._source.close()
            self._begin()
            motion, _ = self._fill(_with_margin(moving), round(most))
            moving = motion.mask(self.region)
        if not self._frames:
            raise SysidError(
                f"{self.clip.path}: no frame can be decoded. Copy the file again from the camera."
            )
        if motion.pans:
            raise SysidError(
                f"{self.clip.path}: the whole picture moves: the camera pans, zooms or is carried. Put it on a tripod, and film "
                "from before the release until the board rests."
            )
        if not moving.any():
            outside = f"what moves is all outside --roi {' '.join(map(str, self.options.roi or ()))}"
            raise SysidError(
                f"{self.clip.path}: {outside if motion.mask(None).any() else 'nothing moves in it'}. Film the whole release, with "
                f"the board in the picture of {self.clip.width}x{self.clip.height}, or give its region with --roi LEFT TOP WIDTH HEIGHT."
            )
        self.background.leave_out(moving)
        some = np.unique(np.linspace(0, len(self._frames) - 1, SURVEY_FRAMES).astype(int))
        return Survey(tuple(self._frames[number] for number in some), box_around(moving, 10), moving)

    def _fill(self, part: Box | None, least: int) -> tuple[Motion, Box | None]:
        """Keep frames until memory is full of the part that moves, at least `SURVEY_FRAMES`; return the motion and that part [px].

        An unknown part follows from the motion seen when whole frames fill the memory. It moves once `least` pixels change.
        """
        motion, size = Motion(), 0
        for number, frame in enumerate(self._source):
            motion.add(frame, *self.background.pose(number))
            self._frames.append(_cut(frame, part or self.region))
            size += self._frames[-1].nbytes
            if size < MEMORY or (part is not None and len(self._frames) < SURVEY_FRAMES):
                continue
            moving = motion.mask(self.region)
            if moving.sum() < least:
                self.skipped += len(self._frames) // 2
                del self._frames[: len(self._frames) // 2]
            elif part is None:
                part = _with_margin(moving)
                self._frames = [_cut(frame, part) for frame in self._frames]
            else:
                break
            size = sum(frame.nbytes for frame in self._frames)
        return motion, part

    def others(self) -> Iterator[Frame]:
        """Yield the frames after those in memory, as they are decoded."""
        return (frame if self.region is None else frame.cut(self.region) for frame in self._source)

    def close(self) -> None:
        """Stop decoding."""
        self._source.close()
        cv2.setNumThreads(self._threads)

    def _stamped(self) -> Generator[Frame]:
        last = -np.inf
        for frame in self.clip.frames():
            if self.options.rate is not None:
                frame = replace(frame, time=frame.index / self.options.rate)
            elif np.isnan(frame.time):
                raise SysidError(
                    f"{self.clip.path}: the frames carry no time stamps. Wrap the film into an MP4 file, "
                    "or give its frame rate with --rate."
                )
            if frame.time > last:
                last = frame.time
                yield frame
            else:
                self.repeated += 1

    def _held(self, frames: Generator[Frame]) -> Generator[Frame]:
        with closing(frames):
            for frame in frames:
                try:
                    shift = self.background.update(frame)
                except SysidError as error:
                    raise SysidError(f"{self.clip.path}: {error}") from None
                yield replace(frame, shift=shift)


def _with_margin(moving: Mask) -> Box:
    return box_around(moving, round(MARGIN * np.ptp(np.flatnonzero(moving.any(axis=0)))))


def _cut(frame: Frame, box: Box | None) -> Frame:
    if box is None:
        return frame
    part = frame.cut(box)
    blue, red = part.chroma
    return replace(part, picture=part.picture.copy(), chroma=(blue.copy(), red.copy()))
