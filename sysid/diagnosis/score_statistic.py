"""Is there a torque left in the residual that the joint itself would have answered to?

A residual may be white to the eye and still hold a torque that depends on tilt and rate: mimicked closely, it
leaves a fraction of the noise, spread over the whole decay. So the residual is tested against what small
torques of many shapes would do to this very motion (Rao's score test, 1948): each shape enters the equation of
motion at zero strength, its sensitivity comes out of the integrator, what the fitted parameters can do as well
is taken away, and the rest is regressed on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, MujocoSupport, Parameter, State, TorqueEffect, belongs_to_log
from sysid.fitting.problem import Problem
from sysid.joint.structure import Structure
from sysid.noise.autoregression import ResidualNoise
from sysid.roll import Array

Shape = Callable[[Algebra, Value, Value, Value], Value]
"""Of the algebra, tilt and rate over their largest, and time over the longest release."""
SHAPES: dict[str, Shape] = {
    "x²": lambda m, x, v, t: x * x,
    "x³": lambda m, x, v, t: x**3,
    "x⁵": lambda m, x, v, t: x**5,
    "x|x|": lambda m, x, v, t: x * m.abs(x),
    "|x|": lambda m, x, v, t: m.abs(x),
    "v²": lambda m, x, v, t: v * v,
    "v³": lambda m, x, v, t: v**3,
    "v|v|": lambda m, x, v, t: v * m.abs(v),
    "|v|": lambda m, x, v, t: m.abs(v),
    "x v": lambda m, x, v, t: x * v,
    "|x| v": lambda m, x, v, t: m.abs(x) * v,
    "x² v": lambda m, x, v, t: x * x * v,
    "t x": lambda m, x, v, t: t * x,
    "t v": lambda m, x, v, t: t * v,
}
"""Torques of tilt and rate, odd and even, of the spring's and of the damper's kind; and a board that changes."""


@dataclass(frozen=True, slots=True)
class ScoreTest:
    """What the shapes explain together."""

    statistic: float
    """Fall of χ² that they would make."""
    freedom: int
    """How many of them are not done by the fitted parameters already."""
    probability: float
    """Of at least this by chance."""


def score_test(problem: Problem, point: Array, noise: ResidualNoise | None = None) -> ScoreTest:
    """Test a fit for a torque of tilt and rate that it lacks.

    Args:
        problem: What was fitted.
        point: Where the fit ended, shape (p,).
        noise: Of the sensor, where it is not white.
    """
    from scipy.special import fdtrc

    scales = problem.scales
    fixed = {
        **problem.fixed,
        "probe.amplitude": scales.amplitude,
        "probe.speed": scales.rate,
        "probe.duration": scales.duration,
    }
    probed = problem.with_(structure=Structure(problem.structure.effects, (_PROBE,)), fixed=fixed)
    shared = len(problem.names)
    count, own = len(probed.names) - shared, problem.n_local
    extra = probed.n_local - own  # the probes' clock, where internal states are free
    begins = np.reshape(point[shared:], (len(problem.records), own))
    at = 2 + len(problem.structure.internal_states) if problem.free_states else own
    begins = np.insert(begins, [at] * extra, 0.0, axis=1)
    unknowns = np.concatenate([point[:shared], np.zeros(count), begins.ravel()])
    sizes = probed.sizes()
    rows, values = [], []
    for index, (residual, jacobian) in enumerate(probed.linearise(unknowns)):
        std = problem.records[index].std
        first = shared + count + index * probed.n_local
        where = np.r_[0 : shared + count, first : first + probed.n_local]
        block = np.zeros((len(residual), len(sizes)))
        block[:, where] = jacobian * sizes[where] / std
        rows.append(_whitened(block, noise))
        values.append(_whitened(residual / std, noise))
    table, residual = np.concatenate(rows), np.concatenate(values)
    if not np.all(np.isfinite(table)):
        return ScoreTest(0.0, 0, 1.0)
    probes = np.arange(shared, shared + count)
    fitted = np.delete(np.arange(len(sizes)), probes)
    base = _basis(table[:, fitted], 1e-9)
    residual = residual - base @ (base.T @ residual)
    rest = table[:, probes] - base @ (base.T @ table[:, probes])
    # A shape of which the fit leaves next to nothing says nothing but the error of linearisation.
    kept = np.linalg.norm(rest, axis=0) > 1e-3 * np.linalg.norm(table[:, probes], axis=0)
    left = _basis(rest[:, kept], 1e-4)
    explained = float(np.sum((left.T @ residual) ** 2))
    freedom = left.shape[1]
    remaining = len(residual) - base.shape[1] - freedom
    if freedom == 0 or remaining < 10:
        return ScoreTest(0.0, 0, 1.0)
    variance = (float(residual @ residual) - explained) / remaining
    ratio = explained / freedom / max(variance, 1e-300)
    return ScoreTest(explained, freedom, float(fdtrc(freedom, remaining, ratio)))


def _whitened(columns: Array, noise: ResidualNoise | None) -> Array:
    """Take from every sample what the noise before it foretells."""
    if noise is None or len(noise.coefficients) == 0:
        return columns
    from scipy.signal import lfilter

    filtered = lfilter(np.concatenate([[1.0], -noise.coefficients]), [1.0], columns, axis=0)
    return np.asarray(filtered)[len(noise.coefficients) :]


def _basis(table: Array, small: float) -> Array:
    """Return an orthonormal basis of the columns, each taken at length one."""
    lengths = np.linalg.norm(table, axis=0)
    table = table[:, lengths > 0] / lengths[lengths > 0]
    if table.shape[1] == 0:
        return table
    vectors, sizes, _ = np.linalg.svd(table, full_matrices=False)
    return vectors[:, sizes > small * sizes[0]]


def _torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Any:
    x, v = motion.tilt / parameters["amplitude"], motion.rate / parameters["speed"]
    t = states[0] / parameters["duration"]
    terms = [parameters[f"c{index}"] * shape(m, x, v, t) for index, shape in enumerate(SHAPES.values())]
    return sum(terms[1:], terms[0])


_PROBE = TorqueEffect(
    name="probe",
    title="small torques of many shapes",
    parameters=(
        Parameter(name="amplitude", unit="rad", size=lambda s: s.amplitude, low=0.0, high=2.0),
        Parameter(name="speed", unit="rad/s", size=lambda s: s.rate, low=0.0, high=2.0),
        Parameter(name="duration", unit="s", size=lambda s: s.duration, low=0.0, high=2.0),
        *(
            Parameter(name=f"c{i}", unit="N*m", size=lambda s: s.torque, low=-1.0, high=1.0)
            for i in range(len(SHAPES))
        ),
    ),
    law="Σ cᵢ bᵢ(x, v)",
    source="Rao 1948",
    does="",
    look_alikes=(),
    experiment="",
    mujoco=MujocoSupport(means="", since="", warp=False),
    to_mjcf=belongs_to_log,
    example=(),
    torque=_torque,
    states=(
        State(
            name="time",
            start=lambda m, tilt, hold, stiffness, parameters: 0.0 * tilt,
            size=lambda s: s.duration,
            rate=lambda m, motion, z, parameters: 1.0,
        ),
    ),
)
