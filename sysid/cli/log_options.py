"""Options of every command that takes a log."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_type_hints

from cyclopts import Parameter

from sysid.cli.console import FILM, LOG, Printer
from sysid.errors import SysidError
from sysid.logs import LogOptions, read_roll
from sysid.logs.sources.registry import sources
from sysid.logs.table.remarks import about_and_text
from sysid.recording import Recording
from sysid.roll import Roll
from sysid.video.options import VideoOptions, is_film
from sysid.video.trackers import Method

_Pair = Annotated[tuple[float, float] | None, Parameter(allow_leading_hyphen=True)]
_Hidden = Annotated[None, Parameter(parse=False)]


@Parameter(name="*", group=FILM)
@dataclass(frozen=True, kw_only=True)
class VideoArguments(VideoOptions):
    """Options for reading a film."""

    method: Method = "auto"
    """Tracker of the film."""
    camera_angle: _Pair = None
    """Direction of the deck's axis from the line of sight, to the right and down, in degrees."""
    pivot: _Pair = None
    """Centre of rotation for a single dot, or for x and y of a table: in px, or in the table's unit."""
    rate: _Hidden = None
    progress: _Hidden = None

    @property
    def options(self) -> VideoOptions:
        """The same, with angles in rad."""
        given: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(VideoOptions)}
        angle = self.camera_angle
        if angle is not None:
            if not max(map(abs, angle)) < 90:
                raise SysidError(
                    f"--camera-angle {angle[0]:g} {angle[1]:g}: expected degrees within ±90; from the side no roll is visible."
                )
            given["camera_angle"] = tuple(map(math.radians, angle))
        return VideoOptions(**given)


_NO_VIDEO = VideoArguments()
if TYPE_CHECKING:
    _Source = str
else:
    _Source = Literal[("auto", *sources())]


@Parameter(name="*", group=LOG)
@dataclass(frozen=True, kw_only=True)
class LogArguments(LogOptions):
    """Options for reading a log, and the part of it to use."""

    axis: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None
    """Sensor axis that points forward (x, -y, ...), or the angle to take (roll, -pitch, ...)."""
    source: _Source = "auto"
    """Sensor to use, if the log holds several."""
    lever_arm: Annotated[tuple[float, float, float] | None, Parameter(allow_leading_hyphen=True)] = None
    """From the tilt axis to the accelerometer, along the sensor's x y z, in m; estimated if left out."""
    also: Annotated[tuple[str, ...], Parameter(parse=False)] = ()
    start: Annotated[float | None, Parameter(name="--from")] = None
    """Ignore the log before this time in s."""
    stop: Annotated[float | None, Parameter(name="--to")] = None
    """Ignore the log after this time in s."""
    release: Annotated[tuple[float, ...], Parameter(show_default=False)] = ()
    """Time of a release in s, instead of finding it; repeat it for several."""
    keep_zero: bool = False
    """Keep the log's own zero, even far from the rest of the joint."""
    video: VideoArguments = _NO_VIDEO

    @property
    def options(self) -> LogOptions:
        """The options of the reader."""
        given: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(LogOptions)}
        given["video"] = self.video.options
        return LogOptions(**given)

    def part(self, roll: Roll) -> Roll:
        """Return the part of a roll between --from and --to."""
        low = -math.inf if self.start is None else self.start
        high = math.inf if self.stop is None else self.stop
        rows = (roll.time >= low) & (roll.time <= high)
        if not rows.any():
            raise SysidError(
                f"{roll.log}: nothing between --from {self.start} and --to {self.stop}; it runs from {roll.time[0]:.4g} to "
                f"{roll.time[-1]:.4g} s."
            )
        return roll[rows]


def typed(group: Any) -> Iterator[str]:
    """Yield the options of a group other than the defaults, as typed."""
    hints = get_type_hints(type(group), include_extras=True)
    for option in fields(group):
        value, hint = getattr(group, option.name), hints[option.name]
        if isinstance(value, VideoArguments):
            yield from typed(value)
        elif value != option.default and option.name != "overlay":
            named = (one.name for one in get_args(hint) if isinstance(one, Parameter) and one.name)
            name, *_ = next(named, ("--" + option.name.replace("_", "-"),))
            repeated = "..." in str(hint)
            for one in value if repeated else (value,):
                yield name
                yield from () if one is True else map(str, one) if isinstance(one, tuple) else (str(one),)


def refuse_overwriting_logs(
    logs: Iterable[Path],
    arguments: LogArguments,
    printer: Printer,
    outputs: Mapping[str, Path | None] | None = None,
) -> None:
    """Refuse to overwrite a measurement.

    Args:
        logs: The measurements; the camera's calibration is protected too.
        arguments: They name the overlay, an output of reading a film.
        outputs: Other outputs of the command, by option.
    """
    calibration = arguments.video.calibration
    inputs = [*logs, *(() if calibration is None else (calibration,))]
    printer.keep(inputs, {"--overlay": arguments.video.overlay, **(outputs or {})})


def load_roll(log: Path, arguments: LogArguments, printer: Printer) -> Roll:
    """Read one log and print notes and warnings on stderr."""
    kind, given, usual = "a film", arguments, LogArguments()
    names = ["column", "unit", "axis", "time_column", "source", "lever_arm", "keep_outliers"]
    if not is_film(log):
        kind, given, usual = "no film", arguments.video, _NO_VIDEO
        names = [field.name for field in fields(VideoArguments) if field.name != "pivot"]
    if unused := [name for name in names if getattr(given, name) != getattr(usual, name)]:
        words = ", ".join("--" + name.replace("_", "-") for name in unused)
        printer.warn(f"{log}: not used: {words}; this is {kind}")
    options = arguments.options
    if is_film(log):
        from sysid.cli.bars import told_bar

        with told_bar(printer) as progress:
            video = replace(arguments.video.options, progress=progress)
            roll = read_roll(log, replace(options, video=video))
    else:
        roll = read_roll(log, options)
    say_notes(log, roll, printer)
    return roll


def say_notes(log: Path, roll: Roll, printer: Printer) -> None:
    """Print notes and warnings of reading a log on stderr."""
    pairs = [about_and_text(note) for note in roll.notes]
    widest = max((len(about) for about, _ in pairs), default=0)
    printer.note("\n".join((str(log), *(f"  {about:{widest}}  {text}" for about, text in pairs))))
    for warning in roll.warnings:
        printer.warn(f"{log}: {warning}")


def recording_of(
    roll: Roll, arguments: LogArguments, printer: Printer | None = None, *, rest: float = 0.0
) -> Recording:
    """Find the releases in the selected part of a roll, and print their problems on stderr."""
    from sysid.driven.columns import driving_input

    acted = driving_input(Path(roll.log)) if printer is not None and roll.free is None else None
    if printer is not None and acted is not None:
        kind, column = acted
        printer.warn(
            f"{roll.log}: '{column}' changes along the log. If it drove the joint, this is no free motion: run compare, fit or "
            f"diagnose with --input {column} --input-is {kind} (docs/driven.md)"
        )
    recording = Recording.of(
        roll, start=arguments.start, stop=arguments.stop, release=arguments.release, keep_zero=arguments.keep_zero,
        rest=rest,
    )  # fmt: skip
    if printer is not None:
        for warning in recording.warnings[len(roll.warnings) :]:
            printer.warn(f"{roll.log}: {warning}")
    return recording
