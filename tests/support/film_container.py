"""The file of a test film: H.264 as phones write it, a stamp for each frame, and a phone held upright."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sysid.roll import Array

TICK = Fraction(1, 90_000)
"""Unit of the stamps [s]."""
Write = Callable[[npt.NDArray[np.uint8]], None]


@contextmanager
def film_writer(
    path: Path, size: tuple[int, int], stamps: Array, bits: float, fps: float
) -> Generator[Write]:
    """Yield what writes the next frame of a film, as a picture in the order blue, green, red.

    Phones encode as they film: no frames out of order, no look ahead, a whole picture each second. H.264 with so many bits a pixel, or
    Motion JPEG at a constant rate (.avi). The first of the stamps [s] is written as 0.
    """
    import av

    jpeg = path.suffix == ".avi"
    ticks = iter(np.round((stamps - stamps[0]) / float(TICK)).astype(int).tolist())
    rate = Fraction(fps).limit_denominator(1001)
    with av.open(str(path), "w") as file:
        if jpeg:
            stream = file.add_stream("mjpeg", rate=rate, options={"qmin": "2", "qmax": "2"})
            stream.pix_fmt = "yuvj420p"
        else:
            stream = file.add_stream(
                "libx264", rate=rate, options={"preset": "veryfast", "tune": "zerolatency"}
            )
            stream.time_base = stream.codec_context.time_base = TICK
            stream.bit_rate = round(bits * size[0] * size[1] * fps)
            stream.gop_size = round(fps)
        stream.width, stream.height = size
        stream.thread_count = 1  # the same film on every machine

        def write(picture: npt.NDArray[np.uint8]) -> None:
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            if not jpeg:
                frame.pts, frame.time_base = next(ticks), TICK
            file.mux(stream.encode(frame))

        yield write
        file.mux(stream.encode())


def turned(film: Path, path: Path, degrees: int) -> None:
    """Copy a film, marked as to be shown turned clockwise by 0, 90, 180 or 270 degrees."""
    import av

    with av.open(str(film)) as source, av.open(str(path), "w") as copy:
        stream = source.streams.video[0]
        same = copy.add_stream_from_template(stream)
        same.set_display_rotation(-degrees)
        for packet in source.demux(stream):
            if packet.dts is not None:  # the last one is empty
                packet.stream = same
                copy.mux(packet)
