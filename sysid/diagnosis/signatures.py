"""Which effects these releases can show at all, and which of them would look the same.

Each effect of the catalogue is added to the board's law at a clear strength, or removed from it, and the releases are simulated again.
The change, orthogonal to those of stiffness, damping, rest angle and starts, is the effect's signature. Its length over the noise is the
effect's visibility. Two effects with a cosine of 1 between their signatures look the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.effects import catalogue
from sysid.effects._base import Effect, Scales
from sysid.errors import SysidError
from sysid.joint import JointLaw, simulate
from sysid.roll import Array

MOST_RELEASES = 4
"""Releases looked at: the largest, the smallest, and the first ones between."""
SEEN = 4.0
"""Length of a signature, in standard deviations of the noise, from which an effect is seen."""
ALIKE = 0.9
"""Cosine of two signatures from which they are called look-alikes."""
GENTLE = 1e-3
"""Share of its strength at which a smooth effect of one parameter is tried: its signature is proportional to it there."""


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


@dataclass(frozen=True, slots=True)
class Start:
    """How one release begins, and when it was looked at."""

    time: Array
    """Since the release [s], shape (n,)."""
    angle: float
    """Roll at release [rad]."""
    rate: float
    """Roll rate at release [rad/s]."""
    hold: float
    """Held there before [s]."""


def look_alikes(law: JointLaw, starts: Sequence[Start], noise: float) -> LookAlikes | None:
    """Compare the signatures of all effects in releases of a board.

    Args:
        law: The board's law.
        starts: The releases.
        noise: Standard deviation of one sample of roll [rad].

    Returns:
        The comparison, or None where the law itself cannot be simulated from these starts.
    """
    starts = _chosen(starts)
    amplitude = max(abs(start.angle - law.rest_angle) for start in starts)
    scales = Scales(
        inertia=law.inertia,
        stiffness=law.frequency**2 * law.inertia,
        damping=max(law.damping, 1e-9),
        amplitude=amplitude,
        duration=max(float(start.time[-1]) for start in starts),
    )
    base = _motions(law, starts)
    if base is None:
        return None
    mimic = _mimics(law, starts, amplitude)
    names: list[str] = []
    strengths: list[dict[str, float]] = []
    signatures: list[Array] = []
    own = dict(law.effects)
    for name, part in catalogue().items():
        if part.role not in ("torque", "support"):
            continue
        values = own[name] if name in own else _clear(part, scales)
        signature = _signature(law, part, values, starts, base)
        if signature is None:
            continue
        signature = signature - mimic @ (mimic.T @ signature)
        if np.linalg.norm(signature) <= 1e-9 * amplitude:
            continue
        names.append(name)
        strengths.append(dict(zip(part.parameter_names, values, strict=True)))
        signatures.append(signature)
    if not names:
        return None
    lengths = np.array([float(np.linalg.norm(signature)) for signature in signatures])
    unit = np.array(signatures) / lengths[:, None]
    return LookAlikes(tuple(names), tuple(strengths), lengths / noise, np.abs(unit @ unit.T))


def _signature(
    law: JointLaw, part: Effect, values: tuple[float, ...], starts: Sequence[Start], base: Array
) -> Array | None:
    """Return what an effect changes in the roll of all releases [rad]; None if it makes them run away."""
    own = dict(law.effects)
    if len(values) == 1 and not part.slides and not part.nonsmooth:
        # A smooth effect: its derivative, by a central difference.
        at, step = own.get(part.name, (0.0,))[0], GENTLE * values[0]
        up, down = (_motions(law.with_effect(part.name, at + sign * step), starts) for sign in (1, -1))
        change = _half_difference(up, down)
        return None if change is None else change / GENTLE
    without = replace(law, effects=tuple(item for item in law.effects if item[0] != part.name))
    moved = _motions(without if part.name in own else law.with_effect(part.name, *values), starts)
    return None if moved is None else moved - base


def _chosen(starts: Sequence[Start]) -> list[Start]:
    by_size = sorted(starts, key=lambda start: -abs(start.angle))
    rest = [start for start in starts if start is not by_size[0] and start is not by_size[-1]]
    ends = by_size if len(by_size) < 2 else [by_size[0], by_size[-1]]
    return [*ends, *rest][:MOST_RELEASES]


def _clear(part: Effect, scales: Scales) -> tuple[float, ...]:
    """Return parameters at which an effect clearly shows: the catalogue's own first start."""
    return tuple(
        p.default if p.default is not None else p.starts[0] * p.size(scales) for p in part.parameters
    )


def _motions(law: JointLaw, starts: Sequence[Start], nudge: Array | None = None) -> Array | None:
    """Return the roll of all releases in a row [rad]; None if it grows without bound."""
    nudge = np.zeros((len(starts), 2)) if nudge is None else nudge
    try:
        return np.concatenate(
            [
                simulate(law, s.time, s.angle + da, s.rate + dv, hold=max(s.hold, 0.0)).roll
                for s, (da, dv) in zip(starts, nudge, strict=True)
            ]
        )
    except SysidError:
        return None


def _mimics(law: JointLaw, starts: Sequence[Start], amplitude: float) -> Array:
    """Return an orthonormal basis of the changes by stiffness, damping, rest angle and starts, shape (n, m)."""
    step = 1e-3
    laws: list[tuple[JointLaw, JointLaw]] = [
        (
            replace(law, stiffness=law.stiffness * (1 + step)),
            replace(law, stiffness=law.stiffness * (1 - step)),
        ),
        (
            replace(law, damping=law.damping * (1 + step) + 1e-9),
            replace(law, damping=law.damping * (1 - step) - 1e-9),
        ),
        (
            replace(law, rest_angle=law.rest_angle + step * amplitude),
            replace(law, rest_angle=law.rest_angle - step * amplitude),
        ),
    ]
    columns = [_half_difference(_motions(up, starts), _motions(down, starts)) for up, down in laws]
    for i in range(len(starts)):
        for j, size in enumerate((amplitude, amplitude * law.frequency)):
            nudge = np.zeros((len(starts), 2))
            nudge[i, j] = step * size
            columns.append(_half_difference(_motions(law, starts, nudge), _motions(law, starts, -nudge)))
    table = np.column_stack([column for column in columns if column is not None])
    table = table / np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    basis, sizes, _ = np.linalg.svd(table, full_matrices=False)
    return basis[:, sizes > 1e-6 * sizes[0]]


def _half_difference(up: Array | None, down: Array | None) -> Array | None:
    return None if up is None or down is None else (up - down) / 2
