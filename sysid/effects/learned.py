"""A learned torque over tilt and rate, as tables that the fit fills.

The torque is `τ = f(x) + g(v) + h(x, v)`, with f(0) = g(0) = h(0, v) = h(x, 0) = 0. Each part is a smooth curve or surface through a
table of torques. Parts that are linear in x or v belong to the joint's spring and damper. The support is the measured range of tilt
and rate; beyond it the torque is that of its edge.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from operator import attrgetter

import numpy as np

from sysid.effects._algebra import NUMPY, Algebra, Numbers, Value, Values
from sysid.effects._base import (
    JointState,
    MjsJoint,
    MjSpec,
    MujocoSupport,
    Parameter,
    Smoothness,
    ToMjcf,
    TorqueEffect,
)
from sysid.effects._mjcf import UNREACHABLE_TILT, add_tendon, rest_of
from sysid.effects._table import bending, cardinals, knots, position, table_value
from sysid.errors import SysidError
from sysid.roll import Array

TILT_KNOTS, TILT_GRADING = 20, 1.0
"""Knots of a side, and grading [1]: enough for a magnet a fifth as wide as the swing, or four waves of cogging, to 1 %."""
RATE_KNOTS, RATE_GRADING = 8, 0.5
"""Knots of a side, and grading [1]: dense near the turning points, for friction."""
BOTH_KNOTS = 3
"""Knots of a side for tilt and rate together: enough for every product of powers up to the second."""
_WIDE = 0.6
"""Range of a law's table for a joint without a range [rad]."""
SUPPORT = ("tilt_low", "tilt_high", "rate_low", "rate_high")


def _numbers(n: int) -> list[int]:
    return [j for j in range(-n, n + 1) if j != 0]


TILT = tuple(f"tilt_{j}" for j in _numbers(TILT_KNOTS))
RATE = tuple(f"rate_{j}" for j in _numbers(RATE_KNOTS))
BOTH = tuple(f"both_{i}_{j}" for i in _numbers(BOTH_KNOTS) for j in _numbers(BOTH_KNOTS))
TABLES = (*TILT, *RATE, *BOTH)


def torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    """Return f(x) + g(v) + h(x, v) [N*m]."""
    weights = _weights(m, motion.tilt, motion.rate, parameters)
    return sum(parameters[name] * weight for name, weight in zip(TABLES, weights, strict=True))


def _weights(m: Algebra, tilt: Value, rate: Value, support: Values) -> list[Value]:
    """Return how much each table value counts at a tilt [rad] and a rate [rad/s], both clipped to the support."""

    def share(value: Value, name: str) -> Value:
        low, high = support[f"{name}_low"], support[f"{name}_high"]
        return m.maximum(low, m.minimum(high, value)) / m.maximum(-low, high)

    x, v = share(tilt, "tilt"), share(rate, "rate")
    rows, columns = cardinals(m, x, BOTH_KNOTS), cardinals(m, v, BOTH_KNOTS)
    return [
        *cardinals(m, position(m, x, TILT_GRADING), TILT_KNOTS),
        *cardinals(m, position(m, v, RATE_GRADING), RATE_KNOTS),
        *(row * column for row in rows for column in columns),
    ]


def basis(tilt: Array, rate: Array, support: Values) -> Array:
    """Return how much each table value counts at tilts [rad] and rates [rad/s], shape (n,) each, as shape (n, p)."""
    return np.column_stack(_weights(NUMPY, tilt, rate, support))


@cache
def smoothness() -> Smoothness:
    """Return the prior: the odd and the even part of each table are smooth, each by a weight of its own.

    Most laws are odd: they act alike to both sides. The table over both is split by the rate: damping is odd in it.
    """
    from scipy.linalg import block_diag

    plain, each = bending(BOTH_KNOTS), np.eye(2 * BOTH_KNOTS)
    rough = (bending(TILT_KNOTS), bending(RATE_KNOTS), np.kron(plain, each) + np.kron(each, plain))
    mirrors = (np.eye(len(TILT))[::-1], np.eye(len(RATE))[::-1], np.kron(each, each[::-1]))
    linear = (knots(TILT_KNOTS, TILT_GRADING), knots(RATE_KNOTS, RATE_GRADING), None)
    spaces: list[Array] = []
    values: list[Array] = []
    for form, mirror, held in zip(rough, mirrors, linear, strict=True):
        own: list[Array] = []
        for sign in (-1.0, 1.0):
            free = _range_of(np.eye(len(form)) + sign * mirror)
            if held is not None and sign < 0:  # spring and damper are odd
                along = free.T @ held / np.linalg.norm(free.T @ held)
                free = free @ _range_of(np.eye(free.shape[1]) - np.outer(along, along))
            roughness, turn = np.linalg.eigh(free.T @ form @ free)
            own.append(free @ turn)
            values.append(roughness)
        spaces.append(np.column_stack(own))
    part = np.repeat(np.arange(len(values)), [len(v) for v in values])
    return Smoothness(
        names=TABLES,
        space=np.asarray(block_diag(*spaces)),
        roughness=np.concatenate(values),
        part=part,
    )


def _range_of(symmetric: Array) -> Array:
    """Return an orthonormal basis of the range of a symmetric matrix."""
    values, vectors = np.linalg.eigh(symmetric)
    return vectors[:, values > 0.5 * values[-1]]


NUMERIC = "_learned_torque"
"""Custom numbers of a model, after the joint's name: rest angle, the damper's polynomial in place of g, support and tables."""


def to_mjcf(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
    """Write f as slack tendons, g as the nearest polynomial damper, and the tables for `Remainder`."""
    rest = rest_of(spec, joint)
    at, torques = _bends(parameters)
    earlier = sum(NUMERIC in other.name for other in spec.numerics)
    count = 0
    for side in (1, -1):
        mine = np.flatnonzero(side * at >= 0)[::side]  # outwards from the rest
        away, own = side * at[mine], side * torques[mine]
        for bend, change in zip(
            away, np.diff(np.diff(own) / np.diff(away), prepend=0.0, append=0.0), strict=True
        ):
            if abs(change) > 1e-9:  # a change of slope at a knot is a tendon that is slack up to the knot
                slack = sorted((rest - side * UNREACHABLE_TILT, rest + side * bend))
                add_tendon(spec, joint, f"learned{earlier}_{count}", -change, slack)
                count += 1
    damper = _damper(parameters, float(joint.damping[0]))
    for power, coefficient in enumerate(damper):
        joint.damping[power] += coefficient
    numeric = spec.add_numeric(name=f"{joint.name}{NUMERIC}_{earlier}")
    numeric.data = [rest, *damper, *(parameters[p.name] for p in EFFECT.parameters)]
    numeric.size = len(numeric.data)
    return (
        f"learned: {count} slack tendons, straight between the knots of its table over the tilt",
        "learned: the nearest damper's polynomial to its table over the rate; sim.board.learned adds the rest",
    )


GRID = (257, 1025)
"""Points of the remainder's table over tilt and rate."""


@dataclass(frozen=True, slots=True)
class Remainder:
    """Difference of the law and the written model: a linearly interpolated grid over position and rate, and a polynomial."""

    low: tuple[float, float]
    """Lowest position of the joint [rad] and rate [rad/s] of the grid."""
    high: tuple[float, float]
    """Highest ones; the torque is constant beyond the grid."""
    torque: Array
    """[N*m], shape `GRID`."""
    damper: Array
    """The model's coefficients of v, v|v| and v³ in place of g [N*m and rad/s], shape (3,)."""

    @classmethod
    def of(cls, numbers: Array) -> "Remainder":
        """Return the remainder of a model's custom numbers [rad, N*m and rad/s, the parameters' units], shape (n,)."""
        rest, parameters = float(numbers[0]), EFFECT.named([float(n) for n in numbers[4:]])
        ends = [(parameters[f"{n}_low"], parameters[f"{n}_high"]) for n in ("tilt", "rate")]
        tilt, rate = (np.linspace(*end, n) for end, n in zip(ends, GRID, strict=True))
        motion = JointState(tilt[:, None], rate, tilt[:, None] + rest, 0.0)
        whole = torque(NUMPY, motion, parameters, ())
        left = np.asarray(whole - np.interp(tilt, *_bends(parameters))[:, None])
        return cls((rest + tilt[0], rate[0]), (rest + tilt[-1], rate[-1]), left, numbers[1:4].copy())

    def __call__(self, position: float, rate: float) -> float:
        """Return the torque [N*m] at a position of the joint [rad] and a rate [rad/s]."""
        cells: list[tuple[int, float]] = []
        for value, low, high, n in zip((position, rate), self.low, self.high, GRID, strict=True):
            at = (n - 1) * min(max((value - low) / (high - low), 0.0), 1.0)
            cell = min(int(at), n - 2)
            cells.append((cell, at - cell))
        (i, s), (j, t) = cells
        (a, b), (c, d) = self.torque[i : i + 2, j : j + 2].tolist()
        one, two, three = self.damper.tolist()
        left = (1 - s) * ((1 - t) * a + t * b) + s * ((1 - t) * c + t * d)
        return left + rate * (one + two * abs(rate) + three * rate * rate)


def tabulated(law: Callable[[Value, Value], Value], support: Mapping[str, float]) -> Array:
    """Return the values of the tables [N*m] for a law, shape (p,), in the parameters' order.

    Args:
        law: Torque [N*m] of tilt [rad] and rate [rad/s]; zero at rest.
    """
    reach = max(-support["tilt_low"], support["tilt_high"])
    speed = max(-support["rate_low"], support["rate_high"])
    x, v = reach * knots(TILT_KNOTS, TILT_GRADING), speed * knots(RATE_KNOTS, RATE_GRADING)
    shares = np.array(_numbers(BOTH_KNOTS)) / BOTH_KNOTS
    across, along = np.meshgrid(reach * shares, speed * shares, indexing="ij")
    both = law(across, along) - law(across, 0.0 * along) - law(0.0 * across, along)
    return np.concatenate([law(x, 0.0 * x), law(0.0 * v, v), both.ravel()])


def as_table(law: Callable[[Algebra, JointState, Values, Sequence[Value]], Value]) -> ToMjcf:
    """Return a writer for a torque without memory, zero at rest: it becomes the tables of a learned torque."""

    def write(spec: MjSpec, joint: MjsJoint, parameters: Numbers, *, native: bool = False) -> tuple[str, ...]:
        """Write the law as tables over the joint's range."""
        limited = float(np.abs(joint.range).max()) if any(joint.range) else 0.0
        reach = np.radians(limited) if spec.compiler.degree else limited
        reach = float(reach) or _WIDE
        speed = reach * float(np.sqrt(max(joint.stiffness[0], 1e-6) / joint.parent.inertia[0]))

        def at(x: Value, v: Value) -> Array:
            x, v = np.broadcast_arrays(x, v)
            rest = rest_of(spec, joint)
            return np.asarray(
                law(NUMPY, JointState(x, v, x + rest, joint.stiffness[0]), parameters, ()) + 0.0 * x
            )

        if abs(float(at(0.0, 0.0))) > 1e-9:
            raise SysidError(
                f"this torque is {float(at(0.0, 0.0)):.3g} N*m at rest, where a table is zero. Use preload for that part."
            )
        edges: dict[str, float] = dict(zip(SUPPORT, (-reach, reach, -speed, speed), strict=True))
        values = [*edges.values(), *tabulated(at, edges)]
        return to_mjcf(spec, joint, EFFECT.named([float(value) for value in values]), native=native)

    return write


def _bends(parameters: Numbers) -> tuple[Array, Array]:
    """Return the knots of the piecewise linear table over the tilt: tilts [rad] and torques [N*m], shape (n,) each."""
    low, high = parameters["tilt_low"], parameters["tilt_high"]
    at = knots(2 * TILT_KNOTS, TILT_GRADING) * max(-low, high)
    at = np.unique(np.concatenate([[low, 0.0, high], at[(at > low) & (at < high)]]))
    alone = {**parameters, **dict.fromkeys((*RATE, *BOTH), 0.0)}
    return at, np.asarray(torque(NUMPY, JointState(at, 0.0 * at, at, 0.0), alone, ()))


def _polynomial(rate: Value) -> Array:
    return np.stack([rate, rate * np.abs(rate), rate**3], axis=-1)


def _damper(parameters: Numbers, damping: float) -> Array:
    """Return the coefficients of v, v|v| and v³ of the passive damper nearest to g, shape (3,)."""
    from scipy.optimize import lsq_linear

    rate = np.linspace(parameters["rate_low"], parameters["rate_high"], 201)
    alone = {**parameters, **dict.fromkeys((*TILT, *BOTH), 0.0)}
    torques = torque(NUMPY, JointState(0.0 * rate, rate, rate, 0.0), alone, ())
    size = max(float(np.abs(rate).max()), 1e-9) ** np.arange(1, 4)
    found = lsq_linear(-_polynomial(rate) / size, torques, ([-damping * size[0], 0.0, 0.0], np.inf))
    return found.x / size


AS_TABLE = MujocoSupport(
    means=(
        "of the tilt: slack tendons, straight between knots; of the rate: the nearest damper's polynomial; the rest by a "
        "callback (sim.board.learned)"
    ),
)
"""Form of a table in MuJoCo."""


def _edge(name: str) -> Parameter:
    unit, size = ("rad", "amplitude") if name.startswith("tilt") else ("rad/s", "rate")
    start = -1.0 if name.endswith("low") else 1.0
    return Parameter(name, unit, attrgetter(size), low=-4.0, high=4.0, starts=(start,), neutral=None)


_RANGE: dict[str, float] = dict(zip(SUPPORT, (-0.2, 0.2, -8.0, 8.0), strict=True))
_EXAMPLE = tabulated(lambda x, v: -12 * x / (1 + (x / 0.02) ** 2) ** 2 + 0.0 * v, _RANGE)
"""A magnet in the middle of the `pink` board [rad, rad/s, N*m]."""

EFFECT = TorqueEffect(
    name="learned",
    title="a learned torque",
    family="learned",
    role="learned",
    parameters=(*map(_edge, SUPPORT), *map(table_value, TABLES)),
    law="τ = f(x) + g(v) + h(x, v): smooth tables, zero at rest, constant beyond the measured range",
    source="smoothing splines, Wahba (1990); knots joined by Keys' cubic, IEEE Trans. ASSP 29 (1981)",
    does="Any torque of tilt and rate beyond the formulas of the catalogue.",
    look_alikes=(),
    experiment="Release from more angles, to both sides: a table knows only where the joint has been.",
    mujoco=AS_TABLE,
    to_mjcf=to_mjcf,
    example=(*_RANGE.values(), *_EXAMPLE.tolist()),
    torque=torque,
    smoothness=smoothness,
    support=SUPPORT,
)
