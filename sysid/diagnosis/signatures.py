"""Which effects some releases can show at all, and which of them would look the same.

The torque of each effect at a clear strength, whitened with the log as in `diagnose`, is its signature. Parts that spring, damper,
rest angle and starts can do are taken out. Its length is the effect's visibility in standard deviations of the noise. Two effects with a cosine of
1 between their signatures look the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.diagnosis.evidence import marginalised
from sysid.diagnosis.laws import Laws, candidates
from sysid.diagnosis.motion import motion_of
from sysid.diagnosis.posterior import SHARES, levels
from sysid.diagnosis.smoother import DIFFUSE, Smoother
from sysid.joint import JointLaw
from sysid.roll import Array, Release

ALIKE = 0.9
"""Cosine of two signatures from which they are called look-alikes."""


@dataclass(frozen=True, slots=True)
class LookAlikes:
    """Signatures of effects in some releases."""

    names: tuple[str, ...]
    strength: tuple[dict[str, float], ...]
    """Parameters of each effect as it was tried, in the units of the catalogue."""
    visibility: Array
    """Length of each signature at that strength, in standard deviations of the noise, shape (n,)."""
    cosine: Array
    """Absolute cosine between signatures, shape (n, n)."""

    def alike(self, name: str) -> tuple[str, ...]:
        """Return the effects that look like one in these releases."""
        row = self.cosine[self.names.index(name)]
        return tuple(n for n, c in zip(self.names, row, strict=True) if n != name and c >= ALIKE)


def look_alikes(releases: Sequence[Release], law: JointLaw, noise: float, *, rate: bool) -> LookAlikes:
    """Compare the signatures of all effects in releases of a joint.

    Args:
        releases: Free decays.
        law: The joint's law; its own effects act at their own strength, all others at the first start of the catalogue.
        noise: Standard deviation of a sample [rad or rad/s].
        rate: Whether the rate is judged.

    Raises:
        SysidError: No release holds enough motion.
    """
    motion = motion_of(releases, law.rest_angle, noise, rate=rate)
    w, own, inertia = motion.frequency, dict(law.effects), law.inertia * law.inertia_ratio
    stiffness, damping = (law.frequency / w) ** 2, law.damping / (inertia * w)
    smoother = Smoother(motion, stiffness, damping, motion.envelope)
    smoothed = smoother.smooth(SHARES[-2])
    laws = Laws(motion, inertia, stiffness, damping)
    names, strengths, columns = list[str](), list[dict[str, float]](), list[Array]()
    for name, part in candidates().items():
        clear = {
            p.name: p.starts[0] * p.size(laws.scales) if p.default is None else p.default
            for p in part.parameters
        }
        values = dict(zip(part.parameter_names, own[name], strict=True)) if name in own else clear
        (torque,) = laws.recorded(smoothed, [(part, values)])
        if 0 < np.abs(torque).max() < np.inf:
            names.append(name)
            strengths.append(values)
            columns.append(smoother.flat(torque))
    base = [smoother.flat(c) for c in (smoothed.angle, smoothed.rate, *levels(motion))]
    smoother.prepare(np.column_stack([*columns, *base]), np.zeros((smoother.size, 0)))
    gram, _ = smoother.gram(SHARES[0])
    gram, _ = marginalised(gram[1:, 1:], len(names), np.full(len(base), DIFFUSE))
    length = np.sqrt(np.diag(gram))
    return LookAlikes(tuple(names), tuple(strengths), length, np.abs(gram / np.outer(length, length)))
