"""A driven log: a motion, the input that drove it, and the load that the model puts on the joint along it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, Self

import numpy as np

from sysid.driven.motion import Motion
from sysid.errors import SysidError
from sysid.roll import Array, Roll

InputKind = Literal["torque", "force", "current", "voltage", "command"]
"""Kind of the input."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Load:
    """Inertia and torque of the rest of the model, at the samples of a log."""

    inertia: Array
    """Inertia at the joint without its armature [kg*m^2], shape (n,)."""
    torque: Array
    """Torque towards larger angles without the joint's own spring, damper and friction [N*m], shape (n,)."""
    slope: Array
    """Its derivative by the joint's angle [N*m/rad], shape (n,)."""
    at: Array
    """Angle of the joint at which they hold [rad], shape (n,)."""
    free: Array | None = None
    """Inertia without its armature while the other joints are free [kg*m^2], shape (n,); left out, they are held."""
    damped: Array | None = None
    """Torque through the other joints by the damping that a simulator takes at the end of its step [N*m], shape (n,)."""
    time: Array | None = None
    """Times of these [s], shape (n,); left out, they are the log's."""

    @property
    def rows(self) -> Array:
        """All of it but the times, in units of SI, shape (6, n)."""
        free = self.inertia if self.free is None else self.free
        damped = np.zeros_like(free) if self.damped is None else self.damped
        return np.stack([self.inertia, self.torque, self.slope, self.at, free, damped])

    @classmethod
    def of(cls, rows: Array, time: Array | None = None) -> Self:
        """Return the load of such rows in units of SI, shape (6, n), at times [s], shape (n,)."""
        inertia, torque, slope, at, free, damped = rows
        return cls(inertia=inertia, torque=torque, slope=slope, at=at, free=free, damped=damped, time=time)

    @classmethod
    def constant(cls, inertia: float, samples: int) -> Self:
        """Return a load of constant inertia [kg*m^2] and no torque, shape (samples,) each."""
        none = np.zeros(samples)
        return cls(inertia=np.full(samples, inertia), torque=none, slope=none, at=none)


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenLog:
    """Motion of one joint and the input that drove it."""

    name: str
    """The log's path."""
    time: Array
    """Time [s], shape (n,), increasing."""
    angle: Array
    """Angle that the encoder measured [rad], shape (n,)."""
    std: float
    """Its noise [rad]."""
    input: Array
    """Input in its own unit, shape (n,)."""
    kind: InputKind
    load: Load
    held: bool | None = True
    """Whether a digital controller held the input between samples; else it is smooth. None: a fit decides, a replay holds it."""
    slides: bool = False
    """Whether it is the position of a slide [m]; torques are then forces [N]."""
    beside: Mapping[str, Array] = field(default_factory=dict[str, Array])
    """Measured angles of other joints [rad or m], shape (n,) each."""

    @property
    def between(self) -> str:
        """Its input between samples: held or smooth."""
        return "smooth" if self.held is False else "held"

    @property
    def load_time(self) -> Array:
        """Times of its load [s], shape (n,)."""
        return self.time if self.load.time is None else self.load.time

    @cached_property
    def motion(self) -> Motion:
        """Its motion through a low-pass filter."""
        return Motion(self.time, self.angle, self.std)

    @property
    def step(self) -> float:
        """Median sampling interval [s]."""
        return self.motion.step

    @property
    def duration(self) -> float:
        """From the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    def late_input(self, delay: float) -> Array:
        """Return the mean input around the even times of the motion, late by a delay [s], shape (n,), in its unit."""
        middle, half = self.motion.time, self.step / 2
        return self.mean_input(np.r_[middle - half, middle[-1] + half], delay)[0]

    def mean_input(self, grid: Array, delay: float) -> Array:
        """Return mean and ramp of the input over each step of a grid [s], shape (m + 1,), and their derivatives by the delay [1/s].

        A line with that mean and ramp has the input's integral and first moment. The joint then moves as under
        the input, to third order of the step. Before the log the input is its first value.

        Returns:
            Mean, ramp and their derivatives, in the input's unit, shape (4, m).
        """
        late, step = grid - delay, np.diff(grid)
        value, once, twice = (one(late) for one in self._integrals)
        middle = (once[1:] + once[:-1]) / 2
        mean = np.diff(once) / step
        ramp = 12 / step * (middle - np.diff(twice) / step)
        by_delay = -np.diff(value) / step
        ramp_by_delay = 12 / step * (mean - (value[1:] + value[:-1]) / 2)
        return np.stack([mean, ramp, by_delay, ramp_by_delay])

    @cached_property
    def _integrals(self) -> tuple[Callable[[Array], Array], ...]:
        """The input as a function of time, and its first and second integral; it is constant before and after the log."""
        from scipy.interpolate import CubicSpline, PPoly

        inside = CubicSpline(self.time, self.input).c if self.held is False else self.input[None, :-1]
        ends = np.zeros((len(inside), 2))
        ends[-1] = self.input[[0, -1]]
        knots = np.r_[self.time[0] - 1.0, self.time, self.time[-1] + 1.0]
        found = PPoly(np.c_[ends[:, :1], inside, ends[:, 1:]], knots)
        # A step that begins where the input changes, begins after it.
        return lambda t: found(t + 1e-9), found.antiderivative(), found.antiderivative(2)


def log_of(
    roll: Roll, column: str, kind: InputKind, *, scale: float = 1.0, load: Load | None = None
) -> DrivenLog:
    """Return the driven log of a roll whose column holds the input.

    Args:
        scale: Of one unit of the column in SI (an angle in degrees).
        load: Of the model along the roll; a unit inertia without torque if left out.

    Raises:
        SysidError: The input is missing somewhere, or never changes.
    """
    values = scale * np.asarray(roll.extra[column], dtype=np.float64)
    known = np.isfinite(values)
    if not known.any():
        raise SysidError(f"{roll.log}: the input '{column}' holds no number. Name another with --input.")
    if not known.all():  # a slower stream: the last value holds
        last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
        values = np.where(last >= 0, values[last], values[known][0])
    if np.ptp(values) == 0:
        raise SysidError(
            f"{roll.log}: the input '{column}' is always {values[0]:g}: nothing drove the joint. Use `decay`, or name another column."
        )
    return DrivenLog(
        name=roll.log, time=roll.time, angle=roll.roll, std=float(np.median(roll.std)), input=values, kind=kind,
        load=load or Load.constant(1.0, len(values)), slides=roll.slides,
    )  # fmt: skip
