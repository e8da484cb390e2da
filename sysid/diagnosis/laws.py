"""Every law of the catalogue as columns of a regression: its torque on the smoothed motion, for a grid of its shape parameters.

A parameter with the unit of a torque or an inertia scales its law; any other one shapes it. So a log is linear in the strengths of all
laws, and any effect file becomes a candidate by being there. States of a law (a bristle, a Maxwell arm, a hanging body) are driven by the
smoothed motion from the hold on.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from scipy.special import erf

from sysid.diagnosis.motion import Motion
from sysid.diagnosis.smoother import Smoothed
from sysid.effects import catalogue
from sysid.effects._algebra import NUMPY
from sysid.effects._base import Effect, JointState, Parameter, Scales, SupportEffect, TorqueEffect
from sysid.roll import Array

GRID = 12
"""Values of one shape parameter; of two, `GRID` and `COARSE`."""
COARSE = 3
SPAN = 100.0
"""Ratio of the bounds of a shape parameter from which it is spaced geometrically; the ratio itself if the lower bound is 0."""
SHOWS = 0.02
"""Share of a law's torque beside spring, damper and a constant below which it is only another spring and damper."""


@dataclass(frozen=True, slots=True)
class Shape:
    """One point of the grid of a law's shape parameters."""

    values: tuple[float, ...]
    """In units of their sizes."""
    share: float
    """Share of the law's prior that the point stands for."""
    spacing: tuple[tuple[float, float], ...]
    """Neighbours of each value, below and above."""

    def finer(self) -> "list[Shape]":
        """Return points a quarter as far apart, axis by axis, out to the neighbours."""
        near = tuple(
            (b - (b - a) / 4, b + (c - b) / 4) for b, (a, c) in zip(self.values, self.spacing, strict=True)
        )
        points = [self.values]
        for axis, (middle, ends) in enumerate(zip(self.values, self.spacing, strict=True)):
            moved = (middle + f * (end - middle) for end in ends for f in (0.25, 0.5, 0.75) if end != middle)
            points += [(*self.values[:axis], value, *self.values[axis + 1 :]) for value in moved]
        return [Shape(point, self.share / 4, near) for point in points]


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """One law at one set of shape parameters."""

    effect: str
    """Its name in the catalogue."""
    family: str
    shape: "Shape"
    strengths: tuple[str, ...]
    """Parameter that scales each column; '' where the joint's own stiffness does."""
    columns: Array
    """Opposing torque over I ω₀² A at the strength `unit`, shape (r, n, c)."""
    unit: tuple[float, ...]
    """Strength of each column, in its parameter's unit."""
    signs: tuple[int, ...]
    """1 where the strength cannot be negative, else 0."""
    parameters: Mapping[str, float]
    """All parameters at these strengths and shapes, in their units."""
    ratios: tuple[str, ...] = ()
    """Those that scale with the first strength."""

    def scaled(self, size: Array) -> "Term":
        """Return the term with each column times a factor [1], shape (c,)."""
        unit = tuple(float(u * s) for u, s in zip(self.unit, size, strict=True))
        return replace(self, columns=self.columns * size, unit=unit)

    def fitted(self, coefficients: Array) -> dict[str, float]:
        """Return all parameters as 'effect.parameter' at some coefficients of the columns [1], shape (c,)."""
        each = zip(self.strengths, coefficients, self.unit, strict=True)
        strengths = {name: float(c * u) for name, c, u in each if name}
        first = self.strengths[0]
        scale = strengths[first] / self.parameters[first] if self.ratios else 1.0
        ratios = {name: self.parameters[name] * scale for name in self.ratios}
        return {f"{self.effect}.{name}": v for name, v in {**self.parameters, **ratios, **strengths}.items()}


@dataclass(frozen=True, slots=True)
class Split:
    """Parameters of a law by their role."""

    strengths: tuple[Parameter, ...]
    """Those that each scale a part of the law."""
    shapes: tuple[Parameter, ...]
    ratios: tuple[Parameter, ...]
    """Those that scale the law together with the first strength: their ratio to it is a shape."""


def candidates(beside: Sequence[str] = ()) -> dict[str, Effect]:
    """Return the effects that a torque can show, but for those that the record has."""
    found: dict[str, Effect] = {}
    for name, part in catalogue().items():
        torque = isinstance(part, TorqueEffect) and part.role == "torque" and part.modifies is None
        support = isinstance(part, SupportEffect)
        if (torque or support) and part.identifiable_from_decay and name not in beside:
            found[name] = part
    return found


def split(part: Effect, scales: Scales) -> Split:
    """Sort the parameters of a law by its own values: scale, add, or shape."""
    force = [p for p in part.parameters if p.unit.startswith(("N", "kg"))]
    shapes = tuple(p for p in part.parameters if p not in force)
    if isinstance(part, SupportEffect):
        return Split((), tuple(part.parameters), ())
    if len(force) > 1 and (part.states or not _adds(part, force, shapes, scales)):
        return Split((force[0],), shapes, tuple(force[1:]))
    return Split(tuple(force), shapes, ())


def _adds(part: Effect, force: Sequence[Parameter], shapes: Sequence[Parameter], scales: Scales) -> bool:
    """Return whether the law is a sum with one term for each strength."""
    assert isinstance(part, TorqueEffect)
    tilt = np.linspace(-1, 1, 15) * scales.amplitude
    rate = np.cos(np.linspace(0, 6, 15)) * scales.rate
    fixed = {p.name: p.starts[0] * p.size(scales) for p in shapes}
    each = [{q.name: (abs(q.starts[-1]) * q.size(scales) if q is p else 0.0) for q in force} for p in force]
    both = {q.name: abs(q.starts[-1]) * q.size(scales) for q in force}
    state = JointState(tilt, rate, tilt, scales.stiffness)
    whole = _torque(part, state, {**fixed, **both}, (), None)
    parts = sum(_torque(part, state, {**fixed, **one}, (), None) for one in each)
    return bool(np.allclose(whole, parts, atol=1e-9 * scales.torque))


def shape_values(p: Parameter, scales: Scales, count: int) -> Array:
    """Return values of a shape parameter between its bounds, in units of its size [1], shape (count,)."""
    if p.low < 0:
        return np.linspace(p.low, p.high, 2 * count)
    if p.low and p.high / p.low < SPAN:
        return np.linspace(p.low, p.high, count)
    return np.geomspace(p.low or p.high / SPAN, p.high, count)


def _torque(
    part: TorqueEffect, state: JointState, p: Mapping[str, Any], z: Sequence[Any], spread: Any
) -> Any:
    """Return the torque of a law, dry friction smeared by how well the rate is known [N*m]."""
    torque = part.torque(NUMPY, state, p, z)
    if part.friction is None:
        return torque + 0.0 * state.tilt
    side = np.sign(state.rate) if spread is None else erf(state.rate / (np.sqrt(2) * spread))
    return torque - part.friction(NUMPY, state.tilt, np.abs(state.rate), p) * side


class Laws:
    """Terms of the catalogue on one smoothed motion."""

    def __init__(self, motion: Motion, inertia: float, stiffness: float, damping: float) -> None:
        """Hold the scales of a joint: its inertia [kg*m^2], and k and d of its linear law in the motion's units."""
        a, w = motion.amplitude, motion.frequency
        self.motion, self.unit = motion, inertia * w * w * a
        self.scales = Scales(
            inertia=inertia, stiffness=inertia * w * w * stiffness, damping=inertia * w * max(damping, 1e-9), amplitude=a,
            duration=float(motion.length.max()) * motion.step / w,
        )  # fmt: skip

    def recorded(
        self, smoothed: Smoothed, known: Sequence[tuple[Effect, Mapping[str, float]]]
    ) -> list[Array]:
        """Return the opposing torque over I ω₀² A of effects with given parameters [1], shape (r, n) each."""
        state, spread = self._state(smoothed)
        found: list[Array] = []
        for part, values in known:
            if isinstance(part, SupportEffect):
                shape = Shape(tuple(values[p.name] / p.size(self.scales) for p in part.parameters), 1.0, ())
                torque = self._support(part, state, [shape])[0][..., 0]
            else:
                assert isinstance(part, TorqueEffect)
                z = self._driven(part, state, {n: np.array([v]) for n, v in values.items()})[0]
                torque = -_torque(part, state, values, z, spread) / self.unit
            found.append(np.where(self.motion.inside, torque, 0.0))
        return found

    def _state(self, smoothed: Smoothed) -> tuple[JointState, Array]:
        """Return the smoothed motion in SI units, and the deviation of its rate [rad/s]."""
        a, unit = self.motion.amplitude, self.motion.amplitude * self.motion.frequency
        angle = smoothed.angle * a
        state = JointState(angle, smoothed.rate * unit, angle + self.motion.rest, self.scales.stiffness)
        return state, np.sqrt(smoothed.rate_variance) * unit + 1e-12 * unit

    def terms(
        self, smoothed: Smoothed, parts: Mapping[str, Effect], grids: Mapping[str, Sequence[Shape]]
    ) -> Iterator[Term]:
        """Yield each law at each of its shapes, as far as the motion shows it.

        Args:
            smoothed: Motion on which the laws act.
            parts: Effects by name.
            grids: Shapes to use, in units of their sizes; where an effect is left out, its own grid.
        """
        inside = self.motion.inside
        state, spread = self._state(smoothed)
        for name, part in parts.items():
            kinds = split(part, self.scales)
            shapes = list(grids.get(name) or self.grid(part))
            if isinstance(part, SupportEffect):
                tables = self._support(part, state, shapes)
                strengths, unit, signs = ("",), (1.0,), (1,)
            else:
                assert isinstance(part, TorqueEffect)
                tables = self._columns(part, kinds, state, spread, shapes)
                strengths = tuple(p.name for p in kinds.strengths) or ("",)
                unit = tuple(p.size(self.scales) for p in kinds.strengths) or (1.0,)
                signs = tuple(int(p.low >= 0) for p in kinds.strengths) or (1,)
            for shape, columns in zip(shapes, tables, strict=True):
                columns = np.where(inside[..., None], columns, 0.0)
                peaks = np.abs(columns).max(axis=(0, 1))
                if not np.isfinite(peaks).all() or peaks.min() < SHOWS * max(peaks.max(), SHOWS):
                    continue
                yield Term(
                    effect=name, family=part.family, shape=shape, strengths=strengths, columns=columns, unit=unit, signs=signs,
                    parameters=self._parameters(kinds, shape.values), ratios=tuple(p.name for p in kinds.ratios),
                )  # fmt: skip

    def rest(self) -> Term:
        """Return another rest angle: a constant torque."""
        return Term(
            effect="offset", family="rest", shape=Shape((), 1.0, ()), strengths=("",), columns=np.ones((*self.motion.reading.shape, 1)),
            unit=(1.0,), signs=(0,), parameters={},
        )  # fmt: skip

    def grid(self, part: Effect) -> list[Shape]:
        """Return all shapes of a law, in units of the sizes of its shape parameters."""
        kinds = split(part, self.scales)
        axes = [shape_values(p, self.scales, GRID if i == 0 else COARSE) for i, p in enumerate(kinds.shapes)]
        axes += [
            np.geomspace(SPAN**-0.5, SPAN**0.5, 2 * GRID if not axes else 2 * COARSE) for _ in kinds.ratios
        ]
        ends = [list(zip(np.r_[a[0], a[:-1]], a, np.r_[a[1:], a[-1]], strict=True)) for a in axes]
        points = list(product(*ends))
        return [
            Shape(
                tuple(float(b) for _, b, _ in point),
                1 / len(points),
                tuple((float(a), float(c)) for a, _, c in point),
            )
            for point in points
        ]

    def _parameters(self, kinds: Split, shape: Sequence[float]) -> dict[str, float]:
        every = [*kinds.shapes, *kinds.ratios]
        values = {p.name: v * p.size(self.scales) for p, v in zip(every, shape, strict=True)}
        return {**values, **{p.name: p.size(self.scales) for p in kinds.strengths}}

    def _columns(
        self, part: TorqueEffect, kinds: Split, state: JointState, spread: Array, shapes: Sequence[Shape]
    ) -> list[Array]:
        """Return the columns of a law at each shape, shape (r, n, c)."""
        sets, stacked = self._sets(part, kinds, shapes)
        states = self._driven(part, state, stacked)
        found: list[Array] = []
        for values, z in zip(sets, states, strict=True):
            alone = [
                {**values, **{q.name: 0.0 for q in kinds.strengths if q is not p}} for p in kinds.strengths
            ]
            torques = [_torque(part, state, one, z, spread) for one in alone or [values]]
            found.append(-np.stack(torques, axis=-1) / self.unit)
        return found

    def _sets(
        self, part: Effect, kinds: Split, shapes: Sequence[Shape]
    ) -> tuple[list[dict[str, float]], dict[str, Array]]:
        """Return the parameters at each of g shapes, and each parameter at all of them, shape (g,)."""
        sets = [self._parameters(kinds, shape.values) for shape in shapes]
        return sets, {p.name: np.array([one[p.name] for one in sets]) for p in part.parameters}

    def _driven(
        self, part: TorqueEffect, state: JointState, p: Mapping[str, Array]
    ) -> list[tuple[Array, ...]]:
        """Return the states of the law at each of g shapes, driven by the motion: a tuple of shape (r, n) each."""
        if not part.states:
            return [()] * len(next(iter(p.values())))
        hold, still = (
            a[:, None]
            for a in (self.motion.hold * self.motion.amplitude, self.motion.held / self.motion.frequency)
        )
        z = [s.start(NUMPY, hold, still, self.scales.stiffness, p) + 0.0 * hold for s in part.states]
        maps = [s.return_map for s in part.states if s.return_map]
        if not maps:
            return self._moved(z, [s.rate for s in part.states if s.rate], state, p, SUBSTEPS)
        steps = np.diff(state.tilt, axis=1, prepend=hold)
        out = np.zeros((state.tilt.shape[1], len(z), len(hold), len(next(iter(p.values())))))
        for j in range(len(out)):
            z = [one(NUMPY, zi, steps[:, [j]], p) for one, zi in zip(maps, z, strict=True)]
            out[j] = z
        return [tuple(np.moveaxis(out[..., i], 0, -1)) for i in range(out.shape[3])]

    def _moved(
        self,
        z: list[Any],
        rates: Sequence[Callable[..., Any]],
        state: JointState,
        p: Mapping[str, Array],
        parts: int,
    ) -> list[tuple[Array, ...]]:
        """Return states at each of g shapes, moved by their rates in some steps between two nodes, by the midpoint rule."""
        h, between = self.motion.step / self.motion.frequency / parts, _between(state, parts)
        rows, nodes = state.tilt.shape
        out = np.zeros((nodes, len(z), rows, len(next(iter(p.values())))))
        out[0] = z
        with np.errstate(over="ignore", invalid="ignore"):  # a stiff law has no bound
            for at in range(0, len(between), 2):
                middle = [zi + h / 2 * r(NUMPY, between[at], z, p) for zi, r in zip(z, rates, strict=True)]
                z = [zi + h * r(NUMPY, between[at + 1], middle, p) for zi, r in zip(z, rates, strict=True)]
                if at % (2 * parts) == 2 * (parts - 1):
                    out[at // (2 * parts) + 1] = z
        bounded = np.where(np.abs(out) < 1e6, out, np.inf)
        return [tuple(np.moveaxis(bounded[..., i], 0, -1)) for i in range(out.shape[3])]

    def _support(self, part: SupportEffect, state: JointState, shapes: Sequence[Shape]) -> list[Array]:
        """Return the torque that the joint loses because its support gives way, driven by the motion, at each shape, shape (r, n, 1)."""
        k, d = self.scales.stiffness, self.scales.damping
        _, p = self._sets(part, Split((), tuple(part.parameters), ()), shapes)

        def acceleration(m: Any, joint: JointState, z: Sequence[Any], p: Mapping[str, Array]) -> Any:
            pull = -k * (joint.tilt - z[0]) - d * (joint.rate - z[1])
            return part.acceleration(m, z[0], z[1], pull, p)

        hold = self.motion.hold[:, None] * self.motion.amplitude
        start = part.states[0].start(NUMPY, hold, 0.0, k, p) + 0.0 * hold
        rates = (lambda m, joint, z, p: z[1], acceleration)
        moved = self._moved([start, 0.0 * start], rates, state, p, 1)
        return [-(k * s + d * v)[..., None] / self.unit for s, v in moved]


SUBSTEPS = 3
"""Steps of a law's states between two nodes."""


def _between(state: JointState, parts: int) -> list[JointState]:
    """Return the states between the nodes, `parts` times two a step."""
    shares = np.arange(2 * parts) / (2 * parts)
    each = (
        (a[:, :-1, None] + np.diff(a, axis=1)[..., None] * shares).reshape(len(a), -1).T[..., None]
        for a in (state.tilt, state.rate, state.roll)
    )
    return [JointState(x, v, roll, state.stiffness) for x, v, roll in zip(*each, strict=True)]
