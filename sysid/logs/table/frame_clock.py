"""A clock from the numbers of frames, where the head of a file says how many are in a second."""

from collections.abc import Sequence
from dataclasses import replace

from sysid.logs.table.file import LogFile
from sysid.logs.table.names import parse_column
from sysid.roll import Array

FRAME = "frame"
"""What motion capture calls the column that counts its pictures."""


def with_frame_clock(log: LogFile, rate: float) -> LogFile:
    """Return a log whose column of frames stands for time [s]; the log itself where it has a clock or no frames.

    Args:
        rate: Frames a second [Hz].
    """
    frame = next((name for name in log.names if name.lower() == FRAME), None)
    if frame is None or any(parse_column(name, log.units.get(name)).kind == "time" for name in log.names):
        return log
    clock = f"time of {frame}"

    def read(names: Sequence[str]) -> dict[str, Array]:
        data = log.read([frame if name == clock else name for name in names])
        return {name: data[frame] / rate if name == clock else data[name] for name in names}

    return replace(
        log, names=tuple(clock if name == frame else name for name in log.names), units={**log.units, clock: "s"},
        notes=(*log.notes, f"time: frames at {rate:g} Hz, as the head of the file says"), read=read,
    )  # fmt: skip
