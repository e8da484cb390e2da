"""MuJoCo's step of one hinge joint, written in CasADi.

For a single joint MuJoCo's forward dynamics, constraint solver and integrator have a closed form. The smooth torque is a sum.
Friction loss and joint limits make a convex problem in one unknown, solved by a clip and a branch. The step has exact
derivatives with respect to state and parameters, and equals MuJoCo's to rounding.

Source: MuJoCo documentation 4.0, chapters Computation (constraint model, integrators) and Modeling
(solver parameters); every formula is compared with MuJoCo itself in `tests/joint/test_mujoco_step.py`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import casadi as ca
import mujoco

from sysid.errors import SysidError, did_you_mean

Integrator = Literal["Euler", "implicit", "implicitfast", "RK4", "discrete"]
"""MuJoCo's integrators by the name that MJCF gives them."""

Expression = Any
"""A CasADi expression or a float."""

Torque = Callable[[Expression, Expression], Expression]
"""A further smooth torque [N*m] of position [rad] and velocity [rad/s]."""

Pair = tuple[float, float]
Impedance = tuple[float, float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Hinge:
    """One hinge joint as MuJoCo compiles it; numbers may be CasADi symbols unless noted."""

    inertia: Expression
    """Inertia of the moved bodies about the axis, armature excepted [kg*m^2]."""
    armature: Expression = 0.0
    """[kg*m^2]."""
    stiffness: tuple[Expression, Expression, Expression] = (0.0, 0.0, 0.0)
    """Spring polynomial: torque -(a x + b x² + c x³), x measured from `springref`."""
    damping: tuple[Expression, Expression, Expression] = (0.0, 0.0, 0.0)
    """Damper polynomial: torque -(a v + b v abs(v) + c v³)."""
    springref: Expression = 0.0
    """Rest angle of the spring [rad]."""
    frictionloss: Expression = 0.0
    """Dry friction [N*m]; with the float 0.0 there is no friction constraint."""
    solref_friction: tuple[float, float] = (0.02, 1.0)
    solimp_friction: Impedance = (0.9, 0.95, 0.001, 0.5, 2.0)
    limits: tuple[Expression, Expression] | None = None
    """Lower and upper end of the range [rad]."""
    solref_limit: tuple[float, float] = (0.02, 1.0)
    solimp_limit: Impedance = (0.9, 0.95, 0.001, 0.5, 2.0)
    torque: Torque | None = None
    """Anything else that is smooth, e.g. gravity. MuJoCo treats it explicitly."""
    damper: Torque | None = None
    """Other smooth terms; MuJoCo treats them like the damper, implicit if the damper is."""
    eulerdamp: bool = True
    """MuJoCo's flag of that name: whether Euler treats damping implicitly."""

    @property
    def mass(self) -> Expression:
        """The joint-space inertia [kg*m^2]."""
        return self.inertia + self.armature


def step(
    hinge: Hinge, q: Expression, v: Expression, *, timestep: Expression,
    integrator: Integrator = "implicitfast",
) -> tuple[Expression, Expression]:  # fmt: skip
    """Advance position [rad] and velocity [rad/s] by one MuJoCo step.

    Args:
        q: Position, as qpos [rad].
        v: Velocity, as qvel [rad/s].
        timestep: [s].

    Raises:
        SysidError: The integrator is unknown.
    """
    if integrator == "RK4":
        return _runge_kutta(hinge, q, v, timestep)
    if integrator == "discrete":
        return _discrete(hinge, q, v, timestep)
    if integrator not in get_args(Integrator):
        known = ", ".join(get_args(Integrator))
        raise SysidError(
            f"unknown integrator '{integrator}'.{did_you_mean(integrator, get_args(Integrator))} Known: {known}."
        )
    force = _force(hinge, q, v, timestep)
    # For one joint 'implicit' differs from Euler in the damper only, which Euler treats implicitly too.
    slope = _damping_slope(hinge, q, v)
    if integrator == "Euler":
        slope = ca.if_else(_damps(hinge), slope, 0.0) if hinge.eulerdamp else 0.0
    velocity = v + timestep * force / (hinge.mass + timestep * slope)
    return q + timestep * velocity, velocity


def _smooth(hinge: Hinge, q: Expression, v: Expression) -> Expression:
    """Torque of spring, damper and the rest [N*m]."""
    x = q - hinge.springref
    spring = sum(a * x**n for n, a in enumerate(hinge.stiffness, start=1) if not _zero(a))
    a, b, c = hinge.damping
    damper = a * v + (0.0 if _zero(b) else b * v * ca.fabs(v)) + (0.0 if _zero(c) else c * v**3)
    others = [torque(q, v) for torque in (hinge.torque, hinge.damper) if torque is not None]
    return sum(others, -spring - damper)


def _damping_slope(hinge: Hinge, q: Expression, v: Expression) -> Expression:
    """Derivative of the damper's torque with respect to velocity, positive for braking [N*m*s/rad]."""
    a, b, c = hinge.damping
    more = 0.0 if hinge.damper is None else -ca.jacobian(hinge.damper(q, v), v)
    return a + (0.0 if _zero(b) else 2 * b * ca.fabs(v)) + (0.0 if _zero(c) else 3 * c * v**2) + more


def _damps(hinge: Hinge) -> Expression:
    """Whether any coefficient of the damper is positive: else Euler is explicit."""
    a, b, c = hinge.damping
    return ca.logic_or(ca.logic_or(a > 0, b > 0), c > 0)


def _stiffness_slope(hinge: Hinge, q: Expression) -> Expression:
    """Derivative of the spring's torque with respect to position, positive for restoring [N*m/rad]."""
    x = q - hinge.springref
    a, b, c = hinge.stiffness
    return a + (0.0 if _zero(b) else 2 * b * x) + (0.0 if _zero(c) else 3 * c * x**2)


@dataclass(frozen=True, slots=True)
class _Row:
    """One constraint as the solver sees it."""

    weight: Expression
    """How hard it holds to its reference [kg*m^2]."""
    reference: Expression
    """Acceleration that it wants [rad/s^2]."""
    side: float = 1.0
    """Of a limit: +1 at the lower end, -1 at the upper one."""
    inside: Expression = 0.0
    """Of a limit: distance to it, negative beyond it [rad]."""


def _force(hinge: Hinge, q: Expression, v: Expression, timestep: Expression) -> Expression:
    """Smooth torque and constraint forces: inertia times the acceleration that MuJoCo solves for [N*m]."""

    def row(solref: Pair, solimp: Impedance, distance: Expression, side: float, *, spring: bool) -> _Row:
        impedance = _impedance(solimp, distance)
        pull, damper = _reference(solref, solimp, 2 * timestep)
        reference = -damper * side * v - (pull * impedance * distance if spring else 0.0)
        return _Row(hinge.mass * impedance / (1 - impedance), reference, side, distance)

    friction, limits = _rows(hinge, q, row)
    return hinge.mass * _solved(hinge, _smooth(hinge, q, v), hinge.mass, friction, limits)


def _rows(hinge: Hinge, q: Expression, row: Callable[..., _Row]) -> tuple[_Row | None, list[_Row]]:
    """Return the rows of friction loss and of both limits, as an integrator makes them."""
    friction = None
    if not _zero(hinge.frictionloss):
        friction = row(hinge.solref_friction, hinge.solimp_friction, 0.0, 1.0, spring=False)
    ends = [] if hinge.limits is None else [(1.0, q - hinge.limits[0]), (-1.0, hinge.limits[1] - q)]
    return friction, [
        row(hinge.solref_limit, hinge.solimp_limit, distance, side, spring=True) for side, distance in ends
    ]


def _solved(
    hinge: Hinge, force: Expression, metric: Expression, friction: _Row | None, limits: list[_Row]
) -> Expression:
    """Return the acceleration that minimises ½ m (a - force/m)² + s(a) [rad/s^2].

    Here s is quadratic around each row's reference, with the row's weight. It is linear where friction slips, and zero where a
    limit would pull.
    """

    def slid(force: Expression, mass: Expression) -> Expression:
        if friction is None:
            return force / mass
        stick = friction.weight * (friction.reference * mass - force) / (mass + friction.weight)
        return (force + ca.fmin(ca.fmax(stick, -hinge.frictionloss), hinge.frictionloss)) / mass

    result = slid(force, metric)
    for row in limits:
        held = slid(force + row.weight * row.side * row.reference, metric + row.weight)
        pushes = ca.logic_and(row.inside < 0, row.side * result < row.reference)
        result = ca.if_else(pushes, held, result)
    return result


def _possible(impedance: float) -> float:
    """Return an impedance [1] within MuJoCo's limits."""
    return min(max(impedance, mujoco.mjMINIMP), mujoco.mjMAXIMP)


def _impedance(solimp: Impedance, distance: Expression) -> Expression:
    """MuJoCo's impedance d(r): from d₀ to d_width along a power curve."""
    start, end = map(_possible, solimp[:2])
    width, power = max(solimp[2], 0.0), max(solimp[4], 1.0)
    midpoint = _possible(solimp[3])
    if start == end or width <= mujoco.mjMINVAL:
        return 0.5 * (start + end)
    x = ca.fmin(ca.fabs(distance) / width, 1.0)
    below = x**power / midpoint ** (power - 1)
    above = 1 - (1 - x) ** power / (1 - midpoint) ** (power - 1)
    return start + ca.if_else(x <= midpoint, below, above) * (end - start)


def _reference(solref: Pair, solimp: Impedance, shortest: Expression) -> tuple[Expression, Expression]:
    """Stiffness [1/s²] and damping [1/s] of a row's reference acceleration.

    `shortest` is the least time constant that the flag refsafe allows [s].
    """
    end = _possible(solimp[1])
    if solref[0] <= 0:
        return -solref[0] / end**2, -solref[1] / end
    constant = ca.fmax(solref[0], shortest)
    return 1 / (end * constant * solref[1]) ** 2, 2 / (end * constant)


def _runge_kutta(
    hinge: Hinge, q: Expression, v: Expression, timestep: Expression
) -> tuple[Expression, Expression]:
    """Return the classical fourth-order step; every stage solves the constraints."""

    def rate(q: Expression, v: Expression) -> tuple[Expression, Expression]:
        return v, _force(hinge, q, v, timestep) / hinge.mass

    dq1, dv1 = rate(q, v)
    dq2, dv2 = rate(q + timestep / 2 * dq1, v + timestep / 2 * dv1)
    dq3, dv3 = rate(q + timestep / 2 * dq2, v + timestep / 2 * dv2)
    dq4, dv4 = rate(q + timestep * dq3, v + timestep * dv3)
    return (
        q + timestep / 6 * (dq1 + 2 * dq2 + 2 * dq3 + dq4),
        v + timestep / 6 * (dv1 + 2 * dv2 + 2 * dv3 + dv4),
    )


def _discrete(
    hinge: Hinge, q: Expression, v: Expression, timestep: Expression
) -> tuple[Expression, Expression]:
    """Return the step of MuJoCo's 'discrete': implicit in velocity, in the spring's position, and in each row.

    The solver works in the metric M + h D + h² K. The reference of a row is that of the end of the step, and its weight grows
    in the same proportion. A limit is at most so stiff that one step undoes it.
    """
    slope = ca.fmax(_stiffness_slope(hinge, q), 0.0)
    metric = hinge.mass + timestep * ca.fmax(_damping_slope(hinge, q, v), 0.0) + timestep**2 * slope

    def row(solref: Pair, solimp: Impedance, distance: Expression, side: float, *, spring: bool) -> _Row:
        impedance = _impedance(solimp, distance)
        end = _possible(solimp[1])
        most = mujoco.mjMAXIMP / (1 - mujoco.mjMAXIMP) * (1 - impedance) / impedance
        shortest = timestep * ca.sqrt(impedance) / (solref[1] * end) if spring and solref[0] > 0 else 0.0
        pull, damper = _reference(solref, solimp, shortest)
        if spring and solref[0] > 0:
            # A limit that is undone in one step damps no more than the largest weight leaves room for.
            damper = ca.if_else(
                solref[0] < shortest, ca.fmin(damper, ca.fmax(most - 2, 0.0) / timestep), damper
            )
        pull = pull * impedance if spring else 0.0
        ahead = 1 + timestep * damper + timestep**2 * pull
        weight = impedance / (1 - impedance) * ca.fmin(ahead, most)
        reference = (-damper * side * v - pull * (distance + timestep * side * v)) / ahead
        return _Row(metric * weight, reference, side, distance)

    friction, limits = _rows(hinge, q, row)
    free = _smooth(hinge, q, v) - timestep * slope * v
    velocity = v + timestep * _solved(hinge, free, metric, friction, limits)
    return q + timestep * velocity, velocity


def _zero(value: Expression) -> bool:
    return isinstance(value, int | float) and value == 0
