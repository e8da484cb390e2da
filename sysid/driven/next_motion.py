"""The next motion of a joint: of chirps, triangles and steps within its range, the one that narrows the worst interval most.

Information of a motion is that of its sensitivities, JᵀJ/σ²; it adds to that of the log (Goodwin and Payne 1977).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.driven.fit import DrivenFit
from sysid.driven.log import DrivenLog, Load
from sysid.driven.problem import Problem
from sysid.errors import SysidError
from sysid.roll import Array

SHAPES = ("chirp", "triangle", "steps")
"""Forms of the motion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class NextMotion:
    """A motion that a robot can play."""

    text: str
    time: Array
    """[s], shape (n,)."""
    input: Array
    """Command [rad] or torque, in the input's unit, shape (n,)."""
    worst: str
    """The parameter whose interval was the widest."""
    narrower: float
    """Its interval after the motion over that before [1]."""
    apart: float
    """RMS between rivals over the noise [1]; 0 without rivals."""

    def csv(self) -> str:
        """Return the motion as a table of time and input."""
        rows = "\n".join(f"{t:.6g},{u:.6g}" for t, u in zip(self.time, self.input, strict=True))
        return f"time_s,input\n{rows}\n"


def next_motion(
    fit: DrivenFit, rivals: Sequence[DrivenFit] = (), reach: tuple[float, float] | None = None
) -> NextMotion:
    """Return the motion that tells rivals apart, or without any the one that narrows the worst interval most.

    Args:
        rivals: Other fits of the same log.
        reach: Lowest and highest angle [rad]; those of the log if left out.

    Raises:
        SysidError: No motion stays within the reach.
    """
    low, high = reach or (float(fit.log.angle.min()), float(fit.log.angle.max()))
    stds = np.array([max(q.std, 1e-300) for q in fit.quantities.values()])
    sizes = np.array([max(abs(q.value), q.std, 1e-300) for q in fit.quantities.values()])
    known = np.where(np.isfinite(stds), stds, 1e3 * sizes)
    worst = int(np.argmax(known / sizes))
    before = np.diag(1 / known**2)
    best: NextMotion | None = None
    for text, log in _motions(fit, low, high):
        problem, paths = _seen(fit, log)
        angle, rows = paths
        if not np.all(np.isfinite(angle)) or angle.min() < low - 1e-9 or angle.max() > high + 1e-9:
            continue
        slopes = rows[:, : len(fit.quantities)] / problem.sizes[: len(fit.quantities)]
        after = np.linalg.pinv(before + slopes.T @ slopes)
        narrower = float(math.sqrt(max(after[worst, worst], 0.0)) / known[worst])
        apart = max(
            (float(np.sqrt(np.mean((_seen(one, log)[1][0] - angle) ** 2))) / log.std for one in rivals),
            default=0.0,
        )
        one = NextMotion(
            text=text,
            time=log.time,
            input=log.input,
            worst=list(fit.quantities)[worst],
            narrower=narrower,
            apart=apart,
        )
        if best is None or (apart > best.apart if rivals else narrower < best.narrower):
            best = one
    if best is None:
        raise SysidError(
            f"no motion of {', '.join(SHAPES)} stays between {low:.3g} and {high:.3g} rad. Widen the range."
        )
    return best


def _motions(fit: DrivenFit, low: float, high: float) -> Iterator[tuple[str, DrivenLog]]:
    """Yield chirps, triangles and steps of several amplitudes and bands, as long as the log: of commands about the middle of the range."""
    log = fit.log
    time = np.arange(len(log.time)) * log.step
    seconds = float(time[-1])
    order = np.argsort(log.load.at)
    natural = replace(fit.problem, values=fit.values).scales.frequency / (2 * np.pi)
    command = log.kind == "command"
    middle = (low + high) / 2 if command else 0.0
    size = (high - low) / 2 if command else float(np.quantile(np.abs(log.input), 0.98))
    for shape in SHAPES:
        for share in (0.25, 0.5, 0.9):
            for band in (0.3 * natural, natural, 2 * natural):
                if shape == "chirp":
                    wave = np.sin(2 * np.pi * (0.05 * band * time + 0.95 * band * time**2 / (2 * seconds)))
                else:
                    phase = (band / 3 * time) % 1.0
                    wave = 1 - 4 * np.abs(phase - 0.5) if shape == "triangle" else np.sign(0.5 - phase)
                at = middle + share * size * wave
                angle = at if command else np.full_like(at, float(np.median(log.angle)))
                load = Load.of(
                    np.stack([np.interp(angle, log.load.at[order], row[order]) for row in log.load.rows])
                )
                text = f"{shape} of ±{share * size:.3g} {'rad' if command else log.kind} up to {band:.3g} Hz, {seconds:.3g} s"
                yield text, replace(log, time=time, input=at, angle=angle, load=load)


def _seen(fit: DrivenFit, log: DrivenLog) -> tuple[Problem, tuple[Array, Array]]:
    """Return the problem of a motion, its simulated angle [rad], shape (n,), and sensitivities over noise, shape (n, p)."""
    problem = replace(fit.problem, log=log, values=fit.values, finer=1)
    point = problem.begin()
    point[len(problem.free) :] = 0.0
    point[len(problem.free)] = log.angle[0] / problem.scales.amplitude
    if fit.structure.gear is not None:
        point[len(problem.free) + 2] = point[len(problem.free)]
    (rest,), (rows,) = problem.residuals(point)
    return problem, (log.angle[: len(rest)] - rest * log.std, rows)
