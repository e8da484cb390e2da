"""The torque that a model misses along a log: motion and torques through one low-pass filter, as in the inverse dynamics of robots.

Source: Gautier, Janot and Vandanjon, IEEE Trans. Control Syst. Technol. 21 (2013), for the filtering of both sides.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from sysid.driven.joint import Structure
from sysid.driven.log import DrivenLog, Load
from sysid.effects._algebra import NUMPY
from sysid.effects._base import Actuation, DriveEffect, JointState, TorqueEffect
from sysid.roll import Array

SIGNAL_OVER_NOISE = 10.0
"""Power of the angle over its noise from which a frequency counts [1]: its torque is then known to a third."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A log on an even grid through a low-pass filter, and its derivatives."""

    log: DrivenLog

    @classmethod
    def of(cls, time: Array, angle: Array) -> Self:
        """Return the motion of angles [rad] at times [s], shape (n,) each; their noise is what the highest frequencies have."""
        load = Load.constant(1.0, len(time))
        return cls(
            DrivenLog(name="", time=time, angle=angle, std=1e-12, input=angle, kind="command", load=load)
        )

    @cached_property
    def time(self) -> Array:
        """Even times [s], shape (n,)."""
        return self.log.grid(1)

    @cached_property
    def _raw(self) -> Array:
        return np.interp(self.time, self.log.time, self.log.angle)

    @cached_property
    def cutoff(self) -> float:
        """Highest frequency at which the angle stands above its noise [Hz]."""
        n, step = len(self._raw), self.log.step
        window = np.hanning(n)
        line = np.polyval(np.polyfit(self.time, self._raw, 1), self.time)
        power = np.abs(np.fft.rfft((self._raw - line) * window)) ** 2 / (window**2).sum()
        wide = max(3, n // 400)
        smooth = np.convolve(power, np.ones(wide) / wide, mode="same")
        above = np.flatnonzero(
            smooth > SIGNAL_OVER_NOISE * max(self.log.std**2, float(np.median(power[n // 4 :])))
        )
        found = np.fft.rfftfreq(n, step)[above[-1]] if len(above) else 0.0
        return float(np.clip(found, 10 / self.log.duration, 0.2 / step))

    @cached_property
    def angle(self) -> Array:
        """Filtered angle [rad], shape (n,)."""
        return self.filtered(self._raw)

    @cached_property
    def rate(self) -> Array:
        """Its rate [rad/s], shape (n,)."""
        return np.gradient(self.angle, self.log.step)

    @cached_property
    def acceleration(self) -> Array:
        """Its acceleration [rad/s^2], shape (n,)."""
        return np.gradient(self.rate, self.log.step)

    def filtered(self, values: Array) -> Array:
        """Return values through the filter, without a lag, shape (n,), in their unit."""
        from scipy.ndimage import gaussian_filter1d

        return gaussian_filter1d(values, 1 / (2 * np.pi * self.cutoff * self.log.step), mode="nearest")

    @cached_property
    def inside(self) -> slice:
        """Samples that the ends do not reach through the filter."""
        edge = max(3, int(1 / (self.cutoff * self.log.step)))
        return slice(edge, len(self.time) - edge)

    def input(self, delay: float) -> Array:
        """Return the input, late by a delay [s], shape (n,), in its unit."""
        step = self.log.step
        grid = np.r_[self.time - step / 2, self.time[-1] + step / 2]
        return self.log.mean_input(grid, delay)[0]

    def load(self, name: str) -> Array:
        """Return one of the load's arrays in its unit of SI, shape (n,)."""
        return np.interp(self.time, self.log.load_time, getattr(self.log.load, name))


def torque_along(structure: Structure, values: Mapping[str, float], motion: Motion) -> Array:
    """Return the torque of a model along a log, through the log's filter [N*m], shape (n,): 0 where nothing is missing.

    It is load, actuator, springs and friction less what accelerates the joint. Effects with states and gears count as absent.
    """
    q, v, a = motion.angle, motion.rate, motion.acceleration
    late = motion.input(values[structure.delay] if structure.delay else 0.0)
    tilt = q - values["rest_angle"]
    state = JointState(tilt, v, q, values["stiffness"])
    torque = motion.load("torque") + motion.load("slope") * (q - values["zero"] - motion.load("at"))
    torque = torque + values["bias"] - values["stiffness"] * tilt - values["damping"] * v
    torque = torque - (motion.load("inertia") + values["armature"]) * a
    acted: Array = np.zeros_like(q)
    for part in sorted(structure.parts, key=lambda part: getattr(part, "stage", 0)):
        own = {p.name: values[f"{part.name}.{p.name}"] for p in part.parameters}
        if isinstance(part, DriveEffect):
            acted = part.act(NUMPY, Actuation(late, acted, q, v), own)
        elif isinstance(part, TorqueEffect) and not part.states:
            torque = torque + part.torque(NUMPY, state, own, ())
            if part.friction is not None:
                torque = torque - np.sign(v) * part.friction(NUMPY, tilt, np.abs(v), own)
    return motion.filtered(torque + acted)[motion.inside]


def linear_start(
    structure: Structure, values: Mapping[str, float], names: tuple[str, ...], motion: Motion,
    limits: Callable[[str], tuple[float, float]],
) -> tuple[dict[str, float], float]:  # fmt: skip
    """Return the parameters after one Gauss–Newton step to the least missing torque, and that torque [N*m].

    Args:
        limits: Bounds of a parameter in its unit.
    """
    from scipy.optimize import lsq_linear

    here = torque_along(structure, values, motion)
    if not names:
        return dict(values), float(np.sqrt(np.mean(here**2)))
    columns: list[Array] = []
    room: list[tuple[float, float]] = []
    for name in names:
        bottom, top = limits(name)
        step = 1e-3 * max(abs(values[name]), 1e-3 * (top - bottom))
        step = -step if values[name] + step > top else step
        columns.append((torque_along(structure, {**values, name: values[name] + step}, motion) - here) / step)
        room.append((bottom - values[name], top - values[name]))
    scale = 1 / np.maximum(np.linalg.norm(columns, axis=1), 1e-300)
    low, high = np.array(room).T / scale
    low, high = np.minimum(low, -1e-12), np.maximum(high, 1e-12)
    solved = lsq_linear(np.stack(columns, axis=1) * scale, -here, (low, high))
    moved = {
        name: float(np.clip(values[name] + x, *limits(name)))
        for name, x in zip(names, solved.x * scale, strict=True)
    }
    return {**values, **moved}, float(np.sqrt(2 * solved.cost / len(here)))
