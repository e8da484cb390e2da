"""Deviations from the record that a free decay alone does not show: another inertia, weight, clock or time step.

A decay holds k/I and d/I. An effect that changes just these cannot be fitted; it shows where the record knew them.
"""

from dataclasses import dataclass

import numpy as np

from sysid.board import Board
from sysid.effects import catalogue, effect
from sysid.effects._base import TorqueEffect
from sysid.fitting.result import JointFit
from sysid.joint.sampled import sampled_k_d
from sysid.quantity import SURE


@dataclass(frozen=True, slots=True)
class Deviation:
    """How a fit differs from the record."""

    effects: tuple[str, ...] = ()
    alike: tuple[tuple[str, ...], ...] = ()
    text: str = ""


def record_deviation(fit: JointFit, board: Board, *, linear: bool) -> Deviation:
    """Compare a fit with the record.

    Args:
        fit: Of the law that was chosen.
        board: The record.
        linear: Whether to compare stiffness and damping too; another effect changes them legitimately.
    """
    weight = _weight(fit)
    return weight if weight.text or not linear else _linear(fit, board)


def _weight(fit: JointFit) -> Deviation:
    """Compare the weight over the inertia with the record's, where nothing else pulls the joint back."""
    names, priors = list(fit.problem.names), fit.problem.priors
    ratio = next((name for name in names if name in priors and name in fit.quantities), None)
    if ratio is None:
        return Deviation()
    known, std = priors[ratio]
    index = list(fit.quantities).index(ratio)
    change = fit.quantities[ratio].value / known
    own = float(np.sqrt(max(fit.own_covariance[index, index], 0.0)))
    if abs(change - 1) < SURE * float(np.hypot(std, own)) / known:
        return Deviation()
    part = ratio.split(".")[0]
    causes = [name for name, other in catalogue().items() if part in other.identifiable_with]
    causes += [
        n
        for n, other in catalogue().items()
        if other.record_direction is not None and other.record_direction[0]
    ]
    text = (
        f"Weight over inertia is {100 * (change - 1):+.1f} % against the record, which knows it to ± {196 * std / known:.2g} %. "
        "A free decay cannot tell another inertia from another weight or a wrong clock."
    )
    return Deviation((causes[0],), tuple((name,) for name in causes[1:]), text)


def _linear(fit: JointFit, board: Board) -> Deviation:
    """Compare k/I and d/I with the record, and name one cause that changes both in this proportion."""
    record = {name: board.tilt[name] for name in ("stiffness", "damping")}
    if any(q.std <= 0 or q.value <= 0 for q in record.values()) or any(
        name not in fit.problem.names for name in record
    ):
        return Deviation()
    values = np.array([fit.quantities[name].value for name in record])
    if values.min() <= 0:
        return Deviation()
    pick = [list(fit.quantities).index(name) for name in record]
    logs = np.log(values / np.array([q.value for q in record.values()]))
    spread = fit.own_covariance[np.ix_(pick, pick)] / np.outer(values, values)
    spread = spread + np.diag([(q.std / q.value) ** 2 for q in record.values()])
    if float(logs @ np.linalg.solve(spread, logs)) < SURE**2:
        return Deviation()
    inverse = np.linalg.inv(spread)
    misses: list[tuple[float, str]] = []
    for name, part in catalogue().items():
        if part.record_direction is not None:
            way = np.array(part.record_direction)
            left = logs - float(way @ inverse @ logs) / float(way @ inverse @ way) * way
            misses.append((float(np.sqrt(left @ inverse @ left)), name))
        elif isinstance(part, TorqueEffect) and part.timestep:
            path = logs - np.array([stepped_logs(board, h) for h in np.geomspace(2e-4, 0.02, 200)])
            misses.append((float(np.sqrt(np.nanmin(np.einsum("ij,jk,ik->i", path, inverse, path)))), name))
    matches = [name for miss, name in sorted(misses) if miss < SURE]
    text = f"Against the record, k/I is {100 * np.expm1(logs[0]):+.1f} % and d/I {100 * np.expm1(logs[1]):+.1f} %."
    if not matches:
        return Deviation(
            text=f"{text} Stiffness and damping changed, or the inertia is another: a fit brings the record up to date."
        )
    titles = " or ".join(f"{name} ({effect(name).title})" for name in matches)
    return Deviation(
        (matches[0],), tuple((n,) for n in matches[1:]), f"{text} One cause explains both: {titles}."
    )


def stepped_logs(board: Board, h: float) -> tuple[float, float]:
    """Return ln(k'/k) and ln(d'/d) of the continuous joint that moves like the record stepped by implicitfast."""
    stiffness, damping = sampled_k_d(board.inertia.value, board.stiffness, board.damping, h)
    return float(np.log(stiffness / board.stiffness)), float(np.log(damping / board.damping))
