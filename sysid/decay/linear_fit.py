"""A linear decay fitted to whole traces: one law for all, own amplitude, phase and rest angle per release.

The law is `m ẍ + τ ẋ + (x - r) = 0`, with m = I/k = 1/ω_n² and τ = d/k = 2ζ/ω_n. Its solution is `x(t) = r + C u(t) + S v(t)`, with
`u = e^(-a t) cos(√q t)`, `v = e^(-a t) sin(√q t) / √q`, `a = τ/2m` and `q = 1/m - a²`.

C, S and r are linear, so they are eliminated (variable projection, Golub and Pereyra, 1973). Only ln m and τ are searched for.
At critical damping q is zero. Beyond it q is negative, and cos and sin become cosh and sinh. For strong damping m goes to zero, and the
decay fixes τ = d/k alone. The rate of a linear decay has the same form, with the gyro's bias as r.

A pendulum's motion is linearised about the motion of the round before (`sysid.decay.pendulum`): the first two angles and r are linear.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sysid.decay.pendulum import Swing, swing_near
from sysid.decay.trace import Trace, head, traces_of, with_ar1_errors
from sysid.errors import SysidError
from sysid.least_squares import Normal, minimise
from sysid.noise.sensor import BEST_SENSOR
from sysid.noise.whiteness import lag_one
from sysid.releases.extrema import half_cycles_of, smoothed
from sysid.roll import Array, Release

GRID = 40
"""Points of the grid of a torque's response, in 1.5 rad of the fastest motion; the trapezoidal rule is then right to 1e-4."""

GROWTH = -math.log(BEST_SENSOR)
"""Largest logarithm of the growth of a trace [1]: a swing that grows further began below any noise."""
OVERDAMPED = 0.95
"""Damping ratio from which the start of a release is fitted too."""
ROUNDS = 6
"""Rounds in which a pendulum's motion is found (Newton)."""

Law = Literal["spring", "pendulum", "none"]
"""Restoring torque of a joint."""


@dataclass(frozen=True, slots=True)
class FittedTrace:
    """One release with the linear decay fitted to it."""

    trace: Trace
    modelled: Array
    """Fitted roll [rad] or roll rate [rad/s], shape (n,)."""
    coefficients: Array
    """C, S and r of the module's equation, shape (3,); of a pendulum the changes of the first two angles, and r."""
    level_std: float
    """Standard deviation of `level`."""
    swing: Swing | None = None
    """Its motion, if it is a pendulum's."""

    @property
    def level(self) -> float:
        """Rest angle r [rad], or bias of the gyro [rad/s]."""
        return float(self.coefficients[2])

    @property
    def residual(self) -> Array:
        """Measured minus modelled [rad or rad/s], shape (n,)."""
        return self.trace.measured - self.modelled


@dataclass(frozen=True, slots=True)
class TraceFit:
    """One law shared by all releases, with its covariance."""

    poles: Array
    """(ln m, τ) of the module's equation, shape (2,)."""
    covariance: Array
    """Covariance of (ln m, τ), shape (2, 2)."""
    white_covariance: Array
    """The same for independent residuals, shape (2, 2)."""
    degrees_of_freedom: float
    """Of the noise estimate, fewer if residuals are correlated."""
    noise: float
    """Standard deviation of the residuals, in the unit of the signal."""
    correlation: float
    """Correlation of successive residuals if significant, else 0."""
    explained: float
    """Share of the measured variance that the fit explains."""
    signal: Literal["roll", "rate"]
    releases: tuple[FittedTrace, ...]
    law: Law = "spring"

    @property
    def omega_n(self) -> float:
        """ω_n [rad/s]."""
        return math.exp(-self.poles[0] / 2)

    @property
    def damping_ratio(self) -> float:
        """ζ [1]."""
        return float(self.poles[1]) * self.omega_n / 2

    @property
    def decay_rate(self) -> float:
        """A = ζ ω_n [1/s], or the slow pole of an overdamped joint."""
        a, q = rates(self.poles)
        return a if q > 0 else math.exp(-self.poles[0]) / (a + math.sqrt(-q))


def rates(poles: Array) -> tuple[float, float]:
    """Return a [1/s] and q [1/s²] of (ln m, τ)."""
    stiffness = math.exp(-poles[0])
    a = 0.5 * float(poles[1]) * stiffness
    return a, stiffness - a * a


def decay_basis(time: Array, a: float, q: float) -> tuple[Array, Array]:
    """Return u(t) [1] and v(t) [s] of the module's equation, shape (n,) each, on either side of critical damping."""
    envelope = np.exp(-a * time)
    root = math.sqrt(abs(q))
    if q > 0:
        return envelope * np.cos(root * time), envelope * time * np.sinc(root * time / math.pi)
    if root * time[-1] < 1e-4:
        return envelope, envelope * time
    # Multiplied out with the envelope, as cosh and sinh overflow in a long tail; a - root would cancel.
    slow, fast = np.exp(-(a * a + q) / (a + root) * time), np.exp(-(root + a) * time)
    return (slow + fast) / 2, (slow - fast) / (2 * root)


def fit_traces(releases: Sequence[Release], law: Law = "spring", near: TraceFit | None = None) -> TraceFit:
    """Fit one law to all releases together.

    Args:
        releases: Free decays of one joint.
        law: A spring's, or a pendulum's.
        near: Another law's fit, from which the search begins.

    Raises:
        SysidError: There are too few samples.
    """
    traces, signal = traces_of(releases)
    count = sum(len(trace.time) for trace in traces)
    if min(len(trace.time) for trace in traces) < 5 or count < 3 * len(traces) + 4:
        raise SysidError(
            f"{releases[0].log}: {count} samples in {len(traces)} free decay(s) are too few to fit. "
            "Record faster, or mark longer decays (--release, --to)."
        )
    if near is not None:
        return _pendulum(near, releases)
    poles = _start(traces, releases, signal)
    traces = [with_ar1_errors(trace, math.exp(-poles[0] / 2)) for trace in traces]
    longest = max(float(trace.time[-1] - trace.time[0]) for trace in traces)
    for swings in (2.0, 5.0, 15.0):  # growing windows: a long trace has many wrong frequencies to lock on to
        span = 2 * math.pi * swings * math.exp(poles[0] / 2)
        if span < longest:
            poles = _search([head(trace, span) for trace in traces], poles)
    poles = _search(traces, poles)
    if 0.5 * poles[1] * math.exp(-poles[0] / 2) > OVERDAMPED:
        traces = traces_of(releases, whole=True)[0]
        # A pole that the decay does not excite may lie anywhere: of equal fits take the fastest.
        masses = [2 * math.log(float(poles[1]) / (2 * zeta)) for zeta in (1.2, 3.0, 10.0, 30.0)]
        found = [_search(traces, np.array([mass, poles[1]])) for mass in (poles[0], *masses)]
        costs = [sum(project(one, p)[0] for one in traces) for p in found]
        least = min(costs) * (1 + 4 / sum(len(one.time) for one in traces))  # two deviations
        poles = min((p for p, cost in zip(found, costs, strict=True) if cost <= least), key=lambda p: p[0])
    return _with_uncertainty(traces, poles, signal)


def _pendulum(near: TraceFit, releases: Sequence[Release]) -> TraceFit:
    """Fit a pendulum's law, from a spring's fit and the measured angles on."""
    fit, traces, rate = near, [one.trace for one in near.releases], near.signal == "rate"
    angles = [
        np.interp(_grid(one.trace.time, fit.poles), (signal := smoothed(release)).time, signal.roll)
        - (release.rest if rate else one.level)
        for one, release in zip(near.releases, releases, strict=True)
    ]
    for _ in range(ROUNDS):
        swings = [
            swing_near(fit.poles, np.linspace(trace.time[0], trace.time[-1], len(angle)), angle)
            for trace, angle in zip(traces, angles, strict=True)
        ]
        fit = _with_uncertainty(traces, _search(traces, fit.poles, swings, fit.signal), fit.signal, swings)
        angles = [
            swing.angle + swing.by_start @ one.coefficients[:2] + swing.by_law @ swing.moved(fit.poles)
            for one, swing in zip(fit.releases, swings, strict=True)
        ]
    return replace(fit, law="pendulum")


def response(poles: Array, grid: Array, torque: Array, *, rate: bool) -> Array:
    """Return the response of a joint at rest to a torque per stiffness [rad], shape (n,), on an even grid [s]; or its rate [rad/s]."""
    a, q = rates(poles)
    u, v = decay_basis(grid - grid[0], a, q)
    kernel = (u - a * v if rate else v) * math.exp(-poles[0]) * float(grid[1] - grid[0])
    size = 1 << (2 * len(grid) - 1).bit_length()
    full = np.fft.irfft(np.fft.rfft(kernel, size) * np.fft.rfft(torque, size), size)[: len(grid)]
    return full - 0.5 * (kernel * torque[0] + kernel[0] * torque)


def motion(fitted: FittedTrace, poles: Array, *, rate: bool) -> tuple[Array, Array, Array]:
    """Return a fine even grid of a fitted release [s], and its angle about rest [rad] and rate [rad/s] there, shape (n,) each.

    For a fit to a rate, the angle is that of a linear joint with that rate.
    """
    if fitted.swing is not None:
        return fitted.swing.grid, fitted.swing.angle, fitted.swing.rate
    grid = _grid(fitted.trace.time, poles)
    a, q = rates(poles)
    u, v = decay_basis(grid - grid[0], a, q)
    du, dv = -a * u - q * v, u - a * v
    c, s = (float(value) for value in fitted.coefficients[:2])
    here, slope = c * u + s * v, c * du + s * dv
    if rate:  # m v̇ + τ v + x = 0
        return grid, -(math.exp(poles[0]) * slope + float(poles[1]) * here), here
    return grid, here, slope


def _grid(time: Array, poles: Array) -> Array:
    span, fastest = float(time[-1] - time[0]), math.exp(-poles[0] / 2)
    points = int(max(len(time), GRID * span * fastest / 1.5)) + 1
    return np.linspace(time[0], time[-1], points)


def _start(traces: Sequence[Trace], releases: Sequence[Release], signal: str) -> Array:
    """Return a first (ln m, τ): the best of a coarse grid over the first swings, scaled by their duration."""
    paces: list[float] = []
    for trace, release in zip(traces, releases, strict=True):
        swings = half_cycles_of(smoothed(release))
        large = [swing.duration for swing in swings if swing.size > 0.3 * max(swing.size for swing in swings)]
        paces += large[:6] or [float(trace.time[-1] - trace.time[0]) / 4]
    pace = float(np.median(paces))
    largest = sorted(traces, key=lambda trace: -float(np.ptp(trace.measured)))[:3]
    heads = [head(trace, 8.0 * pace) for trace in largest]
    # A swing's 10 to 90 % time is 1.85/ω undamped, 2.6/ω near critical damping, and 2.2 d/k far beyond it.
    grid = [
        np.array([-2 * math.log(omega), 2 * zeta / omega])
        for zeta in (0.01, 0.05, 0.15, 0.3, 0.5, 0.7, 0.9, 1.3, 3.0, 10.0)
        for omega in np.array([1.4, 1.6, 1.8, 2.0, 2.3, 2.7]) * max(1.0, zeta) / pace
    ]
    return min(grid, key=lambda poles: sum(project(part, poles)[0] for part in heads))


Columns = tuple[Array, Array, Callable[[Array], Array]]
"""Signal without its linear parameters, shape (n,). Columns of C, S and r, shape (n, 3). Their derivative by (ln m, τ), of coefficients,
shape (n, 2)."""


def columns_of(trace: Trace, poles: Array, swing: Swing | None = None, signal: str = "roll") -> Columns:
    """Return the signal of a law [rad or rad/s] as columns of shape (n,) at a trace's samples: a spring's, or a pendulum's near a swing."""
    ones = np.ones(len(trace.time))
    if swing is not None:
        value, by_start, by_law = swing.seen(trace.time, rate=signal == "rate")
        stiffness = math.exp(-poles[0])
        by_poles = by_law @ (stiffness * np.array([[-1.0, 0.0], [-poles[1], 1.0]]))
        return value + by_law @ swing.moved(poles), np.column_stack([by_start, ones]), lambda _: by_poles
    a, q = rates(poles)
    time = trace.time - trace.time[0]
    u, v = decay_basis(time, a, q)

    def slope(coefficients: Array) -> Array:
        c, s = coefficients[0], coefficients[1]
        near = abs(q) * time[-1] ** 2 <= 1e-3
        v_by_q = -np.exp(-a * time) * time**3 / 6 if near else (time * u - v) / (2 * q)
        by_a, by_q = -time * (c * u + s * v), -c * time * v / 2 + s * v_by_q
        stiffness = math.exp(-poles[0])
        by_mass, by_tau = -a * by_a + (2 * a * a - stiffness) * by_q, 0.5 * stiffness * (by_a - 2 * a * by_q)
        return np.column_stack([by_mass, by_tau])

    return np.zeros(len(time)), np.column_stack([u, v, ones]), slope


def project(
    trace: Trace, poles: Array, swing: Swing | None = None, signal: str = "roll"
) -> tuple[float, Array, Array, Array, Array]:
    """Eliminate the linear parameters of one release.

    Returns:
        The weighted sum of squares. The residual [rad or rad/s], shape (n,), and its Jacobian by (ln m, τ), shape (n, 2).
        The coefficients (C, S, r) and their inverse normal matrix.
    """
    known, basis, slope_of = columns_of(trace, poles, swing, signal)
    raw = trace.whiten(basis)
    size = np.linalg.norm(raw, axis=0) + 1e-300
    orthogonal, triangle = np.linalg.qr(raw / size)
    target = trace.whiten(trace.measured - known)
    if abs(np.diag(triangle)).min() < 1e-10:
        return math.inf, target, np.zeros((len(target), 2)), np.zeros(3), np.zeros((3, 3))
    inverse = np.linalg.inv(triangle) / size[:, None]
    coefficients = inverse @ (orthogonal.T @ target)
    residual = target - orthogonal @ (orthogonal.T @ target)
    slope = trace.whiten(slope_of(coefficients))
    jacobian = -(slope - orthogonal @ (orthogonal.T @ slope))
    return float(residual @ residual), residual, jacobian, coefficients, inverse @ inverse.T


def _search(
    traces: Sequence[Trace], poles: Array, swings: Sequence[Swing | None] = (), signal: str = "roll"
) -> Array:
    """Minimise the sum of squares over (ln m, τ)."""
    near = swings or [None] * len(traces)
    interval = min(float(np.median(np.diff(trace.time))) for trace in traces)
    longest = max(float(trace.time[-1] - trace.time[0]) for trace in traces)

    def evaluate(poles: Array) -> Normal:
        if rates(poles)[0] * longest < -GROWTH:
            return Normal(math.inf, np.zeros(2), np.eye(2))
        parts = [project(trace, poles, one, signal) for trace, one in zip(traces, near, strict=True)]
        gradient = sum((part[2].T @ part[1] for part in parts), np.zeros(2))
        hessian = sum((part[2].T @ part[2] for part in parts), np.zeros((2, 2)))
        return Normal(0.5 * sum(part[0] for part in parts), gradient, hessian)

    # Bounds: a period of the log's length, and a time constant of a tenth of a sample.
    slow, fast = 2 * math.log(longest), 2 * math.log(interval)
    low, high = np.array([fast - math.log(100), -longest]), np.array([slow + math.log(100), 100 * longest])
    return minimise(evaluate, poles, low, high, iterations=100, tolerance=1e-13).point


def _with_uncertainty(
    traces: Sequence[Trace],
    poles: Array,
    signal: Literal["roll", "rate"],
    swings: Sequence[Swing | None] = (),
) -> TraceFit:
    """Derive the covariance of (ln m, τ) from the Jacobian and the residuals."""
    near = swings or [None] * len(traces)
    parts = [project(trace, poles, one, signal) for trace, one in zip(traces, near, strict=True)]
    residuals, jacobians = [part[1] for part in parts], [part[2] for part in parts]
    count = sum(len(residual) for residual in residuals)
    free = count - 2 - 3 * len(traces)
    finest = BEST_SENSOR * max(float(np.ptp(trace.measured)) for trace in traces)
    columns = [columns_of(trace, poles, one, signal) for trace, one in zip(traces, near, strict=True)]
    fitted = [known + basis @ part[3] for (known, basis, _), part in zip(columns, parts, strict=True)]
    left = [trace.weight * (trace.measured - model) for trace, model in zip(traces, fitted, strict=True)]
    noise = max(sum(float(residual @ residual) for residual in left) / free, finest**2)
    # A film's error is correlated, and the fit absorbs some of it: the variance is at least the film's own.
    stated = float(np.mean([trace.known_std**2 for trace in traces]))
    variance = max(sum(float(residual @ residual) for residual in residuals) / free, finest**2, stated)
    bread = np.asarray(np.linalg.pinv(sum((j.T @ j for j in jacobians), np.zeros((2, 2)))), dtype=np.float64)
    rho = lag_one(residuals)
    # Correlated residuals weigh less (Bartlett, 1935): the variance of a mean grows by (1+ρ)/(1-ρ).
    inflation = variance * (1 + rho) / (1 - rho)
    spread = sum(float(np.var(trace.measured)) * len(trace.measured) for trace in traces)
    return TraceFit(
        poles=poles,
        covariance=bread * inflation,
        white_covariance=bread * variance,
        degrees_of_freedom=max(1.0, free * (1 - rho**2) / (1 + rho**2)),
        noise=math.sqrt(noise),
        correlation=rho,
        explained=1 - noise * free / spread,
        signal=signal,
        releases=tuple(
            FittedTrace(trace, model, part[3], math.sqrt(part[4][2, 2] * inflation), one)
            for trace, model, part, one in zip(traces, fitted, parts, near, strict=True)
        ),
    )
