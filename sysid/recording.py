"""A recording: the roll of one log, its releases, and the notes and warnings of its reader."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypedDict, Unpack

import numpy as np
import numpy.typing as npt

from sysid.errors import SysidError, did_you_mean
from sysid.files import sha256
from sysid.logs.memory import table_of_arrays, table_of_frame
from sysid.logs.read import read_roll, roll_of_table
from sysid.logs.table.options import LogOptions
from sysid.releases.clear import clear_of_noise
from sysid.releases.extrema import half_cycles_of, smoothed
from sysid.releases.find import find_releases
from sysid.releases.phases import Phase, log_phases
from sysid.roll import Release, Roll, shown
from sysid.shown import MOST_SHOWN, Shown
from sysid.text import count, display
from sysid.video.options import VideoOptions

if TYPE_CHECKING:
    import pandas as pd

EARLY_RELEASE_SHARE = 0.1
"""A release given too early by this share of the hold gets a warning."""
FOREIGN_ZERO_RATIO = 3.0
"""Distance of the rest from zero, over the widest swing, from which the zero is that of the sensor: a choice. A hand tilts a joint
through a large part of its range."""


class PartOptions(TypedDict, total=False):
    """The part of a log that is used, as `Recording.read` explains it."""

    start: float | None
    stop: float | None
    release: Sequence[float]
    keep_zero: bool
    keep_outliers: bool


class ReadOptions(PartOptions, total=False):
    """Options of a log, as `Recording.read` explains them."""

    column: str | None
    unit: str | None
    axis: str | None
    rate: float | None
    time_column: str | None
    source: str
    lever_arm: tuple[float, float, float] | None
    video: VideoOptions | None


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Recording(Shown):
    """A log or film with the releases of a joint."""

    roll: Roll
    """Roll against time, the whole log."""
    releases: tuple[Release, ...]
    """The free decays in it, in order of time, at least one."""

    @classmethod
    def read(cls, path: str | Path, **options: Unpack[ReadOptions]) -> Self:
        """Read a log or film and find its releases; options left out are inferred.

        Args:
            path: CSV, Parquet, MCAP, phone export (zip or folder) or video.
            **options: By name:
                column: Column with the roll angle or rate: its name, or its number counted from 1.
                unit: Its unit ('deg', 'rad/s', ...), or the size of one count in rad or rad/s.
                axis: Sensor axis that points forward ('x', '-y', ...), or the angle to take ('roll', ...).
                rate: Sampling or film frame rate [Hz], if that of the file is missing or wrong.
                time_column: Column with the time: its name, or its number counted from 1.
                source: Sensor to use, if a log has several.
                lever_arm: From the tilt axis to the accelerometer, along the sensor's axes [m].
                keep_outliers: Keep isolated outliers.
                video: Options for a film.
                start: Ignore the log before this time [s].
                stop: Ignore the log after this time [s].
                release: Times at which the deck was let go [s], instead of finding them.
                keep_zero: Keep the log's own zero, even far from the rest of the joint.

        Raises:
            SysidError: The file cannot be read as roll, or contains no free decay.
        """
        return cls._found(partial(read_roll, Path(path)), options)

    @classmethod
    def from_arrays(
        cls,
        time: npt.ArrayLike,
        *,
        angle: npt.ArrayLike | None = None,
        rate: npt.ArrayLike | None = None,
        unit: str | None = None,
        name: str = "",
        **options: Unpack[PartOptions],
    ) -> Self:
        """Take a log from arrays and find the releases in it.

        Args:
            time: Time of each sample [s], shape (n,).
            angle: Angle of the joint, or position of a slide, in `unit`, shape (n,).
            rate: Its rate in `unit`, shape (n,), of a gyro, instead of the angle.
            unit: 'rad', 'deg', 'm' or 'mm'; of a rate 'rad/s', 'deg/s' or 'm/s'. SI if left out.
            name: Name of the log, for tables and messages.
            **options: `start`, `stop`, `release`, `keep_zero` and `keep_outliers`, as of `read`.

        Raises:
            SysidError: The arrays do not fit together, or contain no free decay.
        """
        table = table_of_arrays(time, angle=angle, rate=rate, unit=unit, name=name)
        return cls._found(partial(roll_of_table, table), options)

    @classmethod
    def from_dataframe(cls, frame: "pd.DataFrame", *, name: str = "", **options: Unpack[ReadOptions]) -> Self:
        """Take a log from a data frame; columns, units and axes are inferred as those of a file.

        Args:
            frame: Columns of numbers; an index other than the row numbers is a column too.
            name: Name of the log, for tables and messages.
            **options: As of `read`.

        Raises:
            SysidError: It is not a data frame, or contains no motion or no free decay.
        """
        return cls._found(partial(roll_of_table, table_of_frame(frame, name)), options)

    @classmethod
    def _found(cls, read: Callable[[LogOptions], Roll], options: Mapping[str, Any]) -> Self:
        """Return what a reader makes of a log, with its releases."""
        for name in options.keys() - ReadOptions.__annotations__.keys():
            raise SysidError(f"there is no option '{name}'.{did_you_mean(name, ReadOptions.__annotations__)}")
        of_log = {name: value for name, value in options.items() if name not in ("release", "keep_zero")}
        of_part = {
            name: options[name] for name in ("start", "stop", "release", "keep_zero") if name in options
        }
        return cls.of(read(LogOptions(**of_log)), **of_part)

    @classmethod
    def of(
        cls,
        roll: Roll,
        *,
        start: float | None = None,
        stop: float | None = None,
        release: Sequence[float] = (),
        keep_zero: bool = False,
        rest: float = 0.0,
    ) -> Self:
        """Find the releases in a roll that is in memory.

        The zero of an encoder depends on its mounting. If the log's rest is far from the joint's, roll counts from the joint's rest.

        Args:
            start: Ignore the log before this time [s].
            stop: Ignore the log after this time [s].
            release: Times at which the deck was let go [s], instead of finding them.
            keep_zero: Keep the log's own zero.
            rest: Rest of the joint in its record or model [rad or m]; an angle is shifted by whole turns to the nearest one.

        Raises:
            SysidError: It contains no free decay.
        """
        found = tuple(find_releases(roll, start=start, stop=stop, releases=tuple(release)))
        held = tuple(
            f"at {given:.6g} s, the given release, the deck was still held: its decay begins at "
            f"{shown(one.start)}, when it leaves"
            for given, one in zip(sorted(release), found, strict=False)
            if one.hold and one.start - given > EARLY_RELEASE_SHARE * one.hold
        )
        ends = dict.fromkeys(shown(one.driven_until) for one in found if one.driven_until)
        driven = [f"something drives it until {end}: free from then on" for end in ends]
        recording = cls(roll=replace(roll, warnings=(*roll.warnings, *held, *driven)), releases=found)
        turn = 0.0 if roll.slides else math.tau * round((rest - recording._rest) / math.tau)
        recording = recording._shifted(turn) if turn else recording
        return recording if keep_zero else recording._about(rest)

    @property
    def _rest(self) -> float:
        return float(np.median([release.rest for release in self.releases]))

    def _shifted(self, by: float, **changes: Any) -> Self:
        """Return the recording with every roll larger by a constant [rad or m]."""
        moved = (replace(one, roll=one.roll + by, rest=one.rest + by, **changes) for one in self.releases)
        roll = replace(self.roll, roll=self.roll.roll + by, **changes)
        return replace(self, roll=roll, releases=tuple(moved))

    def _about(self, rest: float) -> Self:
        """Return the recording with roll counted from the joint's rest, if the log's zero is not the joint's."""
        own, widest = self._rest, max(release.amplitude for release in self.releases)
        if self.roll.zero != "known" or abs(own - rest) <= FOREIGN_ZERO_RATIO * widest:
            return self
        show = display(is_rate=False, slides=self.roll.slides)
        said = (
            f"the joint rests at {show.scale * own:+.4g}{show.unit}, and its widest swing is {show(widest, 2)}: that zero is the "
            "sensor's. Roll is counted from the rest; --keep-zero keeps the sensor's zero"
        )
        found = self._shifted(rest - own, zero="constant")
        return replace(found, roll=replace(found.roll, warnings=(*found.roll.warnings, said)))

    @property
    def path(self) -> Path:
        """The file, as the user named it."""
        return Path(self.roll.log)

    @property
    def notes(self) -> tuple[str, ...]:
        """Facts inferred while reading: column, unit, clock, noise."""
        return self.roll.notes

    @property
    def warnings(self) -> tuple[str, ...]:
        """Problems of the log."""
        return self.roll.warnings

    @property
    def used(self) -> float:
        """Share of the joint's way in the log that is free decay [1]."""
        signal = smoothed(self.roll)
        free, whole = 0.0, 0.0
        for swing in half_cycles_of(signal):
            middle = float(signal.time[(swing.left + swing.reached) // 2])
            whole += swing.size
            free += swing.size * any(r.start <= middle <= r.time[-1] for r in self.releases)
        return free / whole if whole > 0 else 1.0

    @property
    def phases(self) -> tuple[Phase, ...]:
        """Phases of the log, without gaps: rest, held, free, caught."""
        return tuple(log_phases(self.roll, self.releases))

    def brief(self) -> str:
        """Return the log's name, its samples, and its releases."""
        roll = self.roll
        show = display(is_rate=False, slides=roll.slides)
        each = [
            f"{shown(one.start)} from {show.scale * (one.roll[0] - one.rest):+.3g}{show.unit}"
            for one in self.releases
        ]
        more = len(each) - MOST_SHOWN
        lines = [
            f"Recording {roll.log}: {roll.origin}, {len(roll.time)} samples at {roll.sampling_rate:.4g} Hz, "
            f"{count(len(each), 'release')}",
            *(f"  let go at {text}" for text in each[:MOST_SHOWN]),
            *([f"  and {more} more"] if more > 0 else []),
            *([f"  {count(len(self.warnings), 'warning')}: see .warnings"] if self.warnings else []),
        ]
        return "\n".join(lines)

    def to_dataframe(self) -> "pd.DataFrame":
        """Return the roll as a table: time_s, roll_rad, roll_std_rad."""
        import pandas as pd

        return pd.DataFrame(
            {"time_s": self.roll.time, "roll_rad": self.roll.roll, "roll_std_rad": self.roll.std}
        )


Data = Recording | Release | str | Path | Iterable[Recording | Release | str | Path]
"""Measured decays, as input of every verb: a recording, a release, the path of a log, or several of these."""


def unpack(data: Data) -> tuple[tuple[Recording, ...], list[Release], list[str]]:
    """Return the recordings of given data, all releases well above their noise, and a warning for each other one.

    Args:
        data: Input of a verb.

    Raises:
        SysidError: The data are empty, contain a measurement twice, or something other than a measurement.
    """
    items = _measured(data)
    recordings = tuple(item for item in items if isinstance(item, Recording))
    refuse_duplicates(recording.path for recording in recordings)
    releases: list[Release] = []
    for item in items:
        releases += item.releases if isinstance(item, Recording) else [item]
    if not releases:
        raise SysidError("no release was given. Let the deck go and record until it rests.")
    return recordings, *clear_of_noise(releases)


def _measured(data: Data) -> list[Recording | Release]:
    """Return the input of a verb as recordings and releases; paths are read.

    Raises:
        SysidError: An item is not a measurement.
    """
    items: list[Recording | Release] = []
    given: list[Any] = list(data) if isinstance(data, Iterable) and not isinstance(data, str) else [data]
    for item in given:
        if isinstance(item, str | Path):
            items.append(Recording.read(item))
        elif isinstance(item, Recording | Release):
            items.append(item)
        else:
            raise SysidError(
                f"a {type(item).__name__} is no measurement. The log comes first: a Recording (Recording.read, .from_arrays, "
                ".from_dataframe), one of its releases, or the path of a log; the joint comes second."
            )
    return items


def reading_warnings(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return the warnings of some logs; with several logs, each names its own."""
    if len(recordings) == 1:
        return recordings[0].warnings
    return tuple(f"{recording.path}: {text}" for recording in recordings for text in recording.warnings)


def refuse_duplicates(logs: Iterable[Path]) -> None:
    """Refuse a measurement that was given twice, which would count as new data.

    Files are compared by content, folders and missing files by path.

    Raises:
        SysidError: Two of the logs are the same.
    """
    files = list(logs)
    if len(files) < 2:
        return
    seen: dict[str, Path] = {}
    for log in files:
        key = sha256(log) if log.is_file() else str(log.resolve())
        first = seen.get(key)
        if first is not None:
            copy = f"{first} was given twice" if first == log else f"{first} and {log} hold the same bytes"
            raise SysidError(
                f"{copy}: a measurement counts once, as a repeated one would narrow every interval without new information. "
                "Leave one out, or record another."
            )
        seen[key] = log
