"""Roll of the deck against time, and its free decays.

Sign, everywhere: x forward, y left, z up. Roll is the rotation about +x, so positive roll is right edge down. The tilt joint of our
MJCF turns about +x too, so its position is the roll. The paper's tilt turns about -x (γ = -roll); only `sim/skate` uses that sign.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def shown(time: float) -> str:
    """Return a time [s] of a log in words, as for `--from`, `--to` and `--release`."""
    return f"{time:.4g} s" if abs(time) < 1000 else f"{time:.1f} s"


Rows = slice | npt.NDArray[np.bool_] | npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False, weakref_slot=True)
class Signal:
    """Roll against time, with the facts of its sensor."""

    log: str
    """Path of the log, as the user named it."""
    time: Array
    """Time on the log's clock [s], shape (n,), strictly increasing."""
    roll: Array
    """Roll [rad], shape (n,), unwrapped, not shifted by the rest angle."""
    std: Array
    """Standard deviation of each sample [rad], shape (n,), without an offset common to all."""
    rate: Array | None = None
    """Roll rate [rad/s] of a gyro, shape (n,), or None."""
    rate_std: Array | None = None
    """Standard deviation of each sample of `rate` [rad/s], shape (n,)."""
    own_std: Array | None = None
    """Share of `std` that is not common to all samples [rad], shape (n,), or None. A lens or a slant stretches or skews
    a whole swing, with little influence on its frequency and damping."""
    scale_std: float = 0.0
    """Standard deviation of the scale of roll and rate [1], one factor for all samples: the estimated gain of a gyro."""
    origin: str
    """Source of the roll, in words; the three facts below follow from it."""
    zero: Literal["known", "constant", "drifting"] = "known"
    """Zero of roll: that of the joint, an unknown constant, or one that differs from release to release."""
    measured: Literal["roll", "rate"] = "roll"
    """Signal with independent errors: the roll, or the rate, with the roll as its integral."""
    errors_last: bool = False
    """Whether errors are correlated until the deck has moved on (see `sysid.noise.lasting`)."""

    @property
    def slides(self) -> bool:
        """Whether it is the position of a slide [m], by the unit of the log."""
        return self.origin in ("position", "speed")

    def __repr__(self) -> str:
        """Return kind, log, source and number of samples."""
        span = f"{shown(float(self.time[0]))} to {shown(float(self.time[-1]))}" if len(self.time) else "empty"
        return f"<{type(self).__name__} of {self.log}: {self.origin}, {len(self.time)} samples, {span}>"

    def __getitem__(self, rows: Rows) -> Self:
        """Return these samples of every array."""
        names = ("time", "roll", "std", "rate", "rate_std", "own_std", "free")
        arrays = ((name, getattr(self, name, None)) for name in names)
        parts: dict[str, Any] = {name: array[rows] for name, array in arrays if array is not None}
        if extra := getattr(self, "extra", None):
            parts["extra"] = {name: column[rows] for name, column in extra.items()}
        return replace(self, **parts)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Roll(Signal):
    """One log's roll."""

    free: npt.NDArray[np.bool_] | None = None
    """Samples without motor, brake or hand, from a column of the log, shape (n,); None without such a column."""
    notes: tuple[str, ...] = ()
    """Facts inferred while reading (column, unit, sampling rate, clock repairs), in words."""
    warnings: tuple[str, ...] = ()
    """Problems of the log, in words."""
    unit_size: float = 1.0
    """One unit of the column with the angle or position [rad or m]; 1 for a roll that is computed from others."""
    extra: Mapping[str, Array] = field(default_factory=dict[str, Array])
    """Other columns of the log by name, shape (n,) each, in the log's units: those of `LogOptions.also`."""

    @property
    def sampling_rate(self) -> float:
        """Median sampling rate [Hz]."""
        return float(1.0 / np.median(np.diff(self.time)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Release(Signal):
    """One free decay: the part of a log between the release and rest, catch or the log's end."""

    number: int
    """Counted from 1 within its log."""
    rest: float
    """Roll at rest, as first estimated from the log [rad]."""
    hold: float
    """Duration of the hold before the release [s]; 0 without one."""
    end: Literal["rest", "caught", "log"]
    """Its end: the deck came to rest, somebody caught it, or the log stops."""
    held: Signal | None = None
    """Samples of the hold before, without the moment of the release, at most as long as the decay; None without a hold."""
    known: Mapping[str, float] = field(default_factory=dict[str, float])
    """Parameters of this release that differ from the record, by name: inertia [kg*m^2] and weight of a robot's joint in its pose and
    with its load."""

    driven_until: float | None = None
    """End of a driven motion before this release [s]; None without one."""

    @classmethod
    def of(
        cls, part: Signal, *, number: int, rest: float, hold: float, end: Literal["rest", "caught", "log"],
        held: Signal | None = None,
    ) -> "Release":  # fmt: skip
        """Return a part of a log as a free decay."""
        shared = {one.name: getattr(part, one.name) for one in fields(Signal)}
        return cls(**shared, number=number, rest=rest, hold=hold, end=end, held=held)

    @property
    def start(self) -> float:
        """Time of the release on the log's clock [s]."""
        return float(self.time[0])

    @property
    def side(self) -> Literal["right", "left"]:
        """The edge that was down when the deck was let go."""
        return "right" if self.roll[0] > self.rest else "left"

    @property
    def amplitude(self) -> float:
        """First amplitude about rest [rad], positive."""
        return float(np.abs(self.roll[0] - self.rest))
