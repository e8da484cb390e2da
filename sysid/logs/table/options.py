"""Options that override inferences of reading a log."""

from dataclasses import dataclass

from sysid.video.options import VideoOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class LogOptions:
    """Options that override inferences of reading a log."""

    column: str | None = None
    """The column to read roll from: its name, or its number counted from 1."""
    unit: str | None = None
    """The column's unit ('deg', 'rad/s', ...), or the size of one count in rad (or rad/s for a rate)."""
    axis: str | None = None
    """The sensor axis that points forward: 'x', '-y', ...; for angles also 'roll', 'pitch', 'yaw'."""
    rate: float | None = None
    """Sampling rate [Hz]: replaces the time column."""
    time_column: str | None = None
    """The column of time: its name, or its number counted from 1."""
    source: str = "auto"
    """Source of roll in a log that holds several: 'auto', or a name of `sysid.logs.sources`."""
    lever_arm: tuple[float, float, float] | None = None
    """From the tilt axis to the accelerometer, in sensor axes [m]; None estimates it."""
    also: tuple[str, ...] = ()
    """Other columns to read beside the motion into `Roll.extra`: their names, or their numbers counted from 1."""
    keep_outliers: bool = False
    """Whether lone samples far beside their neighbours are kept; films have a rule of their own."""
    start: float | None = None
    """Samples before this time [s] are read, but tell nothing of the sensor."""
    stop: float | None = None
    """The same for samples after this time [s]."""
    video: VideoOptions | None = None
    """How a film is read; its `rate` is the one above."""
