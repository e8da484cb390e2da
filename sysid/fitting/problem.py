"""From releases to normal equations: single shooting with exact sensitivities.

All releases share the physics; each has its own roll and rate at release, its own internal states, and
on request its own sensor bias. Unknowns are scaled by their sizes, so that one is a large change of any.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from sysid.effects._algebra import Numbers
from sysid.effects._base import Effect, Scales, SensorEffect, Smoothness
from sysid.fitting.records import LETTING_GO, UNSURE_START, Bias, Record, first_from, measured_rest
from sysid.joint.hermite import hermite_matrix
from sysid.joint.integrator import Buffered, Rollout, build_block, build_initial, build_stepper, steps_for
from sysid.joint.sensor import at_samples, clock_ratio, reader
from sysid.joint.structure import Structure
from sysid.least_squares import Minimum, Normal, minimise
from sysid.quantity import SURE
from sysid.roll import Array, Release

ZERO_TABLE_WEIGHT = 1e12
"""Weight of a table that is zero, and of the part that spring and damper hold."""
_ROUGH = 1e-3
"""Relative fall of the cost that is not noticed far above the noise: of a dozen independent values, 0.006 nats."""


@dataclass(frozen=True, slots=True)
class _Shooting:
    """Integrates one record's motion, with sensitivities, and reads it off at the record's samples."""

    begin: Buffered
    """(parameters, unknowns, hold) → state and sensitivities at release."""
    path: Rollout
    at: Any
    """Sparse matrix from grid values and slopes to samples, shape (n, 2 steps)."""
    hold: float
    """Time of the hold before the release [s]."""
    clock: Array
    """Time of the samples on the log's clock [s], shape (n,)."""
    reader: Buffered | None
    """The sensor's effect on samples; None without one."""

    def read(self, vector: Array, own: Array, step: float) -> Array:
        """Return values and sensitivities, shape (n, 1 + fitted parameters + unknowns), in SI, as the parameters are, shape (p,).

        Each record's own, shape (u,), is roll, rate and free internal states at release; the step is the integration's [s].
        """
        parameters, unknowns, hold = self.begin.inputs
        parameters[:], unknowns[:], hold[:] = vector, own, self.hold
        self.begin.run()
        grid = self.path(self.begin.outputs[0], np.concatenate((vector, (step,))))
        with np.errstate(all="ignore"):
            return np.asarray(self.at @ grid)


@dataclass(frozen=True, slots=True)
class _Start:
    """How fast one record may start."""

    unsure: float
    """How well the instant of the release is known [s]; 0 where it was no release from rest."""
    pull: float
    """Acceleration with which it sets off [rad/s²]."""
    std: float
    """Noise of a sample [rad]; of a rate, as a swing at the joint's frequency."""
    inward: float
    """Sign of a rate towards the rest angle."""


@dataclass
class Problem:
    """Least squares of one structure on some records.

    The vector of unknowns holds the free parameters of the joint, then each record's roll, rate, free internal states and, with bias
    'per-release', its bias. Each is in units of its size.
    """

    structure: Structure
    records: Sequence[Record]
    scales: Scales
    bias: Bias = "shared"
    fixed: Mapping[str, float] = field(default_factory=dict[str, float])
    """Parameters held at a value, by the structure's names."""
    bounded: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    """Bounds of free parameters instead of their own, in their units."""
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    """Priors of free parameters: value and standard deviation, in their units."""
    free_states: bool = True
    steps_per_period: int = 40
    smoothing: tuple[float, ...] = ()
    """Weight of each part of a learned torque, by which its roughness counts as a measurement."""

    def with_(self, **changes: Any) -> "Problem":
        """Return the problem with some of its fields changed."""
        return replace(self, **changes)

    def of(self, kept: Sequence[int], point: Array) -> tuple["Problem", Array]:
        """Return the problem of some of its records, and the same point in it, in units of the unknowns' sizes, shape (p,)."""
        some = self.with_(records=[self.records[i] for i in kept])
        return some, np.r_[point[: len(self.names)], self.own(point)[kept].ravel()]

    def fitted(
        self, start: Array, iterations: int = 60, tolerance: float | Callable[[float], float] | None = None
    ) -> Minimum:
        """Return the minimum that a search from some unknowns reaches.

        Args:
            start: In units of their sizes, shape (p,).
            tolerance: Relative fall of the cost at which it ends [1], or what says it of a cost; `unnoticed` if left out.
        """
        small = self.unnoticed if tolerance is None else tolerance
        low, high = self.bounds()
        if not self.smoothing:
            return minimise(
                self.normal, start, low, high, iterations=iterations, tolerance=small, abandons=True
            )
        turn = self._turn

        def turned(normal: Normal) -> Normal:
            return Normal(normal.cost, turn.T @ normal.gradient, turn.T @ normal.hessian @ turn)

        alone = np.arange(turn.shape[1]) < len(turn) - sum(len(mine) for _, mine in self._tables)
        ends = [np.where(alone, turn.T @ end, side) for end, side in ((low, -np.inf), (high, np.inf))]
        found = minimise(
            lambda z, most=np.inf: turned(self.normal(turn @ z, most)), turn.T @ start, *ends, iterations=iterations,
            tolerance=small, abandons=True,
        )  # fmt: skip
        point, at_bound = turn @ found.point, (turn[:, alone] @ found.at_bound[alone]) > 0
        return Minimum(point, self.normal(point), found.status, found.evaluations + 1, at_bound)

    @property
    def step(self) -> float:
        """Integration step [s]."""
        return 2 * np.pi / self.scales.frequency / self.steps_per_period

    @cached_property
    def _shootings(self) -> list[_Shooting]:
        """Grids, functions and buffers: made when first needed."""
        stepper = build_stepper(self.structure, free_states=self.free_states, sensitivities=True)
        begin, block = Buffered(stepper.initial), Buffered(build_block(stepper))
        shootings: list[_Shooting] = []
        sensed = bool(at_samples(self.structure))
        ratio = clock_ratio(self.structure, self.fixed)
        for record in self.records:
            time, release = record.time / ratio, record.release
            steps = steps_for(float(time[-1]), self.step)
            slopes = (False, True) if sensed else (record.is_rate,)
            at = _on_grid(time.tobytes(), self.step, steps, slopes)
            read = reader(self.structure).map("readings", "serial", len(time), [3], []) if sensed else None
            shootings.append(
                _Shooting(
                    begin=begin, path=Rollout(stepper, steps, block), at=at, hold=max(release.hold, 0.0),
                    clock=record.time + float(release.time[0]), reader=None if read is None else Buffered(read),
                )
            )  # fmt: skip
        return shootings

    @cached_property
    def _starts(self) -> list[_Start]:
        """Known from the releases alone, so that whoever asks for them need not build the joint's functions."""
        starts: list[_Start] = []
        for record in self.records:
            release = record.release
            sampling = float(np.median(np.diff(release.time[:32])))
            pull = self.scales.frequency**2 * release.amplitude
            if self.structure.acts_during_hold:  # else only the spring has set it off
                pull = max(pull, _first_pull(release))
            std = record.std / (self.scales.frequency if record.is_rate else 1.0)
            # The noise hides what the pull moves it by until then, too.
            unseen = float(np.sqrt(2 * std / max(pull, 1e-300)))
            unsure = max(UNSURE_START, 0.5 * sampling, unseen)
            inward = -float(np.sign(release.roll[0] - release.rest))
            starts.append(_Start(unsure if release.hold > 0 else 0.0, pull, std, inward))
        return starts

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The structure's parameters that are free."""
        return tuple(n for n in self.structure.fitted if n not in self.fixed)

    @cached_property
    def _parameters(self) -> tuple[str, ...]:
        """All of the structure's, free or not."""
        return self.structure.parameters

    @property
    def n_local(self) -> int:
        """Number of local unknowns of each record."""
        return self._motion + (self.bias == "per-release")

    @cached_property
    def _motion(self) -> int:
        """How many of them are roll, rate and internal states."""
        return 2 + (len(self.structure.internal_states) if self.free_states else 0)

    @cached_property
    def _columns(self) -> list[int]:
        """Columns of a reading that are wanted: the reading, the free parameters, the record's own motion."""
        every = self.structure.fitted
        free = [1 + i for i, n in enumerate(every) if n not in self.fixed]
        return [0, *free, *range(1 + len(every), 1 + len(every) + self._motion)]

    @cached_property
    def places(self) -> list[tuple[Any, Any]]:
        """Places of each record's columns among the unknowns, and its block of the normal equations."""
        shared, own = np.arange(len(self.names)), self.n_local
        starts = len(shared) + own * np.arange(len(self.records))
        places = [np.r_[shared, start : start + own] for start in starts]
        return [(where, np.ix_(where, where)) for where in places]

    @cached_property
    def _products(self) -> list[Array]:
        """Scales of the products of a record's rows, to units of noise and sizes, shape (1 + free + own,) * 2 each."""
        rows = [
            np.r_[1.0, self.sizes()[where]] / record.std
            for record, (where, _) in zip(self.records, self.places, strict=True)
        ]
        return [np.outer(row, row) for row in rows]

    @property
    def samples(self) -> int:
        """Number of residuals."""
        return sum(len(record.time) for record in self.records)

    def unnoticed(self, cost: float) -> float:
        """Return the relative fall of a cost that is insignificant [1].

        At the noise, it is a fiftieth of the chance gain of one parameter. Far above the noise the residual is the law's error, and alike
        in each swing: few independent values, however many samples there are.
        """
        used = max(1, self.samples)
        beyond = max(1.0 - 0.5 * used / cost, 0.0) if cost > 0 else 0.0
        return max(1e-5, 0.02 / used) + _ROUGH * beyond**2

    def sizes(self) -> Array:
        """Return the size of each unknown in its own unit, shape (p,)."""
        return self._sizes

    @cached_property
    def _sizes(self) -> Array:
        s = self.scales
        known = {"stiffness": s.stiffness, "damping": s.stiffness / s.frequency, "rest_angle": s.amplitude}
        for part in self.structure.parts:
            known.update({f"{part.name}.{p.name}": p.size(s) for p in part.parameters})
        own = [s.amplitude, s.rate]
        if self.free_states:
            own += [state.size(s) for state in self.structure.internal_states]
        own += [s.rate if self.records[0].is_rate else s.amplitude] if self.bias == "per-release" else []
        return np.array([known[name] for name in self.names] + own * len(self.records))

    def bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds in units of the sizes, shape (p,) each, which are the caller's to change."""
        low, high = self._bounds
        return low.copy(), high.copy()

    @cached_property
    def _bounds(self) -> tuple[Array, Array]:
        # A spring may push (gravity outweighs it, or a bend of another law is taken for one); nothing passive drives.
        rests = [measured_rest([record]) / self.scales.amplitude for record in self.records]
        # A sensor that drifts from release to release has drifted from the log's first sample on.
        room = 2.0 + max(rests) - min(rests)
        known = {
            "stiffness": (-3.0, 50.0), "damping": (0.0, 20.0), "rest_angle": (min(rests) - room, max(rests) + room)
        }  # fmt: skip
        for part in self.structure.parts:
            known.update({f"{part.name}.{p.name}": (p.low, p.high) for p in part.parameters})
        others = (
            [(-state.most, state.most) for state in self.structure.internal_states]
            if self.free_states
            else []
        )
        own: list[tuple[float, float]] = []
        for rest, zero in zip(rests, self._zeros, strict=True):
            at = zero / self.sizes()[-1] if self.bias == "per-release" else 0.0
            own += [(rest - at - 4.0, rest - at + 4.0), (-4.0, 4.0), *others]
            own += [(at - 2.0, at + 2.0)] if self.bias == "per-release" else []
        pairs = np.array([known[name] for name in self.names] + own)
        for index, name in enumerate(self.names):
            if name in self.priors:  # small swings are no bound for a stop that wide ones have met
                value, std = self.priors[name]
                low, high = np.array([value, value + SURE * std]) / self.sizes()[index]
                pairs[index] = min(pairs[index, 0], low), max(pairs[index, 1], high)
            if name in self.bounded:
                pairs[index] = np.array(self.bounded[name]) / self.sizes()[index]
        return pairs[:, 0], pairs[:, 1]

    @cached_property
    def _first_motions(self) -> list[tuple[float, float]]:
        """Roll [rad] and rate [rad/s] of each record at its release, as its first samples have them."""
        firsts = [_first_motion(record) for record in self.records]
        return [(roll - zero, rate) for (roll, rate), zero in zip(firsts, self._zeros, strict=True)]

    @cached_property
    def _zeros(self) -> list[float]:
        """Zero of the sensor in each record [rad], if each has its own: its rest is then that of the law. Else 0."""
        held = self.fixed.get("rest_angle")
        if self.bias != "per-release" or held is None or self.records[0].is_rate:
            return [0.0] * len(self.records)
        return [measured_rest([record]) - held for record in self.records]

    @cached_property
    def _delays(self) -> list[tuple[Effect, Callable[[float, float, Numbers], float]]]:
        """How long each filter hides a release, from its pull, the noise and the effect's parameters."""
        states = [(part, state.detection_delay) for part in self.structure.parts for state in part.states]
        return [(part, delay) for part, delay in states if delay is not None]

    def start(
        self, parameters: Mapping[str, float], starts: Sequence[tuple[float, float]] | None = None
    ) -> Array:
        """Return unknowns for given parameters, in units of their sizes, shape (p,).

        Args:
            parameters: In their units.
            starts: Roll [rad] and rate [rad/s] at each release; from the records themselves, if left out.
        """
        values = [parameters[name] for name in self.names]
        for record, own, zero in zip(self.records, starts or self._first_motions, self._zeros, strict=True):
            own = list(own)
            if self.free_states and self.structure.internal_states:
                held = build_initial(self.structure, free_states=False, sensitivities=False)
                start = np.asarray(
                    held(self.vector_of(parameters, record), own, max(record.release.hold, 0.0))
                ).ravel()[2:]
                kept = [
                    not isinstance(part, SensorEffect) for part in self.structure.parts for _ in part.states
                ]
                own += list(start[kept])
            values += own + ([zero] if self.bias == "per-release" else [])
        return np.array(values) / self.sizes()

    def vector_of(self, parameters: Mapping[str, float], record: Record | None = None) -> Array:
        """Return the structure's parameters in their units, shape (k,), inertia first; as they were for a record, if one is given."""
        known = {} if record is None else record.release.known
        full = {"inertia": self.scales.inertia, **parameters, **self.fixed, **known}
        return np.array([full[name] for name in self._parameters])

    def parameters(self, unknowns: Array) -> dict[str, float]:
        """Return all parameters in their units by name, without the inertia, from unknowns in their sizes, shape (p,)."""
        count = len(self.names)
        values = unknowns[:count] * self.sizes()[:count]
        return {**dict(zip(self.names, map(float, values), strict=True)), **self.fixed}

    def own(self, unknowns: Array) -> Array:
        """Return each record's own: roll, rate, free internal states, the sensor's zero, in the unknowns' units, shape (records, n_local)."""
        return unknowns[len(self.names) :].reshape(len(self.records), self.n_local)

    def starts(self, unknowns: Array) -> list[tuple[float, float]]:
        """Return roll [rad] and rate [rad/s] of each record at its release, from unknowns in units of their sizes, shape (p,)."""
        return [(float(roll), float(rate)) for roll, rate, *_ in self.own(unknowns * self.sizes())]

    def residuals(self, unknowns: Array) -> list[Array]:
        """Return model minus measurement [rad or rad/s], shape (n,) of each record, at unknowns in units of their sizes."""
        return [pair[0] for pair in self.linearise(unknowns)]

    def linearise(self, unknowns: Array) -> list[tuple[Array, Array]]:
        """Return residual [rad or rad/s], shape (n,), and Jacobian, shape (n, free + own), of each record; not scaled.

        The Jacobian's columns are the free parameters and then the record's own unknowns. The point is in units of their sizes.
        """
        return [(rows[:, 0], rows[:, 1:]) for rows in self._rows(unknowns)]

    def _rows(self, unknowns: Array) -> Iterator[Array]:
        """Yield each record's residual beside its Jacobian, as `linearise` has them, shape (n, 1 + free + own)."""
        parameters = self.parameters(unknowns)
        own = self.own(unknowns * self.sizes())
        for shooting, record, mine in zip(self._shootings, self.records, own, strict=True):
            vector = self.vector_of(parameters, record)
            at = shooting.read(vector, mine[: self._motion], self.step)
            if len(self._columns) < at.shape[1]:
                at = at[:, self._columns]
            if shooting.reader is not None:
                at = self._read(shooting.reader, shooting.clock, at, vector)
            at[:, 0] -= record.signal
            if self.bias == "per-release":
                at[:, 0] += mine[-1]
                at = np.column_stack([at, np.ones(len(at))])
            yield at

    def _read(self, reader: Buffered, clock: Array, at: Array, vector: Array) -> Array:
        """Apply what the sensor does to samples: from angles above rates, shape (2n, c), to its reading, shape (n, c)."""
        n, is_rate = len(clock), int(self.records[0].is_rate)
        angle, rate = at[:n], at[n:]
        for given, values in zip(reader.inputs, (angle[:, 0], rate[:, 0], clock, vector), strict=True):
            given[:] = values
        reader.run()
        reading, slopes = reader.outputs
        by = slopes.reshape(n, -1, 2)[:, :, is_rate]
        with np.errstate(all="ignore"):  # a joint that runs away; `normal` refuses it
            result = by[:, :1] * angle + by[:, 1:2] * rate
        result[:, 0] = reading.reshape(n, 2)[:, is_rate]
        result[:, 1 : 1 + len(self.names)] += by[:, [1 + self._parameters.index(n) for n in self.names]]
        return result

    @cached_property
    def prior(self) -> Array:
        """Prior of the free parameters: inverse covariance about `centre`, in units of their sizes, shape (free, free).

        Tables are smooth. They have no part that spring and damper hold.
        """
        at = {name: i for i, name in enumerate(self.names)}
        known = np.zeros((len(at), len(at)))
        for smooth, mine in self._tables:
            beyond = np.eye(len(mine)) - smooth.space @ smooth.space.T
            form = (smooth.space * smooth.weighted(self.smoothing)) @ smooth.space.T
            known[np.ix_(mine, mine)] += form + ZERO_TABLE_WEIGHT * beyond
        for name, (_, std) in self.priors.items():
            if name in at:
                known[at[name], at[name]] += (self.sizes()[at[name]] / std) ** 2
        return known

    @cached_property
    def _tables(self) -> list[tuple[Smoothness, npt.NDArray[np.intp]]]:
        """The priors of free tables, and where their values are among the unknowns."""
        at = {name: i for i, name in enumerate(self.names)}
        parts = [(p.name, p.smoothness()) for p in self.structure.torques if p.smoothness and self.smoothing]
        each = [(s, [at[key] for name in s.names if (key := f"{part}.{name}") in at]) for part, s in parts]
        return [(smooth, np.array(mine)) for smooth, mine in each if len(mine) == len(smooth.names)]

    @cached_property
    def _turn(self) -> Array:
        """Unknowns from those of a search, shape (p, m): tables in the coordinates of their prior, without parts that are zero."""
        columns = np.eye(len(self.sizes()))
        for smooth, mine in self._tables:
            kept = np.array(self.smoothing)[smooth.part] < ZERO_TABLE_WEIGHT
            own = np.zeros((len(columns), int(kept.sum())))
            own[mine] = smooth.space[:, kept]
            columns = np.column_stack([np.delete(columns, mine, axis=1), own])
        return columns

    @cached_property
    def centre(self) -> Array:
        """Prior means of the free parameters, in units of their sizes, shape (free,); zero without a prior."""
        known = [self.priors[name][0] if name in self.priors else 0.0 for name in self.names]
        return np.array(known) / self.sizes()[: len(self.names)]

    def normal(self, unknowns: Array, most: float = np.inf) -> Normal:
        """Return cost and normal equations at unknowns in units of their sizes, shape (p,), residuals in units of their noise.

        Priors count as residuals. A cost above `most` is infinite, and so is that of a motion that diverges: the other
        records are not integrated then.
        """
        shared, sizes = len(self.names), self.sizes()
        gradient = np.zeros(len(sizes))
        hessian = np.zeros((len(sizes), len(sizes)))
        known = self.prior @ (unknowns[:shared] - self.centre)
        cost = 0.5 * float((unknowns[:shared] - self.centre) @ known)
        gradient[:shared] += known
        hessian[:shared, :shared] += self.prior
        for index, rows in enumerate(self._rows(unknowns)):
            with np.errstate(all="ignore"):
                products = rows.T @ rows
                products *= self._products[index]
            if not np.isfinite(products).all():
                return Normal(np.inf, gradient, hessian)
            where, block = self.places[index]
            inward, slope = self._inward(index, unknowns)
            rate = where[shared + 1]
            cost += 0.5 * float(products[0, 0]) + 0.5 * inward**2
            if cost > most:
                return Normal(np.inf, gradient, hessian)
            gradient[where] += products[0, 1:]
            gradient[rate] += slope * inward
            hessian[block] += products[1:, 1:]
            hessian[rate, rate] += slope**2
        return Normal(cost, gradient, hessian)

    def _inward(self, index: int, unknowns: Array) -> tuple[float, float]:
        """Return how much faster than from rest a record starts, in deviations, and its slope with the rate.

        A deck that was held starts at rate zero. A hand may drag and delay it, so only a start towards the rest angle counts. It is
        compared with the rate that the pull makes in the time by which the release is uncertain. Otherwise a stop that acts for some
        milliseconds would pass for a push.
        """
        at = len(self.names) + index * self.n_local + 1
        if self._starts[index].inward * unknowns[at] <= 0:
            return 0.0, 0.0
        sign, spread = self.start_limit(index, unknowns)
        slope = sign * float(self.sizes()[at]) / spread
        return slope * unknowns[at], slope

    def start_limit(self, index: int, unknowns: Array) -> tuple[float, float]:
        """Return the sign of a record's rate towards rest, and by how much it may start so: a deviation [rad/s], inf if pushed.

        The unknowns are in units of their sizes, shape (p,).
        """
        begin = self._starts[index]
        late = begin.unsure
        if late == 0 or begin.pull == 0:
            return begin.inward, float("inf")
        for part, delay in self._delays:  # a filter hides the first of a start
            own = part.of(self.parameters(unknowns))
            late = float(np.hypot(late, delay(begin.pull, begin.std, own)))
        return begin.inward, late * begin.pull


def starts_unknown(structure: Structure, records: Sequence[Record]) -> bool:
    """Return whether internal states at release are free: a hold before each release would fix them."""
    return bool(structure.internal_states) and any(record.release.hold <= 0 for record in records)


def _first_pull(release: Release) -> float:
    """Return the acceleration with which a release sets off [rad/s²]: a stop that it leans on pulls hardest."""
    time = release.time - release.time[0]
    first, last = first_from(time, 1.5 * LETTING_GO), first_from(time, 5 * LETTING_GO)
    gone = np.abs(release.roll[first : last + 1] - release.roll[0]) - 3 * float(np.median(release.std))
    return float(np.max(2 * gone / time[first : last + 1] ** 2, initial=0.0))


@lru_cache(maxsize=512)
def _on_grid(time: bytes, step: float, steps: int, slopes: tuple[bool, ...]) -> Any:
    """Return the sparse matrix from values and slopes on a grid to samples; it is kept, as every law is read at the same samples.

    Args:
        time: Of the samples [s], the memory of shape (n,).
        step: Of the grid [s].
        steps: Points of the grid.
        slopes: For each block of n rows, whether slopes are wanted.
    """
    from scipy.sparse import vstack

    at = np.frombuffer(time)
    return vstack([hermite_matrix(at, step, steps, slope=slope) for slope in slopes], "csr")


def _first_motion(record: Record) -> tuple[float, float]:
    """Return roll and rate at release from a parabola through the first samples."""
    release = record.release
    if record.is_rate:
        return float(release.roll[0]), float(np.median(record.signal[:3]))
    span = max(5, first_from(record.time, 0.01))
    t, y = record.time[:span], record.signal[:span]
    fit = np.polynomial.polynomial.polyfit(t, y, min(2, len(t) - 1))
    return float(fit[0]), float(fit[1]) if span > 12 else 0.0
