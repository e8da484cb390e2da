"""The true joint of a synthetic board: every parameter, and its torques branch by branch."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sysid.effects._algebra import NUMPY
from sysid.effects._base import Effect, JointState, TorqueEffect
from sysid.errors import SysidError

_MOVE = 1e-8
"""Tilt over which the slope of a rate-independent state is taken [rad]."""


@dataclass(frozen=True, slots=True)
class CatalogueLaw:
    """The catalogue's law of an effect that has no formula here."""

    effect: TorqueEffect
    values: Mapping[str, float]
    stiffness: float
    """The joint's linear stiffness [N*m/rad]."""

    def torque(self, x: float, u: float, roll: float, states: Sequence[float]) -> float:
        """Return its torque at tilt x [rad], rate u [rad/s] and roll [rad] [N*m]."""
        motion = JointState(x, u, roll, self.stiffness)
        return float(self.effect.torque(NUMPY, motion, self.values, states))

    def rates(self, x: float, u: float, roll: float, states: Sequence[float]) -> list[float]:
        """Return the time derivatives of its internal states."""
        motion = JointState(x, u, roll, self.stiffness)
        flows: list[float] = []
        for state, z in zip(self.effect.states, states, strict=True):
            if state.return_map is not None:
                moved = math.copysign(_MOVE, u)
                flows.append(abs(u) / _MOVE * float(state.return_map(NUMPY, z, moved, self.values) - z))
            else:
                flows.append(float(state.rate(NUMPY, motion, states, self.values)) if state.rate else 0.0)
        return flows

    def at_rest(self) -> list[float]:
        """Return its internal states in an untouched deck."""
        starts = (s.start(NUMPY, 0.0, math.inf, self.stiffness, self.values) for s in self.effect.states)
        return [float(start) for start in starts]


def catalogue_law(effect: Effect, values: Sequence[float], stiffness: float) -> CatalogueLaw:
    """Return the law of an effect that is a torque.

    Raises:
        SysidError: It is another kind of effect, or dry friction.
    """
    if not isinstance(effect, TorqueEffect) or effect.friction is not None:
        raise SysidError(
            f"effect '{effect.name}' cannot be made: synth integrates torques and their states. Friction, sensors and "
            "supports need a formula in sysid/synth/."
        )
    return CatalogueLaw(effect, effect.named(values), stiffness)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueLaw:
    """Every parameter of the true joint; a parameter at its default has no effect."""

    inertia: float
    stiffness: float
    damping: float
    rest: float = 0.0
    friction: float = 0.0
    """Dry friction while sliding fast [N*m]."""
    static_friction: float = 0.0
    """Dry friction at standstill [N*m]; not below `friction`."""
    stribeck_velocity: float = 1.0
    friction_growth: float = 0.0
    """Dry friction that comes with the tilt [N*m/rad]."""
    quadratic_damping: float = 0.0
    cubic_damping: float = 0.0
    cubic_stiffness: float = 0.0
    even_stiffness: float = 0.0
    gravity: float = 0.0
    stop_angle: float = math.inf
    stop_stiffness: float = 0.0
    stop_damping: float = 0.0
    half_gap: float = 0.0
    preload: float = 0.0
    arm_stiffness: float = 0.0
    arm_time: float = 1.0
    slider_stiffness: float = 0.0
    slider_torque: float = 0.0
    support_inertia: float = 0.0
    support_stiffness: float = 0.0
    support_damping: float = 0.0
    laws: tuple[CatalogueLaw, ...] = ()
    """Effects without a formula here."""

    def inertia_at(self, roll: float) -> tuple[float, float]:
        """Return the inertia at a roll [kg*m^2], and its derivative."""
        inertia, slope = self.inertia, 0.0
        for law in self.laws:
            if law.effect.changing is not None:
                more, steeper = law.effect.changing(NUMPY, roll, law.values)
                inertia, slope = inertia + float(more), slope + float(steeper)
        return inertia, slope

    @property
    def has_memory(self) -> bool:
        """Whether the hold before a release matters: an arm, a slider or a support."""
        states = any(law.effect.states for law in self.laws)
        return self.arm_stiffness > 0 or self.slider_stiffness > 0 or self.support_inertia > 0 or states

    @property
    def has_kinks(self) -> bool:
        """Whether the motion must be cut at events."""
        return bool(
            self.has_friction
            or math.isfinite(self.stop_angle)
            or self.half_gap > 0
            or self.slider_stiffness > 0
            or any(law.effect.nonsmooth for law in self.laws)
        )

    def equilibrium(self) -> float:
        """Roll at which the deck comes to rest when nothing sticks [rad].

        Raises:
            SysidError: Gravity tips the deck over: no equilibrium lies within 90° of the spring's rest.
        """
        from scipy.optimize import brentq

        # Downhill from the spring's own rest: a softening law may balance again far away.
        way = math.copysign(0.01, self.pull(self.rest))
        near, far = self.rest, self.rest + way
        while self.pull(far) * way > 0:
            near, far = far, far + way
            if abs(far - self.rest) > math.pi / 2:
                raise SysidError(
                    f"the joint tips over: its spring ({self.stiffness:g} N*m/rad) finds no rest angle within "
                    "90 degrees of its own against gravity and preload. Use milder effects."
                )
        roll: Any = brentq(self.pull, min(near, far), max(near, far), xtol=1e-15)
        return float(roll)

    def pull(self, roll: float) -> float:
        """Return the static torque on the deck at a roll, without dry friction and effects with memory [N*m]."""
        support = -self.gravity * math.sin(roll) / self.support_stiffness if self.support_inertia else 0.0
        x = roll - support - self.rest
        return self.smooth_torque(x, 0.0, Modes().regions(self, x)) - self.gravity * math.sin(roll)

    def smooth_torque(self, x: float, u: float, modes: "Modes") -> float:
        """Return the joint torque in the regions of `modes`, without dry friction and effects with memory [N*m]."""
        spring = x - modes.gap * self.half_gap if self.half_gap == 0 or modes.gap else 0.0
        torque = (
            self.preload
            - self.stiffness * spring
            - x * x * (self.even_stiffness + self.cubic_stiffness * x)
            - u * (self.damping + self.quadratic_damping * abs(u) + self.cubic_damping * u * u)
        )
        if modes.stop:
            torque -= self.stop_stiffness * (x - modes.stop * self.stop_angle) + self.stop_damping * u
        return torque + sum(law.torque(x, u, x + self.rest, ()) for law in self.laws if not law.effect.states)

    @property
    def has_friction(self) -> bool:
        """Whether the deck may stick."""
        return self.static_friction > 0 or self.friction_growth > 0

    def holding_friction(self, x: float) -> float:
        """Size of the dry friction torque at standstill at the tilt x [N*m]."""
        return self.static_friction + self.friction_growth * abs(x)

    def sliding_friction(self, x: float, u: float) -> float:
        """Size of the dry friction torque at the tilt x and the sliding rate u [N*m]."""
        sliding, extra = self.friction + self.friction_growth * abs(x), self.static_friction - self.friction
        return sliding + extra * math.exp(-((u / self.stribeck_velocity) ** 2)) if extra else sliding


@dataclass(frozen=True, slots=True)
class Modes:
    """The branch of each kinked law: −1, 0 or +1."""

    friction: int = 0
    """Sliding direction; 0 sticks."""
    slider: int = 0
    """Yielding direction; 0 is elastic."""
    origin: float = 0.0
    """Position at which the elastic slider carries no torque [rad]."""
    stop: int = 0
    gap: int = 0

    def regions(self, law: TrueLaw, x: float) -> "Modes":
        """Return the modes with stop and gap set for the position x."""
        stop = 0 if abs(x) <= law.stop_angle else int(math.copysign(1, x))
        gap = 0 if abs(x) <= law.half_gap else int(math.copysign(1, x))
        return replace(self, stop=stop, gap=gap)
