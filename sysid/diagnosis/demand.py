"""The torque that a motion demands beside spring and damper, without any law: a Gaussian process of angle and rate.

The regression of the posterior with functions of angle and rate alone gives the torque at each node and its covariance. No log is
differentiated. Friction enters as a sign of the rate, powers as powers, all else as radial functions. The share ε of torque noise is the
likeliest one.

Source: Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, section 2.1 (a linear model with Gaussian weights).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sysid.diagnosis.evidence import STRENGTH, marginalised
from sysid.diagnosis.laws import Laws
from sysid.diagnosis.motion import Motion, motion_of
from sysid.diagnosis.nuisances import named_functions, nameless, sensor
from sysid.diagnosis.posterior import NAMELESS, PASSES, SHARES, levels, linear_joint, until_still
from sysid.diagnosis.smoother import Smoothed, Smoother
from sysid.joint.law import JointLaw
from sysid.roll import Array, Release

BINS = 25
"""Bins of a profile, of equal width."""


@dataclass(frozen=True, slots=True)
class TorqueProfile:
    """A torque against angle or rate alone."""

    at: Array
    """Mean angle [rad] or rate [rad/s] of each bin, shape (n,)."""
    torque: Array
    """Mean torque [N*m], shape (n,)."""
    std: Array
    """Standard deviation of that mean [N*m], shape (n,)."""


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
    release: npt.NDArray[np.intp]
    """Place of the release among those given, shape (n,)."""
    time: Array
    """On the log's clock [s], shape (n,)."""
    frequency: float
    """Natural frequency of the smoothed joint [rad/s]."""
    share: float
    """Share ε of torque noise in the smoothing [1]."""

    def less(self, other: "Demand") -> "Demand":
        """Return the demand beyond another one of the same releases, at the times that both have."""
        beyond = np.full_like(self.torque, np.nan)
        for release in np.unique(other.release):
            mine, its = self.release == release, other.release == release
            theirs = np.interp(self.time[mine], other.time[its], other.torque[its], left=np.nan, right=np.nan)
            beyond[mine] = self.torque[mine] - theirs
        both = np.isfinite(beyond)
        parts = {name: getattr(self, name)[both] for name in ("angle", "rate", "spread", "release", "time")}
        return replace(self, torque=beyond[both], **parts)

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


def demand_of(
    releases: Sequence[Release], law: JointLaw, noise: float, *, rate: bool, beside: Sequence[str] = (),
    like: Demand | None = None,
) -> Demand:  # fmt: skip
    """Return the torque that releases demand beside spring and damper of a law.

    Args:
        releases: Free decays.
        law: The law.
        noise: Noise of a sample [rad or rad/s].
        rate: Whether to use the measured rate.
        beside: Effects of the law whose torque is taken off too.
        like: A demand whose frequency and torque noise to use.

    Raises:
        SysidError: No release holds enough motion.
    """
    known = None if like is None else like.frequency
    motion = motion_of(releases, law.rest_angle, noise, rate=rate, frequency=known)
    stiffness, damping = linear_joint(motion)
    motion = until_still(motion, stiffness, damping)
    shares = SHARES if like is None else (like.share,)
    found = _regressed(motion, stiffness, damping, SHARES[-2], None, shares)
    for _ in range(PASSES - 1):
        found = _regressed(motion, stiffness, damping, found.share, found.torque, shares)
    table, inside = found.table, motion.inside
    if motion.zero != "known":  # a constant torque is the zero of the sensor
        table[:, 2 : 2 + len(levels(motion))] = 0.0
    x, v = found.smoothed.angle[inside], found.smoothed.rate[inside]
    inertia = law.inertia * law.inertia_ratio
    spring = law.stiffness / (inertia * motion.frequency**2)
    damper = law.damping / (inertia * motion.frequency)
    opposing = table @ found.means + (stiffness - spring) * x + (damping - damper) * v
    laws = Laws(motion, inertia, spring, damper)
    opposing -= _opposing(laws, law, beside, found.smoothed)[inside]
    return Demand(
        angle=motion.amplitude * x,
        rate=motion.amplitude * motion.frequency * v,
        torque=-laws.unit * opposing,
        spread=laws.unit * (table @ found.root),
        release=np.broadcast_to(motion.releases[:, None], inside.shape)[inside],
        time=(motion.starts[:, None] + np.arange(inside.shape[1]) * motion.step / motion.frequency)[inside],
        frequency=motion.frequency,
        share=found.share,
    )


class _Regressed(NamedTuple):
    """One pass of smoothing and regression."""

    smoothed: Smoothed
    table: Array
    """Functions of angle and rate [1], shape (n, f)."""
    means: Array
    """Their strengths [1], shape (f,)."""
    root: Array
    """Square root of the strengths' covariance [1], shape (f, f)."""
    share: float
    """The likeliest ε [1]."""
    torque: Array
    """Their torque on the grid [1], shape (r, n)."""


def _regressed(
    motion: Motion,
    stiffness: float,
    damping: float,
    share: float,
    torque: Array | None,
    shares: Sequence[float],
) -> _Regressed:
    """Smooth the motion under a torque, shape (r, n) [1], and return the regression of the log on the smoothed motion.

    The likeliest of some shares ε of torque noise [1] is used.
    """
    smoother = Smoother(motion, stiffness, damping, motion.envelope)
    smoothed = smoother.smooth(share, torque)
    table, prior = _functions(motion, smoothed, stiffness, damping)
    sensed, loose = sensor(motion, smoothed)
    smoother.prepare(table, sensed)
    wide = np.concatenate([prior, loose])
    likeliest = max(shares, key=lambda one: _log_evidence(smoother, one, wide))
    gram, _ = smoother.gram(likeliest)
    covariance = np.asarray(np.linalg.inv(gram[1:, 1:] + np.diag(wide**-2.0)), dtype=np.float64)
    kept = len(prior)
    means = (covariance @ gram[1:, 0])[:kept]
    root = np.asarray(np.linalg.cholesky(covariance[:kept, :kept]), dtype=np.float64)
    return _Regressed(smoothed, table, means, root, likeliest, smoother.grid(table @ means))


def _log_evidence(smoother: Smoother, share: float, wide: Array) -> float:
    """Return the log evidence of ε, with all functions of these prior deviations marginalised, shape (f,) [1]."""
    gram, spread = smoother.gram(share)
    left, factor = marginalised(gram, 1, wide)
    return factor - 0.5 * spread - 0.5 * float(left[0, 0])


def _functions(motion: Motion, smoothed: Smoothed, stiffness: float, damping: float) -> tuple[Array, Array]:
    """Return functions of angle and rate [1], shape (n, f), and their prior deviations [1], shape (f,)."""
    inside = motion.inside
    x, v = smoothed.angle[inside], smoothed.rate[inside]
    linear = float(np.sqrt(np.mean((stiffness * x) ** 2)))
    base = np.column_stack([x, v, *(level[inside] for level in levels(motion))])
    known = named_functions(x, v)[:, 3:]
    known = known * (linear / np.maximum(np.sqrt(np.mean(known**2, axis=0)), 1e-12))
    free = nameless(motion, smoothed, linear, damping)
    deviations = (
        np.ones(base.shape[1]),
        np.full(known.shape[1], STRENGTH),
        np.full(free.shape[1], NAMELESS[-1]),
    )
    return np.column_stack([base, known, free]), np.concatenate(deviations)


def _opposing(laws: Laws, law: JointLaw, names: Sequence[str], smoothed: Smoothed) -> Array:
    """Return the opposing torque of some effects of a law over I ω₀² A [1], shape (r, n)."""
    values = dict(law.effects)
    own = [(part, part.named(values[part.name])) for part in law.structure.torques if part.name in names]
    return sum(laws.recorded(smoothed, own), np.zeros_like(smoothed.angle))
