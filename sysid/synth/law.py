"""The true joint of a synthetic board: every parameter, and its torques branch by branch."""

import math
from dataclasses import dataclass, replace
from typing import Any

from sysid.errors import SysidError


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueLaw:
    """Every parameter of the true joint; what is left at its default is not there."""

    inertia: float
    stiffness: float
    damping: float
    rest: float = 0.0
    friction: float = 0.0
    """Dry friction while sliding fast [N*m]."""
    static_friction: float = 0.0
    """Dry friction at standstill [N*m]; not below `friction`."""
    stribeck_velocity: float = 1.0
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

    @property
    def has_memory(self) -> bool:
        """Whether the way in which the deck was held matters: an arm, a slider or a support."""
        return self.arm_stiffness > 0 or self.slider_stiffness > 0 or self.support_inertia > 0

    @property
    def has_kinks(self) -> bool:
        """Whether the motion must be cut at events."""
        return bool(
            self.static_friction > 0
            or math.isfinite(self.stop_angle)
            or self.half_gap > 0
            or self.slider_stiffness > 0
        )

    def equilibrium(self) -> float:
        """Roll at which the deck comes to rest when nothing sticks [rad].

        Raises:
            SysidError: There is none within ±90°: gravity tips the deck over.
        """
        from scipy.optimize import brentq

        modes = Modes()

        def residual(roll: float) -> float:
            support = -self.gravity * math.sin(roll) / self.support_stiffness if self.support_inertia else 0.0
            x = roll - support - self.rest
            return self.smooth_torque(x, 0.0, modes.regions(self, x)) - self.gravity * math.sin(roll)

        # Downhill from the spring's own rest: a softening law may balance again far away.
        way = math.copysign(0.01, residual(self.rest))
        near, far = self.rest, self.rest + way
        while residual(far) * way > 0:
            near, far = far, far + way
            if abs(far) > math.pi / 2:
                raise SysidError(
                    f"the board tips over: its spring ({self.stiffness:g} N*m/rad) finds no rest angle within "
                    "±90 degrees against gravity and preload. Use milder effects."
                )
        roll: Any = brentq(residual, min(near, far), max(near, far), xtol=1e-15)
        return float(roll)

    def smooth_torque(self, x: float, u: float, modes: "Modes") -> float:
        """Joint torque without dry friction, slider and arm, in the regions that `modes` names [N*m]."""
        spring = x - modes.gap * self.half_gap if self.half_gap == 0 or modes.gap else 0.0
        torque = (
            self.preload
            - self.stiffness * spring
            - x * x * (self.even_stiffness + self.cubic_stiffness * x)
            - u * (self.damping + self.quadratic_damping * abs(u) + self.cubic_damping * u * u)
        )
        if modes.stop:
            torque -= self.stop_stiffness * (x - modes.stop * self.stop_angle) + self.stop_damping * u
        return torque

    def sliding_friction(self, u: float) -> float:
        """Size of the dry friction torque at the sliding rate u [N*m]."""
        extra = self.static_friction - self.friction
        if extra == 0:
            return self.friction
        return self.friction + extra * math.exp(-((u / self.stribeck_velocity) ** 2))


@dataclass(frozen=True, slots=True)
class Modes:
    """Which branch of each kinked law holds; −1, 0 or +1 each."""

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
