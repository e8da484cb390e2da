"""A joint without a spring that spins down: viscous damping and dry friction over the inertia.

The law is `v̇ = -β v - c sgn v`, with β = d/I and c = friction/I.
Its solution is `v(t) = (v₀ + c/β) e^(-βt) - c/β` until the joint stops.
A pure exponential is also the return of an overdamped spring. The angle decides: a joint with a spring cannot go round.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sysid.decay.linear_fit import FittedTrace, TraceFit
from sysid.decay.trace import traces_of
from sysid.noise.sensor import BEST_SENSOR
from sysid.noise.whiteness import lag_one
from sysid.quantity import Quantity, t95
from sysid.roll import Array, Release

TURNS_ON = math.pi
"""Largest way in one direction of a joint with a spring [rad]: half a turn."""
BACK = 0.05
"""Largest return of a joint without a spring, over its way: noise, and slack of a drive."""


def spins_down(releases: Sequence[Release]) -> bool:
    """Whether each release goes more than half a turn in one direction and does not come back."""
    for release in releases:
        way = release.roll - release.roll[0]
        whole = float(np.abs(way).max())
        if release.slides or whole < TURNS_ON or abs(float(way[-1])) < (1 - BACK) * whole:
            return False
    return True


def _coasting(time: Array, p: Array, *, rate: bool) -> Array:
    """Return the rate [rad/s] or the angle [rad] of a coast-down, shape (n,), for (β, c, first speed, offset)."""
    beta, friction, speed, place = (float(value) for value in p)
    size, since = abs(speed), time - time[0]
    stop = math.log1p(beta * size / friction) / beta if friction > 1e-12 * size else math.inf
    t = np.minimum(since, stop)
    fading = np.exp(-beta * t)
    if rate:
        return place + math.copysign(1.0, speed) * ((size + friction / beta) * fading - friction / beta)
    way = (size + friction / beta) * (1 - fading) / beta - friction / beta * t
    return place + math.copysign(1.0, speed) * way


def fit_coast_down(releases: Sequence[Release]) -> tuple[TraceFit, dict[str, Quantity]]:
    """Fit one damping and one friction to all releases together, each with its own speed and place or offset.

    Returns:
        The fit, with the poles of a spring too weak to be seen. β [1/s] and c [rad/s²] under their names; correlated residuals widen
        their intervals.
    """
    from scipy.optimize import least_squares

    traces, signal = traces_of(releases)
    rate = signal == "rate"
    start = [1.0 / (traces[0].time[-1] - traces[0].time[0]), 0.0]
    for trace in traces:
        first = slice(0, max(5, len(trace.time) // 20))
        slope = float(np.polyfit(trace.time[first], trace.measured[first], 1)[0])
        start += [float(np.median(trace.measured[first])), 0.0] if rate else [slope, float(trace.measured[0])]
    start[1] = abs(start[2]) * start[0]
    begin = np.array(start)
    least = np.full(len(begin), -np.inf)
    least[:2] = 1e-6 * begin[0], 0.0

    def modelled(p: Array) -> list[Array]:
        return [
            _coasting(trace.time, np.concatenate([p[:2], p[2 + 2 * i : 4 + 2 * i]]), rate=rate)
            for i, trace in enumerate(traces)
        ]

    def residuals(p: Array) -> Array:
        pairs = zip(traces, modelled(p), strict=True)
        return np.concatenate([trace.weight * (trace.measured - model) for trace, model in pairs])

    scale = np.maximum(np.abs(begin), 1e-2 * np.abs(begin).max())
    best: Any = least_squares(residuals, begin, bounds=(least, np.inf), x_scale=scale, xtol=1e-12, ftol=1e-12)
    point: Array = best.x
    free = max(len(best.fun) - len(point), 1)
    rho = lag_one(np.split(best.fun, np.cumsum([len(trace.time) for trace in traces])[:-1]))
    variance = 2 * float(best.cost) / free
    inverse = np.asarray(np.linalg.pinv(best.jac.T @ best.jac), dtype=np.float64)
    std = np.sqrt(np.diag(inverse) * variance * (1 + rho) / (1 - rho))
    spread = sum(float(np.var(trace.measured)) * len(trace.measured) for trace in traces)
    finest = BEST_SENSOR * max(float(np.ptp(trace.measured)) for trace in traces)
    weak = 2 * math.log(100 * max(float(trace.time[-1] - trace.time[0]) for trace in traces))
    levels = [float(point[3 + 2 * i] if rate else trace.measured[-1]) for i, trace in enumerate(traces)]
    parts = [
        FittedTrace(trace, model, np.array([0.0, 0.0, level]), 0.0)
        for trace, model, level in zip(traces, modelled(point), levels, strict=True)
    ]
    fit = TraceFit(
        poles=np.array([weak, point[0] * math.exp(weak)]), covariance=np.eye(2), white_covariance=np.eye(2),
        degrees_of_freedom=free, noise=max(math.sqrt(variance), finest), correlation=rho, explained=1 - variance * free / spread,
        signal=signal, releases=tuple(parts), law="none",
    )  # fmt: skip
    half = t95(free) * std
    values = {"damping_over_inertia": "1/s", "friction_over_inertia": "rad/s^2"}
    return fit, {
        name: Quantity(float(value), float(s), unit, "coast-down", (float(value - h), float(value + h)))
        for (name, unit), value, s, h in zip(values.items(), point, std, half, strict=False)
    }
