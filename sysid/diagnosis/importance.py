"""How much an effect matters: what a user of the joint would notice, whatever a statistician can prove."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.diagnosis.search import Candidate
from sysid.effects import effect
from sysid.effects._algebra import NUMPY
from sysid.effects._base import JointState, Scales, TorqueEffect
from sysid.errors import SysidError
from sysid.joint.law import JointLaw
from sysid.joint.torques import effect_torque, torque_shares
from sysid.joint.trajectory import simulate
from sysid.roll import Array

TORQUE, ENERGY, AMPLITUDE, SIGNAL = 0.01, 0.03, 0.01, 0.01
"""Shares of which any one that is reached makes an effect matter: of the joint's peak torque, of the dissipated energy, of the
widest first amplitude after ten periods, and of the RMS motion that nothing else explains. A spring is known to a few percent."""
PERIODS = 10
"""Over which the loss of amplitude is compared: two seconds of a stiff board."""


@dataclass(frozen=True, slots=True)
class Importance:
    """Size of some effects together."""

    torque_share: float
    """Largest peak torque of one of them over the peak of spring and damper."""
    energy_share: float
    """What they dissipate over all that is dissipated."""
    amplitude_after_10_periods: float
    """How much wider or narrower the swing would be without them, over the widest first amplitude."""
    signal_share: float
    """What is missed without them and not with them, over the motion, both RMS."""
    each: dict[str, float]
    """Torque share of each."""

    @property
    def matters(self) -> bool:
        """Whether any one of the sizes reaches its limit: the one rule of what is named, and of what is a hint only."""
        return (
            self.torque_share >= TORQUE or self.energy_share >= ENERGY
            or self.amplitude_after_10_periods >= AMPLITUDE or self.signal_share >= SIGNAL
        )  # fmt: skip

    def to_json(self) -> dict[str, float]:
        """Return the three sizes of the result file."""
        return {
            "torque_share": self.torque_share,
            "energy_share": self.energy_share,
            "amplitude_after_10_periods": self.amplitude_after_10_periods,
        }


def importance(model: Candidate, names: Sequence[str], base: Candidate) -> Importance:
    """Return how much some of a model's effects matter, against a fitted joint without them.

    Args:
        model: That has them.
        names: Of the effects.
        base: Fitted without them.
    """
    problem, point = model.problem, model.minimum.point
    law = JointLaw.from_vector(problem.structure, problem.vector_of(problem.parameters(point)))
    starts = problem.starts(point)
    times = [record.time for record in problem.records]
    names = [n for n in names if not _does_nothing(law, n, problem.scales)]
    inside = [n for n in names if effect(n).role != "measurement"]
    each = torque_shares(law, times, starts, inside) if inside else {}
    for part in (p for p in problem.structure.torques if p.adds_stiffness and p.name in each):
        widest = max(
            float(np.abs(record.signal - np.median(record.signal)).max()) for record in problem.records
        )
        widest = problem.scales.amplitude if problem.records[0].is_rate else widest
        each[part.name] *= _bend(law, part, min(widest, np.pi / 2))
    fall = max(_mean_square(base.residuals) - _mean_square(model.residuals), 0.0)
    motion = _mean_square([record.signal - np.median(record.signal) for record in problem.records])
    return Importance(
        torque_share=max(each.values(), default=0.0),
        energy_share=_energy_share(law, times, starts, inside),
        amplitude_after_10_periods=_amplitude_share(law, starts, inside),
        signal_share=float(np.sqrt(fall / max(motion, 1e-300))) if names else 0.0,
        each=each,
    )


def reading_share(model: Candidate, names: Sequence[str]) -> float:
    """Return how far some effects of the sensor take its reading from the roll, over the motion, both RMS; 0 where none is one's."""
    problem, point = model.problem, model.minimum.point
    law = JointLaw.from_vector(problem.structure, problem.vector_of(problem.parameters(point)))
    sensed = [e for e in law.effects if e[0] in names and effect(e[0]).role == "measurement"]
    if not sensed:
        return 0.0
    true = replace(law, effects=tuple(e for e in law.effects if e not in sensed))
    off = whole = 0.0
    for record, start in zip(problem.records, problem.starts(point), strict=True):
        read, roll = (simulate(one, record.time, *start).roll for one in (law, true))
        off += float(np.sum((read - roll) ** 2))
        whole += float(np.sum((roll - law.rest_angle) ** 2))
    return float(np.sqrt(off / max(whole, 1e-300)))


def _does_nothing(law: JointLaw, name: str, scales: Scales) -> bool:
    """Return whether a torque law came out with no strength: it is zero wherever the joint can be."""
    part = effect(name)
    if not isinstance(part, TorqueEffect) or part.modifies is not None:
        return False
    values = part.named(dict(law.effects)[name])
    corners = itertools.product((-1.0, 1.0), repeat=2 + len(part.states))
    tilt, rate, *states = np.array(list(corners)).T
    motion = JointState(scales.amplitude * tilt, scales.rate * rate, scales.amplitude * tilt, law.stiffness)
    inner = [state.size(scales) * corner for state, corner in zip(part.states, states, strict=True)]
    torque = np.abs(part.torque(NUMPY, motion, values, inner) + 0.0 * tilt).max()
    rubbed = (
        0.0
        if part.friction is None
        else float(np.max(part.friction(NUMPY, scales.amplitude, np.array([0.0, scales.rate]), values)))
    )
    return max(float(torque), rubbed) < 1e-9 * scales.torque


def _bend(law: JointLaw, part: TorqueEffect, tilt: float) -> float:
    """Return what a spring of the same stiffness does not do of an effect's torque at a tilt, as a share of it."""
    still, along = np.zeros(1), np.array([tilt])
    torque = effect_torque(replace(law, rest_angle=0.0), part.name, still, along, still)
    return float(abs(1 + torque[0] / (_stiffness(law, part.name) * tilt)))


def _stiffness(law: JointLaw, name: str) -> float:
    """Return what an effect adds to the joint's stiffness at small tilts [N*m/rad]."""
    part, values = effect(name), dict(law.effects).get(name)
    added = part.adds_stiffness if isinstance(part, TorqueEffect) else ""
    return part.named(values).get(added, 0.0) if values else 0.0


def _mean_square(arrays: Sequence[Array]) -> float:
    return float(np.mean(np.concatenate(list(arrays)) ** 2))


def _energy_share(
    law: JointLaw, times: Sequence[Array], starts: Sequence[tuple[float, float]], names: Sequence[str]
) -> float:
    """Return what effects dissipate over what the whole joint dissipates, over some releases."""
    plain = _unsensed(law)
    mine = whole = 0.0
    for time, (angle, rate) in zip(times, starts, strict=True):
        grid = np.linspace(0.0, float(time[-1]), 2000)
        path = simulate(plain, grid, angle, rate)
        whole += float(np.trapezoid(law.damping * path.rate**2, grid))
        for name, _ in plain.effects:
            torque = effect_torque(plain, name, grid, path.roll, path.rate)
            if not effect(name).states:  # what it has at no rate it gives back
                torque = torque - effect_torque(plain, name, grid, path.roll, np.zeros_like(path.rate))
            lost = -float(np.trapezoid(torque * path.rate, grid))
            whole += lost
            mine += lost if name in names else 0.0
    return float(np.clip(mine / whole, 0.0, 1.0)) if whole > 0 else 0.0


def _amplitude_share(law: JointLaw, starts: Sequence[tuple[float, float]], names: Sequence[str]) -> float:
    """Return by how much the amplitude after ten periods differs without some effects, over the widest first amplitude.

    Over the widest: a stretch that begins when the deck hardly swings any more would make anything matter.
    """
    plain = _unsensed(law)
    spring = law.stiffness + sum(_stiffness(law, name) for name in names)
    without = replace(plain, stiffness=spring, effects=tuple(e for e in plain.effects if e[0] not in names))
    if spring + without.stiffness_of_effects <= 0:
        return 1.0
    period = 2 * np.pi / plain.frequency
    grid = np.linspace(0.0, (PERIODS + 0.5) * period, 200 * PERIODS)
    late = grid >= (PERIODS - 0.5) * period
    largest = 0.0
    for angle, _ in starts:
        try:
            spans = [float(np.ptp(simulate(one, grid, angle).roll[late])) / 2 for one in (plain, without)]
        except SysidError:
            return 1.0
        largest = max(largest, abs(spans[0] - spans[1]))
    widest = max(abs(angle - law.rest_angle) for angle, _ in starts)
    return min(largest / max(widest, 1e-9), 1.0)


def _unsensed(law: JointLaw) -> JointLaw:
    return replace(law, effects=tuple(e for e in law.effects if effect(e[0]).role != "measurement"))
