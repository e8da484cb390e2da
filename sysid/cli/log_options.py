"""Options of every command that takes a log."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from sysid.cli.console import Printer
from sysid.errors import HuskyError
from sysid.logs import LogOptions, read_roll
from sysid.roll import Release, Roll
from sysid.same_log import refuse_twice
from sysid.video.options import VideoOptions, is_film
from sysid.video.trackers import Method


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class VideoArguments:
    """How a film is read, where the inference needs help."""

    method: Annotated[Method, Parameter(name="--method")] = "auto"
    """Film: what to follow."""
    roi: Annotated[tuple[int, int, int, int] | None, Parameter(name="--roi", negative="")] = None
    """Film: left, top, width and height in px of where the board moves."""
    calibration: Annotated[Path | None, Parameter(name="--calibration")] = None
    """Film: camera calibration, a file or a film of a chessboard."""
    readout: Annotated[float | None, Parameter(name="--readout")] = None
    """Film: time from the sensor's first to its last row in s; 0 for a global shutter."""
    camera_angle: Annotated[
        tuple[float, float] | None, Parameter(name="--camera-angle", negative="", allow_leading_hyphen=True)
    ] = None
    """Film: where the deck's axis points, to the right and down from the line of sight, in degrees."""
    pivot: Annotated[
        tuple[float, float] | None, Parameter(name="--pivot", negative="", allow_leading_hyphen=True)
    ] = None
    """Film: point in px that a single dot turns about."""
    no_shake: Annotated[bool, Parameter(name="--no-shake", negative="")] = False
    """Film: the camera stands still; take no shake out."""
    front: Annotated[bool, Parameter(name="--front", negative="")] = False
    """Film: taken from the front of the board, not from behind."""
    overlay: Annotated[Path | None, Parameter(name="--overlay")] = None
    """Film: write one in which what was followed is drawn."""

    @property
    def options(self) -> VideoOptions:
        """The same, with angles in rad."""
        angle = self.camera_angle
        if angle is not None and not max(map(abs, angle)) <= STEEPEST:
            raise HuskyError(
                f"--camera-angle {angle[0]:g} {angle[1]:g}: expected degrees of at most {STEEPEST:g} to either side; "
                "from farther aside a deck shows its roll too little to be measured."
            )
        return VideoOptions(
            method=self.method,
            roi=self.roi,
            calibration=self.calibration,
            readout=self.readout,
            camera_angle=None if angle is None else (math.radians(angle[0]), math.radians(angle[1])),
            pivot=self.pivot,
            no_shake=self.no_shake,
            front=self.front,
            overlay=self.overlay,
        )


STEEPEST = 45.0
"""Largest angle between the line of sight and the deck's axis [deg]."""
_NO_VIDEO = VideoArguments()


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class LogArguments:
    """How a log is read, where the inference needs help; and which part of it counts."""

    column: Annotated[str | None, Parameter(name="--column")] = None
    """Column with the roll angle or rate: its name, or its number counted from 1."""
    unit: Annotated[str | None, Parameter(name="--unit")] = None
    """Its unit (rad, deg, rad/s, deg/s, ...), or the size of one count in rad or rad/s."""
    axis: Annotated[str | None, Parameter(name="--axis", allow_leading_hyphen=True)] = None
    """Sensor axis that points forward (x, -y, ...), or the angle to take (roll, -pitch, ...)."""
    rate: Annotated[float | None, Parameter(name="--rate")] = None
    """Sampling rate in Hz, for a log without a usable time column."""
    time_column: Annotated[str | None, Parameter(name="--time-column")] = None
    """Column with the time: its name, or its number counted from 1."""
    source: Annotated[Literal["auto", "angle", "gyro", "imu", "quaternion"], Parameter(name="--source")] = (
        "auto"
    )
    """What to make roll from, where a log holds several."""
    lever_arm: Annotated[
        tuple[float, float, float] | None,
        Parameter(name="--lever-arm", negative="", allow_leading_hyphen=True),
    ] = None
    """From the tilt axis to the accelerometer, along the sensor's x y z, in m; estimated if left out."""
    start: Annotated[float | None, Parameter(name="--from")] = None
    """Ignore the log before this time in s."""
    stop: Annotated[float | None, Parameter(name="--to")] = None
    """Ignore the log after this time in s."""
    release: Annotated[tuple[float, ...], Parameter(name="--release", negative="")] = ()
    """Time of a release in s, instead of finding it; repeat it for several."""
    video: VideoArguments = _NO_VIDEO

    @property
    def options(self) -> LogOptions:
        """The part that reading needs."""
        return LogOptions(
            column=self.column,
            unit=self.unit,
            axis=self.axis,
            rate=self.rate,
            time_column=self.time_column,
            source=self.source,
            lever_arm=self.lever_arm,
            video=self.video.options,
        )


def keep_logs(
    logs: Iterable[Path],
    arguments: LogArguments,
    printer: Printer,
    outputs: Mapping[str, Path | None] | None = None,
) -> None:
    """Refuse to write over a measurement.

    Args:
        logs: The measurements; the camera's calibration is kept as well.
        arguments: Names the overlay that reading a film writes.
        printer: Names the JSON.
        outputs: What else the command writes, by option.

    Raises:
        HuskyError: An output is a log.
    """
    calibration = arguments.video.calibration
    inputs = [*logs, *(() if calibration is None else (calibration,))]
    printer.keep(inputs, {"--overlay": arguments.video.overlay, **(outputs or {})})


def unused_options(log: Path, arguments: LogArguments) -> list[str]:
    """Return the options given that the other kind of log takes."""
    given, usual = (arguments, LogArguments()) if is_film(log) else (arguments.video, _NO_VIDEO)
    names = ("column", "unit", "axis", "time_column", "source", "lever_arm")
    if not is_film(log):
        names = tuple(field.name for field in fields(VideoArguments))
    return ["--" + name.replace("_", "-") for name in names if getattr(given, name) != getattr(usual, name)]


def load_roll(log: Path, arguments: LogArguments, printer: Printer) -> Roll:
    """Read one log and say on stderr what was inferred and what is wrong with it.

    Raises:
        HuskyError: The log cannot be read as roll, or would be overwritten.
    """
    keep_logs([log], arguments, printer)
    if unused := unused_options(log, arguments):
        kind = "a film" if is_film(log) else "no film"
        printer.warn(f"{log}: not used: {', '.join(unused)}; this is {kind}")
    roll = read_roll(log, arguments.options)
    say_notes(log, roll, printer)
    return roll


def say_notes(log: Path, roll: Roll, printer: Printer) -> None:
    """Say on stderr what was inferred while reading a log, and what is wrong with it."""
    printer.note(f"{log}: " + "; ".join(roll.notes))
    for warning in roll.warnings:
        printer.warn(f"{log}: {warning}")


def load_releases(logs: Sequence[Path], arguments: LogArguments, printer: Printer) -> list[Release]:
    """Read logs and return the free decays in all of them.

    Raises:
        HuskyError: A log cannot be read, holds no free decay, was given twice, or would be overwritten.
    """
    from sysid.releases import find_releases

    if not logs:
        raise HuskyError("no log was given.")
    keep_logs(logs, arguments, printer)
    refuse_twice(logs)
    releases: list[Release] = []
    for log in logs:
        roll = load_roll(log, arguments, printer)
        releases += find_releases(
            roll, start=arguments.start, stop=arguments.stop, releases=arguments.release
        )
    return releases
