"""Amplitude and phase of a lightly damped decay, cycle by cycle: a second whitener for the same evidence.

Errors of a waveform (a lens, a filter, a clock) grow when a log is differentiated, but they do not reach the slow flow. A torque f does.
For x = a cos ψ and time in 1/ω₀ (Krylov and Bogoliubov; Nayfeh and Mook, Nonlinear Oscillations, 1979, section 3.3):

    ȧ/a = ∮ f sin ψ dψ / (2π a),   ψ̇ - 1 = ∮ f cos ψ dψ / (2π a).

Both integrals come from the laws of the catalogue themselves, on a cycle of each of some amplitudes. Averaging is of first order in the
loss per cycle: cycles that lose much belong to the equations.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.interpolate import make_interp_spline

from sysid.diagnosis.evidence import Problem, Sets, items_of, search
from sysid.diagnosis.laws import GRID, SHOWS, Laws, Term
from sysid.diagnosis.motion import Motion
from sysid.diagnosis.posterior import Posterior, Subject, found_sets
from sysid.diagnosis.smoother import Smoothed
from sysid.roll import Array

TURNS = 3
"""Cycles until the states of a law are periodic; the last one is averaged."""
WALKS = (1e-4, 1e-3, 1e-2)
"""Random walk of ln a and of the phase in the square root of a period."""
LOST = 0.4
"""Loss of ln a in a cycle [1] above which averaging does not hold."""
FEWEST_CYCLES = 10
"""Cycles of the shortest decay that has a slow flow."""


@dataclass(frozen=True, slots=True)
class Cycles:
    """One release, cycle by cycle."""

    time: Array
    """Middle of each cycle [1/ω₀], shape (c,)."""
    amplitude: Array
    """Over the widest swing, shape (c,)."""
    phase: Array
    """Beside the time [rad], shape (c,)."""
    std: Array
    """Deviation of ln a and of the phase, shape (c,)."""


def cycles_of(motion: Motion) -> list[Cycles]:
    """Return amplitude and phase of each cycle of each release by least squares on a constant, a slope and three harmonics."""
    found: list[Cycles] = []
    size = motion.nodes_a_period
    for row, n in enumerate(motion.length):
        rows: list[tuple[float, float, float, float]] = []
        for begin in range(0, n - size, size):
            nodes = np.arange(begin, begin + size)
            nodes = nodes[np.isfinite(motion.variance[row, nodes])]
            if len(nodes) < 7:
                continue
            middle = (begin + size / 2) * motion.step
            at = nodes * motion.step + motion.lag[row, nodes] - middle
            harmonics = range(1, 4) if len(nodes) > 12 else range(1, 2)
            waves = [f(h * at) for h in harmonics for f in (np.cos, np.sin)]
            table = np.column_stack([*waves, np.ones_like(at), at])
            reading = motion.reading[row, nodes]
            c, *_ = np.linalg.lstsq(table, reading, rcond=None)
            left = reading - table @ c
            own = float(left @ left) / max(len(at) - table.shape[1], 1)
            noise = max(own, float(np.median(motion.variance[row, nodes])))
            inverse = np.linalg.inv(table.T @ table)
            amplitude = float(np.hypot(c[0], c[1]))
            phase = float(np.arctan2(-c[1], c[0])) - (np.pi / 2 if motion.is_rate else 0.0)
            std = float(np.sqrt(noise * (inverse[0, 0] + inverse[1, 1]) / 2)) / amplitude
            rows.append((middle, amplitude, phase, std))
        table = np.array(rows).reshape(-1, 4)
        clear = np.cumprod(table[:, 3] < 0.2).astype(bool)
        middle, amplitude, phase, std = table[clear].T
        loss = -np.diff(np.log(amplitude), append=np.log(amplitude[-1]) if len(amplitude) else [])
        begin = int(np.argmax(loss < LOST)) if len(loss) else 0
        if len(middle) - begin >= 3:
            each = (a[begin:] for a in (middle, amplitude, np.unwrap(phase), std))
            found.append(Cycles(*each))
    return found


def averaged(laws: Laws, subject: Subject, lowest: float) -> tuple[Array, Array, list[Term]]:
    """Return amplitudes [1], shape (a,), and ȧ/a and ψ̇ - 1 there, shape (a, 2, c), of the record's effects and of all terms."""
    amplitudes = np.geomspace(lowest, 1.0, GRID)
    size = laws.motion.nodes_a_period
    psi = np.arange(TURNS * size) * 2 * np.pi / size
    x, v = amplitudes[:, None] * np.cos(psi), -amplitudes[:, None] * np.sin(psi)
    zeros = np.zeros_like(x)
    motion = replace(
        laws.motion, reading=zeros, variance=zeros, lag=zeros, length=np.full(GRID, len(psi)), envelope=zeros,
        hold=amplitudes, held=np.full(GRID, 100.0), step=2 * np.pi / size, starts=zeros[:, 0],
    )  # fmt: skip
    own = Laws.__new__(Laws)
    own.motion, own.unit, own.scales = motion, laws.unit, laws.scales
    smoothed = Smoothed(angle=x, rate=v, rate_variance=zeros, misfit=zeros, cost=0.0)
    last = slice(-size, None)
    wave = np.stack([np.sin(psi[last]), np.cos(psi[last])])
    recorded = (_mean(c[..., None], wave, last, amplitudes) for c in own.recorded(smoothed, subject.known))
    known = np.concatenate([np.zeros((GRID, 2, 0)), *recorded], axis=2)
    found: list[Term] = []
    for term in own.terms(smoothed, subject.parts, {}):
        like = np.sqrt(
            0.5 / np.mean(term.columns[-1, last] ** 2, axis=0)
        )  # the spring's torque in the widest swing
        found.append(replace(term.scaled(like), columns=like * _mean(term.columns, wave, last, amplitudes)))
    return amplitudes, known, found


def _mean(columns: Array, wave: Array, last: slice, amplitudes: Array) -> Array:
    """Return the means of torques, shape (a, p, c), times sine and cosine over the last cycle, over the amplitude: shape (a, 2, c)."""
    return np.einsum("apc,wp->awc", columns[:, last], wave) / wave.shape[1] / amplitudes[:, None, None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Regression:
    """Increments of ln a and phase of all releases, and columns of each torque, before whitening."""

    increments: Array
    """Shape (2, i)."""
    columns: Array
    """Of spring, damper and all terms, shape (2, i, m)."""
    blocks: list[tuple[slice, Array, Array]]
    """Rows, deviations of the cycles, and time between them, of each release."""


def regression(cycles: Sequence[Cycles], amplitudes: Array, flows: Array) -> Regression:
    """Return the increments of a decay, and columns of spring, damper and flows [1], shape (a, 2, m)."""
    steps, tables, blocks = list[Array](), list[Array](), list[tuple[slice, Array, Array]]()
    at, between = 0, make_interp_spline(np.log(amplitudes), flows, k=1)
    for c in cycles:
        h, middle = np.diff(c.time), np.sqrt(c.amplitude[1:] * c.amplitude[:-1])
        steps.append(np.stack([np.diff(np.log(c.amplitude)), np.diff(c.phase)]))
        plain = np.zeros((2, len(h), 2))
        plain[0, :, 1], plain[1, :, 0] = -h / 2, h / 2
        flow = between(np.log(np.clip(middle, amplitudes[0], 1.0))).swapaxes(0, 1) * h[:, None]
        tables.append(np.concatenate([plain, flow], axis=2))
        blocks.append((slice(at, at := at + len(h)), c.std, h))
    return Regression(
        increments=np.concatenate(steps, axis=1), columns=np.concatenate(tables, axis=1), blocks=blocks
    )


def whitened(problem: Regression, of_amplitude: float, of_phase: float) -> tuple[Array, float]:
    """Return the Gram matrix of increments and columns [1], shape (1 + m, 1 + m), and the log determinant.

    Increments share the errors of the cycles between them, and have a random walk of their own.

    Args:
        problem: Increments.
        of_amplitude: Random walk of ln a in the square root of a period.
        of_phase: Random walk of the phase.
    """
    every = np.concatenate([problem.increments[:, :, None], problem.columns], axis=2)
    gram, spread = np.zeros((every.shape[2], every.shape[2])), 0.0
    for channel, walk in enumerate((of_amplitude, of_phase)):
        for rows, std, h in problem.blocks:
            variance = std**2
            covariance = np.diag(variance[1:] + variance[:-1] + walk**2 * h / (2 * np.pi))
            covariance -= np.diag(variance[1:-1], 1) + np.diag(variance[1:-1], -1)
            lower = np.linalg.cholesky(covariance)
            white = np.linalg.solve(lower, every[channel, rows])
            gram += white.T @ white
            spread += 2 * float(np.log(np.diag(lower)).sum())
    return gram, spread


def slow_posterior(fast: Posterior, subject: Subject) -> Posterior | None:
    """Return the posterior of sets of laws by the slow flow; None where too few cycles stand clear of the noise.

    Args:
        fast: The posterior by the equations, whose frequency and damping the cycles are counted with.
        subject: The joint.
    """
    motion, inertia, rate = fast.motion, subject.inertia, fast.damping
    cycles = cycles_of(motion)
    if sum(len(c.time) for c in cycles) < FEWEST_CYCLES:
        return None
    laws = Laws(motion, inertia, 1.0, rate)
    amplitudes, known, terms = averaged(laws, subject, min(float(c.amplitude.min()) for c in cycles))
    flow = regression(cycles, amplitudes, np.concatenate([known, *(t.columns for t in terms)], axis=2))
    base = 2 + known.shape[2]
    kept, columns = _visible(flow, terms, base, rate)
    flow = replace(flow, columns=flow.columns[:, :, columns])
    items = items_of(kept, 1 + base)
    cells: list[tuple[Problem, Sets]] = []
    for walks in product(WALKS, WALKS):
        gram, spread = whitened(flow, *walks)
        sets = search(problem := Problem(gram, np.ones(base), items, 0.0))
        cells.append((problem, replace(sets, log_evidence=sets.log_evidence - 0.5 * (spread + gram[0, 0]))))
    unit = inertia * motion.frequency**2
    linear = {"stiffness": (unit, unit), "damping": (0.0, inertia * motion.frequency)}
    sets, singles, inclusion, _, _ = found_sets(cells, kept, linear)
    return replace(fast, sets=sets, singles=singles, inclusion=inclusion, by_cycles=True, nameless=np.nan)


def _visible(flow: Regression, terms: Sequence[Term], base: int, rate: float) -> tuple[list[Term], list[int]]:
    """Return the terms that are more than another spring and damper, and the columns of the base and of these."""
    table = flow.columns.reshape(-1, flow.columns.shape[2])
    frame = np.linalg.qr(table[:, :base])[0]
    kept, columns, at = list[Term](), list(range(base)), base
    for term in terms:
        own = list(range(at, at + term.columns.shape[2]))
        at += len(own)
        beside = table[:, own] - frame @ (frame.T @ table[:, own])
        if np.linalg.norm(beside) > SHOWS * np.linalg.norm(table[:, 1]) * rate:
            kept.append(term)
            columns += own
    return kept, columns
