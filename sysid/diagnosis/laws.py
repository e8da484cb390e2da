"""Every law of the catalogue as columns of a regression: its torque on the smoothed motion, for a grid of its shape parameters.

A parameter with the unit of a torque or an inertia scales its law; any other one shapes it. So a log is linear in the strengths of all
laws, and any effect file becomes a candidate by being there. States of a law (a bristle, a Maxwell arm, a hanging body) are driven by the
smoothed motion from the hold on.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
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
LINEAR = 30.0
"""A shape parameter whose bounds span a larger ratio is spaced geometrically, another one evenly."""
SPAN = 100.0
"""Ratio of the bounds where the lower one is 0."""
RATIO = 30.0
"""Largest ratio of two strengths of one law, in units of their sizes."""


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
        found: list[Shape] = []
        for axis, (middle, ends) in enumerate(zip(self.values, self.spacing, strict=True)):
            steps = [middle + f * (end - middle) for end in ends for f in (0.25, 0.5, 0.75) if end != middle]
            for value in steps:
                values = (*self.values[:axis], value, *self.values[axis + 1 :])
                quarter = [
                    (b - (b - a) / 4, b + (c - b) / 4) for b, (a, c) in zip(values, self.spacing, strict=True)
                ]
                found.append(Shape(values, self.share / 4, tuple(quarter)))
        quarter = [
            (b - (b - a) / 4, b + (c - b) / 4) for b, (a, c) in zip(self.values, self.spacing, strict=True)
        ]
        return [Shape(self.values, self.share / 4, tuple(quarter)), *found]


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
    ratios: tuple[str, ...]
    """Those that scale with the first strength."""


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
    low = p.low or p.high / SPAN
    return np.linspace(low, p.high, count) if p.high / low <= LINEAR else np.geomspace(low, p.high, count)


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
        self, smoothed: Smoothed, known: Sequence[tuple[TorqueEffect, Mapping[str, float]]]
    ) -> list[Array]:
        """Return the opposing torque over I ω₀² A of effects with given parameters [1], shape (r, n) each."""
        state, spread = self._state(smoothed)
        wide = JointState(
            state.tilt[..., None], state.rate[..., None], state.roll[..., None], state.stiffness
        )
        found: list[Array] = []
        for part, values in known:
            z = (
                self._driven(part, wide, {n: np.array([v]) for n, v in values.items()})[0]
                if part.states
                else ()
            )
            found.append(
                np.where(self.motion.inside, -_torque(part, state, values, z, spread) / self.unit, 0.0)
            )
        return found

    def _state(self, smoothed: Smoothed) -> tuple[JointState, Array]:
        """Return the smoothed motion in SI units, and the deviation of its rate [rad/s]."""
        a = self.motion.amplitude
        rate_unit = a * self.motion.frequency
        state = JointState(
            smoothed.angle * a,
            smoothed.rate * rate_unit,
            smoothed.angle * a + self.motion.rest,
            self.scales.stiffness,
        )
        return state, np.sqrt(smoothed.rate_variance) * rate_unit + 1e-12 * rate_unit

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
                tables = self._support(part, smoothed, shapes)
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
                if not np.isfinite(peaks).all() or peaks.min() < SEEN_TORQUE * max(peaks.max(), SEEN_TORQUE):
                    continue
                yield Term(
                    effect=name, family=part.family, shape=shape, strengths=strengths, columns=columns, unit=unit, signs=signs,
                    parameters=self._parameters(kinds, shape.values), ratios=tuple(p.name for p in kinds.ratios),
                )  # fmt: skip

    def grid(self, part: Effect) -> list[Shape]:
        """Return all shapes of a law, in units of the sizes of its shape parameters."""
        kinds = split(part, self.scales)
        axes = [shape_values(p, self.scales, GRID if i == 0 else COARSE) for i, p in enumerate(kinds.shapes)]
        axes += [np.geomspace(1 / RATIO, RATIO, 2 * GRID if not axes else 2 * COARSE) for _ in kinds.ratios]
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
        sets = [self._parameters(kinds, shape.values) for shape in shapes]
        stacked = {p.name: np.array([one[p.name] for one in sets]) for p in part.parameters}
        wide = JointState(
            state.tilt[..., None], state.rate[..., None], state.roll[..., None], state.stiffness
        )
        states = self._driven(part, wide, stacked) if part.states else [()] * len(sets)
        found: list[Array] = []
        for i, values in enumerate(sets):
            alone = [
                {**values, **{q.name: 0.0 for q in kinds.strengths if q is not p}} for p in kinds.strengths
            ]
            torques = [_torque(part, state, one, states[i], spread) for one in alone or [values]]
            found.append(-np.stack(torques, axis=-1) / self.unit)
        return found

    def _driven(
        self, part: TorqueEffect, state: JointState, p: Mapping[str, Array]
    ) -> list[tuple[Array, ...]]:
        """Return the states of a law at each of g shapes, driven by the motion: a tuple of shape (r, n) each."""
        motion = self.motion
        rows, nodes = motion.reading.shape
        hold = motion.hold[:, None] * motion.amplitude
        still = motion.held[:, None] / motion.frequency
        z = [s.start(NUMPY, hold, still, self.scales.stiffness, p) + 0.0 * hold for s in part.states]
        out = np.zeros((len(z), nodes, rows, len(next(iter(p.values())))))
        h = motion.step / motion.frequency
        tilt = np.concatenate([hold[:, None], state.tilt], axis=1)
        rates: list[Callable[..., Any] | None] = [s.rate for s in part.states]
        parts = 1 if part.states[0].return_map else SUBSTEPS
        h /= parts
        between = [] if part.states[0].return_map else _between(state, parts)
        for j in range(nodes):
            if part.states[0].return_map:
                moved = tilt[:, j + 1] - tilt[:, j]
                z = [
                    s.return_map(NUMPY, zi, moved, p)
                    for s, zi in zip(part.states, z, strict=True)
                    if s.return_map
                ]
            elif j:
                for i in range(2 * (j - 1) * parts, 2 * j * parts, 2):
                    middle = [
                        zi + h / 2 * r(NUMPY, between[i], z, p) for zi, r in zip(z, rates, strict=True) if r
                    ]
                    z = [
                        zi + h * r(NUMPY, between[i + 1], middle, p)
                        for zi, r in zip(z, rates, strict=True)
                        if r
                    ]
            out[:, j] = z
        bounded = np.where(np.abs(out) < 1e6, out, np.inf)
        return [tuple(bounded[k, :, :, i].T for k in range(len(z))) for i in range(out.shape[3])]

    def _support(self, part: SupportEffect, smoothed: Smoothed, shapes: Sequence[Shape]) -> list[Array]:
        """Return the torque that the joint loses because its support gives way, driven by the motion, at each shape, shape (r, n, 1)."""
        motion = self.motion
        k, w = self.scales.stiffness, motion.frequency
        kinds = Split((), tuple(part.parameters), ())
        sets = [self._parameters(kinds, shape.values) for shape in shapes]
        p = {q.name: np.array([one[q.name] for one in sets]) for q in part.parameters}
        d = self.scales.damping
        angle, rate = (
            smoothed.angle[..., None] * motion.amplitude,
            smoothed.rate[..., None] * motion.amplitude * w,
        )
        s = part.states[0].start(NUMPY, motion.hold[:, None] * motion.amplitude, 0.0, k, p)
        v = np.zeros_like(s)
        h = motion.step / w
        out = np.zeros((*smoothed.angle.shape, len(shapes), 2))
        out[:, 0, :, 0] = s

        def pushed(s: Array, v: Array, x: Array, xv: Array) -> Array:
            return part.acceleration(NUMPY, s, v, -k * (x - s) - d * (xv - v), p)

        fast = (k + p[part.series_stiffness]) / p["inertia"] * h * h > FASTEST**2
        fast |= (d + p["damping"]) / p["inertia"] * h > FASTEST
        p = {name: np.where(fast, 1.0, value) for name, value in p.items()}
        for j in range(1, smoothed.angle.shape[1]):
            x, xv = (angle[:, j - 1] + angle[:, j]) / 2, (rate[:, j - 1] + rate[:, j]) / 2
            a = pushed(s, v, angle[:, j - 1], rate[:, j - 1])
            middle, quick = s + h / 2 * v, v + h / 2 * a
            s, v = s + h * quick, v + h * pushed(middle, quick, x, xv)
            out[:, j, :, 0], out[:, j, :, 1] = s, v
        out = np.where(fast[None, None, :, None], np.inf, out)
        torque = -(k * out[..., 0] + d * out[..., 1]) / self.unit
        return [torque[:, :, [i]] for i in range(len(shapes))]


SUBSTEPS = 3
"""Steps of a law's states between two nodes."""
FASTEST = 0.7
"""Natural frequency of a support times the step of the grid, up to which the grid follows it."""
SEEN_TORQUE = 1e-3
"""Peak torque of a law, in units of its size, below which the motion does not show it."""


def _between(state: JointState, parts: int) -> list[JointState]:
    """Return the states between the nodes, `parts` times two a step."""
    shares = np.arange(2 * parts) / (2 * parts)
    each = []
    for a in (state.tilt, state.rate, state.roll):
        early, late = a[:, :-1, None], a[:, 1:, None]
        fine = early + (late - early) * shares[None, None, :, None]
        each.append(fine.reshape(len(a), -1, a.shape[2]).transpose(1, 0, 2))
    return [JointState(x, v, roll, state.stiffness) for x, v, roll in zip(*each, strict=True)]
