"""A linear decay fitted to whole traces: shared poles, own amplitude, phase and rest angle per release.

    x(t) = r + C u(t) + S v(t),  u = e^(-a t) cos(√q t),  v = e^(-a t) sin(√q t) / √q

with a = ζ ω_n and q = ω_n² - a². C, S and r are linear, so they are eliminated (variable projection,
Golub and Pereyra, 1973) and only a and q are searched for. q passes through zero at critical damping
and is negative beyond it, where cos and sin become cosh and sinh: one model for all of them. The
rate of a linear decay has the same form, with the gyro's bias in place of r.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sysid.decay.trace import Trace, head, traces_of, with_ar1_errors
from sysid.errors import SysidError
from sysid.least_squares import Normal, minimise
from sysid.releases.extrema import half_cycles_of, smoothed
from sysid.roll import Array, Release

BEST_SENSOR = 1e-6
"""No sensor has less noise than this share of its swing; a log without any was computed."""


@dataclass(frozen=True, slots=True)
class FittedTrace:
    """One release with the linear decay fitted to it."""

    trace: Trace
    modelled: Array
    """Fitted roll [rad] or roll rate [rad/s], shape (n,)."""
    level: float
    """Rest angle r [rad], or bias of the gyro [rad/s]."""
    level_std: float

    @property
    def residual(self) -> Array:
        """Measured minus modelled [rad or rad/s], shape (n,)."""
        return self.trace.measured - self.modelled


@dataclass(frozen=True, slots=True)
class TraceFit:
    """Poles shared by all releases, with the covariance of what is derived from them."""

    omega_n: float
    """[rad/s]"""
    damping_ratio: float
    covariance: Array
    """Covariance of (ω_n, ζ), shape (2, 2)."""
    white_covariance: Array
    """The same were the residuals independent of each other, shape (2, 2)."""
    degrees_of_freedom: float
    """Of the noise estimate, fewer where residuals are correlated."""
    noise: float
    """Standard deviation of the residuals, in the unit of the signal."""
    correlation: float
    """Correlation of successive residuals where it is significant, else 0."""
    explained: float
    """Share of the measured variance that the fit explains."""
    signal: Literal["roll", "rate"]
    releases: tuple[FittedTrace, ...]


def fit_traces(releases: Sequence[Release]) -> TraceFit:
    """Fit one linear decay to all releases together.

    Raises:
        SysidError: There are too few samples, or the search finds no decay.
    """
    traces, signal = traces_of(releases)
    count = sum(len(trace.time) for trace in traces)
    if min(len(trace.time) for trace in traces) < 5 or count < 3 * len(traces) + 4:
        raise SysidError(
            f"{releases[0].log}: {count} samples in {len(traces)} free decay(s) are too few to fit. "
            "Record faster, or mark longer decays (--release, --to)."
        )
    poles = _start(traces, releases)
    traces = [with_ar1_errors(trace, math.sqrt(poles[0] ** 2 + poles[1])) for trace in traces]
    longest = max(float(trace.time[-1] - trace.time[0]) for trace in traces)
    for swings in (2.0, 5.0, 15.0):  # growing windows: a long trace has many wrong frequencies to lock on to
        span = 2 * math.pi * swings / math.sqrt(poles[0] ** 2 + poles[1])
        if span < longest:
            poles = _search([head(trace, span) for trace in traces], poles)
    poles = _search(traces, poles)
    if not (poles[0] > 0 and poles[0] ** 2 + poles[1] > 0):
        raise SysidError(
            f"{releases[0].log}: the best linear fit does not decay (ζω = {poles[0]:.3g} 1/s). Look at the picture; "
            "mark the free part of the log (--release, --to)."
        )
    return _with_uncertainty(traces, poles, signal)


def decay_basis(time: Array, a: float, q: float) -> tuple[Array, Array]:
    """Return u(t) [1] and v(t) [s] of the module's equation, shape (n,) each, on either side of critical damping."""
    envelope = np.exp(-a * time)
    if q > 0:
        root = math.sqrt(q)
        return envelope * np.cos(root * time), envelope * time * np.sinc(root * time / math.pi)
    root = math.sqrt(-q)
    # cosh and sinh share the envelope's exponential, else they overflow in a long tail.
    slow, fast = np.exp((root - a) * time), np.exp(-(root + a) * time)
    if root * time[-1] < 1e-4:
        return envelope, envelope * time
    return (slow + fast) / 2, (slow - fast) / (2 * root)


def _start(traces: Sequence[Trace], releases: Sequence[Release]) -> Array:
    """Return a first (a, q): the best of a coarse grid on the first swings, paced by their swings."""
    paces: list[float] = []
    for trace, release in zip(traces, releases, strict=True):
        swings = half_cycles_of(smoothed(release))
        large = [swing.duration for swing in swings if swing.size > 0.3 * max(swing.size for swing in swings)]
        paces += large[:6] or [float(trace.time[-1] - trace.time[0]) / 4]
    pace = float(np.median(paces))
    largest = sorted(traces, key=lambda trace: -float(np.ptp(trace.measured)))[:3]
    heads = [head(trace, 8.0 * pace) for trace in largest]
    # A swing's 10 to 90 % time is 1.85/ω undamped and 2.6/ω near critical damping.
    grid = [
        np.array([zeta * omega, omega**2 * (1 - zeta**2)])
        for omega in np.array([1.4, 1.6, 1.8, 2.0, 2.3, 2.7]) / pace
        for zeta in (0.01, 0.05, 0.15, 0.3, 0.5, 0.7, 0.9, 1.3)
    ]
    return min(grid, key=lambda poles: sum(_project(part, poles)[0] for part in heads))


def _project(trace: Trace, poles: Array) -> tuple[float, Array, Array, Array, Array]:
    """Eliminate the linear parameters of one release.

    Returns:
        The weighted sum of squares, the residual shape (n,), its Jacobian by (a, q) shape (n, 2), the
        coefficients (C, S, r), and the inverse normal matrix of the coefficients.
    """
    a, q = float(poles[0]), float(poles[1])
    time = trace.time - trace.time[0]
    u, v = decay_basis(time, a, q)
    basis = trace.whiten(np.column_stack([u, v, np.ones_like(time)]))
    orthogonal, triangle = np.linalg.qr(basis)
    target = trace.whiten(trace.measured)
    if abs(np.diag(triangle)).min() < 1e-12 * abs(triangle).max():
        return math.inf, target, np.zeros((len(time), 2)), np.zeros(3), np.zeros((3, 3))
    inverse = np.linalg.inv(triangle)
    coefficients = inverse @ (orthogonal.T @ target)
    residual = target - basis @ coefficients
    by_q = (time * u - v) / (2 * q) if abs(q) * time[-1] ** 2 > 1e-3 else -np.exp(-a * time) * time**3 / 6
    c, s = coefficients[0], coefficients[1]
    slope = trace.whiten(np.column_stack([-time * (c * u + s * v), -c * time * v / 2 + s * by_q]))
    jacobian = -(slope - orthogonal @ (orthogonal.T @ slope))
    return float(residual @ residual), residual, jacobian, coefficients, inverse @ inverse.T


def _search(traces: Sequence[Trace], poles: Array) -> Array:
    """Minimise the sum of squares over (a, q), among decays that come to rest."""

    def evaluate(poles: Array) -> Normal:
        if not (poles[0] > 0 and poles[0] ** 2 + poles[1] > 0):
            return Normal(math.inf, np.zeros(2), np.eye(2))
        parts = [_project(trace, poles) for trace in traces]
        gradient = sum((part[2].T @ part[1] for part in parts), np.zeros(2))
        hessian = sum((part[2].T @ part[2] for part in parts), np.zeros((2, 2)))
        return Normal(0.5 * sum(part[0] for part in parts), gradient, hessian)

    everywhere = np.full(2, np.inf)
    return minimise(evaluate, poles, -everywhere, everywhere, iterations=100, tolerance=1e-13).point


def _with_uncertainty(traces: Sequence[Trace], poles: Array, signal: Literal["roll", "rate"]) -> TraceFit:
    """Derive the covariance of (ω_n, ζ) from the Jacobian and the residuals."""
    parts = [_project(trace, poles) for trace in traces]
    residuals, jacobians = [part[1] for part in parts], [part[2] for part in parts]
    count = sum(len(residual) for residual in residuals)
    free = count - 2 - 3 * len(traces)
    finest = BEST_SENSOR * max(float(np.ptp(trace.measured)) for trace in traces)
    fitted = [_model(trace, poles, part[3]) for trace, part in zip(traces, parts, strict=True)]
    left = [trace.weight * (trace.measured - model) for trace, model in zip(traces, fitted, strict=True)]
    noise = max(sum(float(residual @ residual) for residual in left) / free, finest**2)
    # What a film's angle is off by lasts, so that a fit takes it up: the least is what the film itself states.
    stated = float(np.mean([trace.known_std**2 for trace in traces]))
    variance = max(sum(float(residual @ residual) for residual in residuals) / free, finest**2, stated)
    bread = np.asarray(np.linalg.inv(sum((j.T @ j for j in jacobians), np.zeros((2, 2)))), dtype=np.float64)
    rho = _correlation(residuals)
    # Correlated residuals count for less (Bartlett, 1935): the variance of a mean grows by (1+ρ)/(1-ρ).
    covariance: Array = bread * (variance * (1 + rho) / (1 - rho))
    if rho > 0:
        robust: Array = bread @ _newey_west(residuals, jacobians, poles, traces) @ bread * count / free
        covariance = max(
            covariance, robust, key=lambda matrix: float(np.sum(np.diag(matrix) / np.diag(bread)))
        )
    a, q = float(poles[0]), float(poles[1])
    omega = math.sqrt(a * a + q)
    to_numbers = np.array([[a / omega, 0.5 / omega], [q / omega**3, -0.5 * a / omega**3]])
    spread = sum(float(np.var(trace.measured)) * len(trace.measured) for trace in traces)
    inflation = variance * (1 + rho) / (1 - rho)
    return TraceFit(
        omega_n=omega,
        damping_ratio=a / omega,
        covariance=np.asarray(to_numbers @ covariance @ to_numbers.T, dtype=np.float64),
        white_covariance=np.asarray(to_numbers @ bread @ to_numbers.T * variance, dtype=np.float64),
        degrees_of_freedom=max(1.0, free * (1 - rho**2) / (1 + rho**2)),
        noise=math.sqrt(noise),
        correlation=rho,
        explained=1 - noise * free / spread,
        signal=signal,
        releases=tuple(
            FittedTrace(trace, model, float(part[3][2]), math.sqrt(part[4][2, 2] * inflation))
            for trace, model, part in zip(traces, fitted, parts, strict=True)
        ),
    )


def _model(trace: Trace, poles: Array, coefficients: Array) -> Array:
    u, v = decay_basis(trace.time - trace.time[0], float(poles[0]), float(poles[1]))
    return coefficients[0] * u + coefficients[1] * v + coefficients[2]


def _correlation(residuals: Sequence[Array]) -> float:
    """Return the lag-one correlation of the residuals where it is significantly positive, else 0."""
    count = sum(len(residual) for residual in residuals)
    power = sum(float(residual @ residual) for residual in residuals)
    if power == 0 or count < 10:
        return 0.0
    rho = sum(float(residual[1:] @ residual[:-1]) for residual in residuals) / power
    return min(rho, 0.999) if rho > 2.5 / math.sqrt(count) else 0.0


def _newey_west(
    residuals: Sequence[Array], jacobians: Sequence[Array], poles: Array, traces: Sequence[Trace]
) -> Array:
    """Return the long-run covariance of the scores over one period (Newey and West, 1987), shape (2, 2)."""
    interval = float(np.median(np.diff(traces[0].time)))
    period = 2 * math.pi / math.sqrt(poles[0] ** 2 + max(float(poles[1]), 0.0))
    total = np.zeros((2, 2))
    for residual, jacobian in zip(residuals, jacobians, strict=True):
        score = jacobian * residual[:, None]
        lags = min(round(period / interval), len(score) // 3)
        sums = np.cumsum(np.vstack([np.zeros(2), score]), axis=0)
        # Bartlett's kernel is the mean of squared sums over all windows of that length.
        width = lags + 1
        ends = np.clip(np.arange(1, len(score) + width), 0, len(score))
        begins = np.clip(np.arange(1, len(score) + width) - width, 0, len(score))
        windows = sums[ends] - sums[begins]
        total += windows.T @ windows / width
    return total
