"""Laws that explain a log down to its noise: there the fits themselves are the evidence.

A fit by output error sees all of a release: its start, where friction stops it, and where it rests. The equations leave these out.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from sysid.diagnosis.evidence import MOST_DEVIATIONS, STRENGTH, log_odds
from sysid.diagnosis.posterior import Found, Size
from sysid.diagnosis.posterior import lost as loss_of
from sysid.effects import effect
from sysid.fitting.result import JointFit
from sysid.joint.torques import effect_torque
from sysid.joint.trajectory import Trajectory, simulate
from sysid.roll import Array


def is_possible(fit: JointFit, names: Sequence[str]) -> bool:
    """Return whether no effect's torque is beyond a possible share of the torque of spring and effects together, both RMS over the motion.

    Large torques that cancel each other are no explanation. The share is that of the evidence.
    """
    squares, whole, law = dict.fromkeys(names, 0.0), 1e-300, fit.law.of_joint()
    for time, path in _paths(fit):
        total = -fit.law.stiffness * (path.roll - fit.law.rest_angle)
        for name in names:
            torque = effect_torque(law, name, time, path.roll, path.rate)
            squares[name] += float(np.mean(torque**2))
            total = total + torque
        whole += float(np.mean(total**2))
    return max(squares.values()) <= (MOST_DEVIATIONS * STRENGTH) ** 2 * whole


def _paths(fit: JointFit) -> Iterator[tuple[Array, Trajectory]]:
    """Yield time [s] and the fitted motion of each record."""
    for record, (angle, rate) in zip(fit.records, fit.starts, strict=True):
        time = np.linspace(0.0, float(record.time[-1]), 2000)
        yield time, simulate(fit.law.of_joint(), time, angle, rate)


def _spring(fit: JointFit, path: Trajectory) -> Array:
    """Return the torque of the linear spring [N*m], shape (n,)."""
    return fit.law.frequency**2 * fit.law.inertia * (path.roll - fit.law.rest_angle)


def weigh(fits: Sequence[tuple[Found, JointFit]], errors: Sequence[float]) -> list[float]:
    """Return the probability of each set among some fitted ones, of which the best reaches the noise.

    The log evidence is -χ²/2 - p/2 ln n for p parameters and n samples: Laplace's method with a unit-information prior, at ε = 0.

    χ² is in units of the error of the best fit. Source: Schwarz 1978; Kass and Raftery, JASA 90, 1995.

    Args:
        fits: Sets and their fits.
        errors: RMS error of each fit beside a walk of the sensor's zero.
    """
    noise = min(errors)
    logs = [
        -0.5 * fit.problem.samples * (error / noise) ** 2
        - 0.5 * len(fit.problem.names) * np.log(fit.problem.samples)
        + sum(log_odds(f) for f in found.families if f != "rest")
        for (found, fit), error in zip(fits, errors, strict=True)
    ]
    weights = np.exp(np.array(logs) - max(logs))
    return [float(w) for w in weights / weights.sum()]


def sizes_of(fit: JointFit, names: Sequence[str]) -> dict[str, Size]:
    """Return how much each of some effects does in the fitted motion, by family.

    The deviation is that of the effect's first parameter, as a share of it.
    """
    law = fit.law
    plain = law.of_joint()
    peaks = dict.fromkeys(names, 0.0)
    works = dict.fromkeys(names, 0.0)
    spring, lost = 1e-300, 0.0
    for time, path in _paths(fit):
        spring = max(spring, float(np.abs(_spring(fit, path)).max()))
        lost += law.damping * float(np.trapezoid(path.rate**2, time))
        for name in names:
            torque = effect_torque(plain, name, time, path.roll, path.rate)
            peaks[name] = max(peaks[name], float(np.quantile(np.abs(torque), 0.999)))
            if effect(name).states:
                spent = loss_of(torque[:, None], path.roll - law.rest_angle)[:, 0]
            else:  # what changes sign with the rate; the rest is stored
                spent = (torque - effect_torque(plain, name, time, path.roll, -path.rate)) / 2
            works[name] -= float(np.trapezoid(spent * path.rate, time))
    lost += sum(works.values())
    found: dict[str, Size] = {}
    for name in names:
        first = fit.quantities.get(f"{name}.{effect(name).parameters[0].name}")
        share = (
            first.std / abs(first.value)
            if first is not None and first.value and np.isfinite(first.std)
            else 0.0
        )
        torque, energy = peaks[name] / spring, works[name] / (lost or 1e-300)
        found[effect(name).family] = Size(
            torque_share=torque,
            torque_std=share * torque,
            energy_share=energy,
            energy_std=share * abs(energy),
        )
    return found
