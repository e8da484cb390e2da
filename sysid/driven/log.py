"""A driven log: a motion, the input that drove it, and the load that the model puts on the joint along it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, Self, get_args

import numpy as np

from sysid.errors import SysidError
from sysid.roll import Array, Roll

InputKind = Literal["torque", "force", "current", "voltage", "command"]
"""Kind of the input."""
KINDS: tuple[str, ...] = get_args(InputKind)


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
    held: bool = True
    """Whether a digital controller held the input between samples; else it is smooth."""
    slides: bool = False
    """Whether it is the position of a slide [m]; torques are then forces [N]."""
    beside: Mapping[str, Array] = field(default_factory=dict[str, Array])
    """Measured angles of other joints [rad or m], shape (n,) each."""

    @property
    def load_time(self) -> Array:
        """Times of its load [s], shape (n,)."""
        return self.time if self.load.time is None else self.load.time

    @property
    def step(self) -> float:
        """Median sampling interval [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def duration(self) -> float:
        """From the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    def grid(self, substeps: int) -> Array:
        """Return integration times with so many steps a sample [s], shape (m + 1,)."""
        step = self.step / substeps
        return self.time[0] + step * np.arange(int(self.duration / step + 1e-6) + 1)

    def mean_input(self, grid: Array, delay: float) -> tuple[Array, Array]:
        """Return the mean input over each step of a grid [s], shape (m + 1,), and its derivative by the delay [s], shape (m,) each.

        Before the log the input is its first value; means are in the input's unit.
        """
        late = grid - delay
        integral, value = self._integral
        step = np.diff(grid)
        return np.diff(integral(late)) / step, -np.diff(value(late)) / step

    @cached_property
    def _integral(self) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
        """The input's integral and the input itself as functions of time."""
        time, values = self.time, self.input
        if not self.held:
            from scipy.interpolate import CubicSpline

            spline = CubicSpline(time, values)
            whole = spline.antiderivative()

            def clipped(t: Array) -> Array:
                inside = np.clip(t, time[0], time[-1])
                return np.asarray(whole(inside)) + values[0] * (t - inside)

            return clipped, lambda t: np.asarray(spline(np.clip(t, time[0], time[-1])))
        sums = np.r_[0.0, np.cumsum(values[:-1] * np.diff(time))]

        def summed(t: Array) -> Array:
            before, after = np.minimum(t - time[0], 0.0), np.maximum(t - time[-1], 0.0)
            return np.interp(t, time, sums) + values[0] * before + values[-1] * after

        def now(t: Array) -> Array:
            return values[np.clip(np.searchsorted(time, t + 1e-9, side="right") - 1, 0, len(time) - 1)]

        return summed, now


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
