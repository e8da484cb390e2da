"""Options that override inferences of reading a log."""

from dataclasses import dataclass

from sysid.video.options import VideoOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class LogOptions:
    """Options that override inferences of reading a log."""

    column: str | None = None
    """Column with the angle or rate: its name, or its number counted from 1."""
    unit: str | None = None
    """Its unit (rad, deg, rad/s, deg/s, ...), or the size of one count in rad or rad/s."""
    axis: str | None = None
    """The sensor axis that points forward: 'x', '-y', ...; for angles also 'roll', 'pitch', 'yaw'."""
    rate: float | None = None
    """Sampling or film frame rate in Hz, if that of the file is missing or wrong (slow motion)."""
    time_column: str | None = None
    """Column with the time: its name, or its number counted from 1."""
    source: str = "auto"
    """Source of roll in a log that holds several: 'auto', or a name of `sysid.logs.sources`."""
    lever_arm: tuple[float, float, float] | None = None
    """From the tilt axis to the accelerometer, in sensor axes [m]; None estimates it."""
    also: tuple[str, ...] = ()
    """Other columns to read beside the motion into `Roll.extra`: their names, or their numbers counted from 1."""
    keep_outliers: bool = False
    """Keep isolated outliers, which are left out by default; films have a rule of their own."""
    start: float | None = None
    """Samples before this time [s] are read, but tell nothing of the sensor."""
    stop: float | None = None
    """The same for samples after this time [s]."""
    video: VideoOptions | None = None
    """How a film is read; its `rate` is the one above."""
