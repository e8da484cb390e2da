"""Output error of a driven joint over windows of a log: residuals, normal equations, covariance.

Each window starts from a state of its own. Short windows tolerate wrong equations; long ones are sharper.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from sysid.driven.joint import GIVEN, Structure, simulate, states_after
from sysid.driven.log import DrivenLog
from sysid.effects._algebra import NUMPY
from sysid.effects._base import Actuation, Scales, State, TorqueEffect
from sysid.joint.hermite import hermite_matrix
from sysid.least_squares import Minimum, Normal, minimise
from sysid.noise.autoregression import residual_noise
from sysid.roll import Array

STEPS_PER_RADIAN = 10
"""Integration steps in a radian of the fastest motion: the error of a step's mean input is then a thousandth."""
GEAR_STEPS, MOST_STEPS, TURNS_FINER = 4, 64, 4
"""Integration steps a sample where a gear rings between samples, and at most; and factor of them where friction turns: of the sampling."""
LIGHT = 0.1
"""Share of torque over acceleration below which an inertia is not the joint's: most of it is then the rotor's, which is not known yet."""
SMALL = float(np.finfo(np.float64).eps ** (1 / 3))
"""Step of a central difference, in sizes, at which rounding and curvature are alike."""
BLOCKS = 32
"""Blocks of a log whose scatter gives a covariance: fewer than 30 are too few (Cameron and Miller, J. Human Resources 50, 2015)."""


@dataclass(kw_only=True, eq=False)
class Problem:
    """Least squares of one structure on one log. Unknowns: free parameters, then each window's first state, in their sizes."""

    log: DrivenLog
    structure: Structure
    values: Mapping[str, float]
    """All parameters; those that are not free stay here."""
    free: tuple[str, ...]
    windows: int = 1
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    finer: int = 1
    """Factor of integration steps."""

    @cached_property
    def scales(self) -> Scales:
        """Sizes of motion and torque."""
        return scales_of(self.log, self.structure, self.values)

    @cached_property
    def grid(self) -> Array:
        """Integration times [s], shape (m + 1,)."""
        return self.log.motion.grid(self.substeps)

    @cached_property
    def substeps(self) -> int:
        """Integration steps a sample: those of a simulator, or enough for the fastest of motion, servo, spring and damper."""
        log, structure, values, scales = self.log, self.structure, self.values, self.scales
        if structure.simulator is not None:
            return structure.simulator.steps(log.step)
        inertia = max(float(np.min(log.load.inertia)) + values["armature"], LIGHT * scales.inertia)
        pairs = [(values["stiffness"], values["damping"])]
        own = [values[f"{structure.source.name}.{p.name}"] for p in structure.source.parameters]
        if len(own) > 1:
            pairs.append((own[0], own[1]))
        rates = [max(np.sqrt(max(gain, 0.0) / inertia), rate / inertia / 2) for gain, rate in pairs]
        geared = GEAR_STEPS * (4 if self.windows == 1 else 1) if structure.gear is not None else 1
        rubs = any(isinstance(part, TorqueEffect) and part.friction is not None for part in structure.parts)
        steps = STEPS_PER_RADIAN * (TURNS_FINER if rubs else 1)
        return self.finer * int(
            np.clip(np.ceil(log.step * max(*rates, scales.frequency) * steps), geared, MOST_STEPS)
        )

    @property
    def h(self) -> float:
        """Integration step [s]."""
        return float(self.grid[1] - self.grid[0])

    @cached_property
    def length(self) -> int:
        """Steps in a window."""
        return (len(self.grid) - 1) // self.windows

    @cached_property
    def places(self) -> list[tuple[int, slice, object]]:
        """First step of each window, its samples, and what takes grid values and slopes to them."""
        found: list[tuple[int, slice, object]] = []
        for number in range(self.windows):
            first = number * self.length
            low, high = self.grid[first], self.grid[first + self.length] + 1e-9
            rows = slice(
                *np.searchsorted(self.log.time, [low - 1e-9, high - (number < self.windows - 1) * self.h / 2])
            )
            found.append(
                (
                    first,
                    rows,
                    hermite_matrix(np.clip(self.log.time[rows] - low, 0, None), self.h, self.length + 1),
                )
            )
        return found

    @property
    def load_time(self) -> Array:
        """Times at which the steps take the load [s], shape (m,)."""
        return self.grid[:-1] + self.structure.middle * self.h / 2

    @cached_property
    def known(self) -> tuple[Array, Array]:
        """Rows of the load for each step, and their ramps, in units of SI, shape (6, m) each."""
        from scipy.interpolate import CubicSpline

        rows = CubicSpline(self.log.load_time, self.log.load.rows, axis=1)
        return rows(self.load_time), np.diff(rows(self.grid), axis=1)

    @cached_property
    def start_states(self) -> Array:
        """First guess of each window's first state, shape (w, s), in units of SI."""
        return np.array([self._first(first) for first, _, _ in self.places])

    def _first(self, first: int) -> Array:
        """Return angle and rate of a short parabola at a step, for rotor and joint alike; effects start at zero."""
        log, at = self.log, float(self.grid[first])
        reach = np.abs(log.time - at) <= max(5 * log.step, 0.1 / self.scales.frequency)
        fit = np.polyfit(log.time[reach] - at, log.angle[reach], min(2, int(reach.sum()) - 1))
        pair = [fit[-1], fit[-2]]
        state = [*pair, *(pair if self.structure.gear is not None else [])]
        return np.array([*state, *np.zeros(self.structure.states - len(state))])

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float, float]]:
        """Size of each parameter in its unit, and its lowest and highest value in that size."""
        s = self.scales
        found = {
            "armature": (s.inertia, 0.0 if self.structure.gear is None else 1e-4, 50.0),
            "stiffness": (s.stiffness, -50.0, 500.0),
            "damping": (s.stiffness / s.frequency, 0.0, 500.0),
            "rest_angle": (s.amplitude, -50.0, 50.0),
            "bias": (s.torque, -50.0, 50.0),
            "zero": (s.amplitude, -50.0, 50.0),
        }
        own = {
            f"{part.name}.{p.name}": (p.size(s), p.low, p.high)
            for part in self.structure.parts
            for p in part.parameters
        }
        return found | own

    def limits_of(self, name: str) -> tuple[float, float]:
        """Return the bounds of a parameter in its unit."""
        size, low, high = self.ranges[name]
        return self.bounds.get(name, (low * size, high * size))

    @cached_property
    def sizes(self) -> Array:
        """Size of each unknown in its unit, shape (p,)."""
        return np.r_[[self.ranges[name][0] for name in self.free], np.tile(self._state_sizes, self.windows)]

    @cached_property
    def _state_sizes(self) -> Array:
        s, gear = self.scales, self.structure.gear is not None
        own: list[State] = [state for part in self.structure.parts for state in part.states]
        return np.array([s.amplitude, s.rate] * (1 + gear) + [state.size(s) for state in own])

    def limits(self) -> tuple[Array, Array]:
        """Return lower and upper bounds in units of the sizes, shape (p,) each."""
        low, high = np.array([self.limits_of(name) for name in self.free]).reshape(-1, 2).T
        wide = np.full(self.windows * self.structure.states, 20.0)
        sizes = self.sizes[: len(self.free)]
        return np.r_[low / sizes, -wide], np.r_[high / sizes, wide]

    def vector(self, point: Array) -> Array:
        """Return all parameters in the structure's order and units, shape (q,), at unknowns, shape (p,)."""
        found = dict(self.values) | dict(zip(self.free, point * self.sizes[: len(point)], strict=False))
        return np.array([found[name] for name in self.structure.parameters])

    @property
    def measured(self) -> int:
        """Place of the angle in the state that the encoder measures."""
        return 2 if self.structure.encoder == "motor" and self.structure.gear is not None else 0

    def residuals(self, point: Array, *, slopes: bool = True) -> tuple[list[Array], list[Array]]:
        """Return measured less simulated, and its Jacobian's rows with the sign of the simulation, for each window.

        Args:
            point: Unknowns in units of their sizes, shape (p,); residuals are in units of the noise, shape (n,) each.
        """
        rest: list[Array] = []
        rows: list[Array] = []
        first = self.measured
        for path, (_, where, matrix) in zip(self.paths(point, slopes=slopes), self.places, strict=True):
            with np.errstate(all="ignore"):
                seen = matrix @ path[:, first : first + 2].reshape(2 * len(path), -1) / self.log.std  # type: ignore[operator]
            rest.append(self.log.angle[where] / self.log.std - seen[:, 0])
            rows.append(seen[:, 1:])
        return rest, rows

    def paths(self, point: Array, *, slopes: bool) -> Iterator[Array]:
        """Yield states, and with `slopes` their derivatives by the unknowns, of each window, in units of SI, shape (steps + 1, s, 1 + p)."""
        p, n = len(self.free), self.structure.states
        vector, given = self.vector(point[:p]), self.given(point)
        free, units = (self.free, self.sizes[: p + n]) if slopes else ((), np.empty(0))
        starts = point[p:].reshape(self.windows, n) * self._state_sizes
        for start, (first, _, _) in zip(starts, self.places, strict=True):
            path = simulate(self.structure, free, start, vector, given[:, first : first + self.length])
            with np.errstate(all="ignore"):
                path[:, :, 1:] *= units if free else 1.0
            yield path if free else path[:, :, :1]

    def given(self, point: Array) -> Array:
        """Return the data of each step in their units, shape (18, m)."""
        delay = 0.0
        if self.structure.delay:
            delay = float(self.vector(point)[list(self.structure.parameters).index(self.structure.delay)])
        mean, ramp, by_delay, ramp_by_delay = self.log.mean_input(self.grid, delay)
        load, rising = self.known
        times = np.array([[self.h], [delay]]).repeat(len(mean), axis=1)
        return np.vstack([times, mean, by_delay, load, ramp, ramp_by_delay, rising])

    def transitions(self, point: Array, states: Array) -> tuple[Array, Array]:
        """Return derivatives of the state after each sample by the state before it and by a constant torque between them, in SI.

        Args:
            point: Unknowns in units of their sizes, shape (p,).
            states: States at the samples, shape (n, s).

        Returns:
            Shapes (n - 1, s, s) and (n - 1, s).
        """
        vector, given = self.vector(point), self.given(point)[:, : (len(states) - 1) * self.substeps]
        rows = np.vstack([states[:-1].T.repeat(self.substeps, axis=1), given])
        places = [*range(states.shape[1]), states.shape[1] + GIVEN.index("load")]
        found: list[Array] = []
        for place, size in zip(places, [*self._state_sizes, self.scales.torque], strict=True):
            ends: list[Array] = []
            for change in (SMALL * size, -SMALL * size):
                moved = rows.copy()
                moved[place] += change
                begin, data = moved[: states.shape[1], :: self.substeps], moved[states.shape[1] :]
                ends.append(states_after(self.structure, begin, vector, data, self.substeps))
            found.append((ends[0] - ends[1]) / (2 * SMALL * size))
        return np.stack(found[:-1]).transpose(2, 1, 0), found[-1].T

    def normal(self, point: Array) -> Normal:
        """Return cost and normal equations at unknowns in units of their sizes, shape (p,); infinite where the motion runs away."""
        rest, rows = self.residuals(point)
        p, n, size = len(self.free), self.structure.states, len(point)
        cost, gradient, hessian = 0.0, np.zeros(size), np.zeros((size, size))
        for number, (r, j) in enumerate(zip(rest, rows, strict=True)):
            where = np.r_[np.arange(p), p + n * number + np.arange(n)]
            with np.errstate(all="ignore"):
                cost += 0.5 * float(r @ r)
                gradient[where] -= j.T @ r
                hessian[np.ix_(where, where)] += j.T @ j
        finite = np.isfinite(cost) and np.all(np.isfinite(hessian))
        return Normal(cost if finite else np.inf, gradient, hessian)

    def begin(self) -> Array:
        """Return unknowns at the given values and the measured motion, in units of their sizes, shape (p,)."""
        shared = np.array([self.values[name] for name in self.free]) / self.sizes[: len(self.free)]
        return np.r_[shared, (self.start_states / self._state_sizes).ravel()]

    def fitted(self, start: Array | None = None, iterations: int = 40, tolerance: float = 1e-6) -> Minimum:
        """Return the minimum from unknowns in units of their sizes, shape (p,)."""
        low, high = self.limits()
        return minimise(
            self.normal,
            self.begin() if start is None else start,
            low,
            high,
            iterations=iterations,
            tolerance=tolerance,
        )

    def covariance(self, minimum: Minimum) -> Array:
        """Return the covariance of the free parameters in their units, shape (p, p): H⁻¹ Jᵀ Ω J H⁻¹.

        Ω is the autoregression of the residuals. With many windows, Jᵀ Ω J is the scatter of the gradient between blocks of
        them (cluster-robust: Liang and Zeger 1986). Parameters on a bound are held; their rows are infinite.
        """
        rest, rows = self.residuals(minimum.point)
        p = len(self.free)
        moving = ~minimum.at_bound[:p]
        clean: list[Array] = []
        for j in rows:  # each window's own first state is taken out
            shared, own = j[:, :p][:, moving], j[:, p:]
            clean.append(shared - own @ np.linalg.lstsq(own, shared, rcond=1e-10)[0])
        whole = np.vstack(clean)
        scale = np.maximum(np.sqrt((whole**2).sum(axis=0)), 1e-150)
        left, singular, right = np.linalg.svd(whole / scale, full_matrices=False)
        sure = singular > 1e-7 * singular[0]
        ends = np.cumsum([len(r) for r in rest])[:-1]
        directions = np.split(left[:, sure], ends)
        back = (right[sure].T / singular[sure]) / scale[:, None]
        small = back @ self._scatter(rest, directions) @ back.T
        lost = np.abs(right[~sure]).max(axis=0) > 1e-3 if (~sure).any() else np.zeros(len(scale), dtype=bool)
        small[lost, lost] = np.inf
        whole_covariance = np.zeros((p, p))
        whole_covariance[np.ix_(moving, moving)] = small
        held = np.flatnonzero(~moving)
        whole_covariance[held, held] = np.inf
        size = self.sizes[:p]
        return whole_covariance * np.outer(size, size)

    def _scatter(self, rest: list[Array], directions: list[Array]) -> Array:
        """Return the covariance of the residuals along orthonormal directions, shape (q, q)."""
        if self.windows < BLOCKS:
            noise = residual_noise(rest, directions)
            return sum((u.T @ noise.applied(u) for u in directions), np.zeros((directions[0].shape[1],) * 2))
        pulls = np.array([u.T @ r for u, r in zip(directions, rest, strict=True)])
        blocks = np.array([one.sum(axis=0) for one in np.array_split(pulls, BLOCKS)])
        return blocks.T @ blocks * BLOCKS / (BLOCKS - 1)


def scales_of(log: DrivenLog, structure: Structure, values: Mapping[str, float]) -> Scales:
    """Return the sizes of a log: motion, inertia, and the torque that its input makes."""
    amplitude, motion = float(np.ptp(log.angle)) / 2, log.motion
    source = structure.source
    own = {p.name: values[f"{source.name}.{p.name}"] for p in source.parameters}
    late = log.late_input(values.get(structure.delay, 0.0))
    acted = source.act(NUMPY, Actuation(late, 0.0, motion.angle, motion.rate), own)
    torque = float(np.quantile(np.abs(motion.filtered(acted)), 0.99)) or 1e-12
    felt = float(np.median(log.load.inertia)) + values.get("armature", 0.0)
    inertia = max(felt, LIGHT * torque / float(np.quantile(np.abs(motion.acceleration), 0.99)))
    return Scales(inertia=inertia, stiffness=torque / amplitude, damping=values.get("damping", 0.0), amplitude=amplitude,
                  duration=log.duration)  # fmt: skip
