"""A recording: one log's roll, the releases in it, and the notes and warnings of reading it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from sysid.errors import SysidError
from sysid.files import sha256
from sysid.logs.read import read_roll
from sysid.logs.table.options import LogOptions
from sysid.releases.clear import clear_of_noise
from sysid.releases.extrema import half_cycles_of, smooth_signal
from sysid.releases.find import find_releases
from sysid.releases.phases import Phase, log_phases
from sysid.roll import Release, Roll, shown
from sysid.text import display
from sysid.video.options import VideoOptions

if TYPE_CHECKING:
    import pandas as pd

EARLY_RELEASE_SHARE = 0.1
"""Share of the hold by which a release may be given too early without a word."""
FOREIGN_ZERO_RATIO = 3.0
"""Distance of the rest from zero, over the widest swing, from which that zero is the sensor's and not the joint's: a choice. Whoever
tilts a joint by hand goes through a good part of what it can do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A log or film of a rocking board, read."""

    roll: Roll
    """Roll against time, the whole log."""
    releases: tuple[Release, ...]
    """The free decays in it, in order of time, at least one."""

    @classmethod
    def read(
        cls,
        path: str | Path,
        *,
        column: str | None = None,
        unit: str | None = None,
        axis: str | None = None,
        rate: float | None = None,
        time_column: str | None = None,
        source: str = "auto",
        lever_arm: tuple[float, float, float] | None = None,
        keep_outliers: bool = False,
        video: VideoOptions | None = None,
        start: float | None = None,
        stop: float | None = None,
        release: Sequence[float] = (),
        keep_zero: bool = False,
    ) -> Self:
        """Read a log or film and find the releases in it; what is not given is inferred.

        Args:
            path: CSV, Parquet, MCAP, phone export (zip or folder) or video.
            column: Column with the roll angle or rate: its name, or its number counted from 1.
            unit: Its unit ('deg', 'rad/s', ...), or the size of one count in rad or rad/s.
            axis: Sensor axis that points forward ('x', '-y', ...), or the angle to take ('roll', ...).
            rate: Sampling or film frame rate [Hz], where the file's own is missing or wrong.
            time_column: Column with the time: its name, or its number counted from 1.
            source: What to make roll from, where a log holds several.
            lever_arm: From the tilt axis to the accelerometer, along the sensor's axes [m].
            keep_outliers: Keep lone samples far beside their neighbours, which are left out.
            video: How a film is read.
            start: Ignore the log before this time [s].
            stop: Ignore the log after this time [s].
            release: Times at which the deck was let go [s], instead of finding them.
            keep_zero: Count roll from the log's own zero, however far beside it the joint rests.

        Raises:
            SysidError: The file cannot be read as roll, or no free decay is in it.
        """
        options = LogOptions(
            column=column, unit=unit, axis=axis, rate=rate, time_column=time_column, source=source,
            lever_arm=lever_arm, keep_outliers=keep_outliers, start=start, stop=stop, video=video,
        )  # fmt: skip
        roll = read_roll(Path(path), options)
        return cls.of(roll, start=start, stop=stop, release=release, keep_zero=keep_zero)

    @classmethod
    def of(
        cls,
        roll: Roll,
        *,
        start: float | None = None,
        stop: float | None = None,
        release: Sequence[float] = (),
        keep_zero: bool = False,
    ) -> Self:
        """Find the releases in a roll that is in memory.

        An encoder counts from wherever it was mounted: where the joint rests far beside that zero, roll is counted from the rest.

        Args:
            start: Ignore the log before this time [s].
            stop: Ignore the log after this time [s].
            release: Times at which the deck was let go [s], instead of finding them.
            keep_zero: Count roll from the log's own zero all the same.

        Raises:
            SysidError: No free decay is in it.
        """
        found = tuple(find_releases(roll, start=start, stop=stop, releases=tuple(release)))
        held = tuple(
            f"at {given:.6g} s, where the release was said to be, the deck was still held: its decay begins at "
            f"{shown(one.start)}, when it leaves"
            for given, one in zip(sorted(release), found, strict=False)
            if one.hold and one.start - given > EARLY_RELEASE_SHARE * one.hold
        )
        driven = tuple(
            f"something drives it until {shown(one.driven_until)}: free from then on"
            for one in found
            if one.driven_until
        )
        recording = cls(roll=replace(roll, warnings=(*roll.warnings, *held, *driven)), releases=found)
        return recording if keep_zero else recording._from_rest()

    def _from_rest(self) -> Self:
        """Return the recording with roll counted from where the joint rests, if the log's own zero has nothing to do with it."""
        rest = float(np.median([release.rest for release in self.releases]))
        widest = max(release.amplitude for release in self.releases)
        if self.roll.zero != "known" or abs(rest) <= FOREIGN_ZERO_RATIO * widest:
            return self
        show = display(is_rate=False, slides=self.roll.slides)
        said = (
            f"the joint rests at {show.scale * rest:+.4g}{show.unit}, and its widest swing is {show(widest, 2)}: that zero is the "
            "sensor's. Roll is counted from the rest; --keep-zero leaves it as it is"
        )
        roll = replace(
            self.roll, roll=self.roll.roll - rest, zero="constant", warnings=(*self.roll.warnings, said)
        )
        releases = (
            replace(r, roll=r.roll - rest, rest=r.rest - rest, zero="constant") for r in self.releases
        )
        return replace(self, roll=roll, releases=tuple(releases))

    @property
    def path(self) -> Path:
        """The file, as it was named."""
        return Path(self.roll.log)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was inferred while reading: column, unit, clock, noise."""
        return self.roll.notes

    @property
    def warnings(self) -> tuple[str, ...]:
        """Problems of the log."""
        return self.roll.warnings

    @property
    def used(self) -> float:
        """Share of the motion in the log that is free decay [1]: of the way that the joint goes."""
        signal = smooth_signal(self.roll.time, self.roll.roll, float(np.median(self.roll.std)))
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

    def to_dataframe(self) -> "pd.DataFrame":
        """Return the roll as a table: time_s, roll_rad, roll_std_rad."""
        import pandas as pd

        return pd.DataFrame(
            {"time_s": self.roll.time, "roll_rad": self.roll.roll, "roll_std_rad": self.roll.std}
        )


Data = Recording | Release | Iterable[Recording | Release]
"""What every verb takes: a recording, several, or releases."""


def unpack(data: Data) -> tuple[tuple[Recording, ...], list[Release], list[str]]:
    """Return the recordings in what a verb was given, all releases that stand clear of their noise, and what is said of the others.

    Raises:
        SysidError: There is none, or a measurement was given twice.
    """
    items = [data] if isinstance(data, Recording | Release) else list(data)
    recordings = tuple(item for item in items if isinstance(item, Recording))
    refuse_duplicates(recording.path for recording in recordings)
    releases: list[Release] = []
    for item in items:
        releases += item.releases if isinstance(item, Recording) else [item]
    if not releases:
        raise SysidError("no release was given. Let the deck go and record until it rests.")
    return recordings, *clear_of_noise(releases)


def reading_warnings(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Return the warnings of some logs; where there are several, each names its log."""
    if len(recordings) == 1:
        return recordings[0].warnings
    return tuple(f"{recording.path}: {text}" for recording in recordings for text in recording.warnings)


def refuse_duplicates(logs: Iterable[Path]) -> None:
    """Accept logs that are different measurements: one given twice would count as new data.

    A copy under another name is told by its content; a folder, or a file that is not there, by its path only.

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
                f"{copy}: a measurement counts once, for a repeated one would narrow every interval without saying "
                "anything new. Leave one out, or record another."
            )
        seen[key] = log
