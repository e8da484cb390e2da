"""The torque that a motion demands beside spring and damper, without any law: a Gaussian process of angle and rate.

The regression of the posterior with functions of angle and rate alone gives the torque at each node and its covariance. No log is
differentiated. Friction enters as a sign of the rate, powers as powers, all else as radial functions.

Source: Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, section 2.1 (a linear model with Gaussian weights).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.comparison.force_surface import TorqueProfile
from sysid.diagnosis.evidence import STRENGTH
from sysid.diagnosis.nuisances import named_functions, nameless, sensor
from sysid.diagnosis.posterior import NAMELESS, SHARES, Posterior, levels
from sysid.diagnosis.smoother import Smoother
from sysid.joint.law import JointLaw
from sysid.joint.torques import effect_torque
from sysid.roll import Array

BINS = 25
"""Bins of a profile, of equal width."""


@dataclass(frozen=True, slots=True)
class Demand:
    """The torque beside spring and damper of a law, along the smoothed motion."""

    angle: Array
    """About rest [rad], shape (n,)."""
    rate: Array
    """[rad/s], shape (n,)."""
    torque: Array
    """[N*m], shape (n,)."""
    spread: Array
    """Square root of its covariance [N*m], shape (n, f)."""

    def over(self, at: Array) -> TorqueProfile:
        """Return the mean torque in bins of the angle or the rate, with its deviation.

        Args:
            at: `angle` [rad] or `rate` [rad/s], shape (n,).
        """
        edges = np.linspace(at.min(), at.max(), BINS + 1)
        places = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, BINS - 1)
        bins = [np.flatnonzero(places == b) for b in np.unique(places)]
        mean = [float(self.torque[b].mean()) for b in bins]
        std = [float(np.linalg.norm(self.spread[b].mean(axis=0))) for b in bins]
        return TorqueProfile(np.array([float(at[b].mean()) for b in bins]), np.array(mean), np.array(std))


def demanded(found: Posterior, law: JointLaw, beside: Sequence[str] = ()) -> Demand:
    """Return the torque that the motion of a posterior demands beside spring and damper of a law, and beside some of its effects."""
    motion, smoothed, inside = found.motion, found.smoothed, found.motion.inside
    x, v = smoothed.angle[inside], smoothed.rate[inside]
    linear = float(np.sqrt(np.mean((found.stiffness * x) ** 2)))
    base = np.column_stack([x, v, *(level[inside] for level in levels(motion))])
    known = named_functions(x, v)[:, 3:]
    known = known * (linear / np.maximum(np.sqrt(np.mean(known**2, axis=0)), 1e-12))
    free = nameless(motion, smoothed, linear, found.damping)
    table = np.column_stack([base, known, free])
    sensed, loose = sensor(motion, smoothed)
    smoother = Smoother(motion, found.stiffness, found.damping, motion.envelope)
    smoother.prepare(table, sensed)
    gram, _ = smoother.gram(max(found.share, SHARES[0]))
    prior = np.r_[
        np.ones(base.shape[1]), np.full(known.shape[1], STRENGTH), np.full(free.shape[1], NAMELESS[-1]), loose
    ]
    inner = gram[1:, 1:] + np.diag(prior**-2.0)
    kept = table.shape[1]
    means = np.linalg.solve(inner, gram[1:, 0])[:kept]
    root = np.linalg.cholesky(np.linalg.inv(inner)[:kept, :kept])
    unit = (
        law.inertia * motion.frequency**2 * motion.amplitude
    )  # torque of a spring with ω₀ at the widest swing
    spring, damper = (
        law.stiffness / (law.inertia * motion.frequency**2), law.damping / (law.inertia * motion.frequency)
    )  # fmt: skip
    moved = (
        (law.rest_angle - motion.rest) / motion.amplitude
        if motion.zero == "known" and not motion.is_rate
        else 0.0
    )
    torque = table @ means + found.stiffness * x - spring * (x - moved) + (found.damping - damper) * v
    angle, rate = motion.amplitude * x, motion.amplitude * motion.frequency * v
    explained = np.zeros_like(torque)
    for row in np.unique(rows := np.nonzero(inside)[0]):
        one = rows == row
        time = np.arange(np.count_nonzero(one), dtype=np.float64) * (motion.step / motion.frequency)
        for name in beside:
            explained[one] += effect_torque(law, name, time, motion.rest + angle[one], rate[one])
    return Demand(angle=angle, rate=rate, torque=-unit * torque - explained, spread=unit * (table @ root))
