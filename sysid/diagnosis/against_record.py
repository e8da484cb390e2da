"""What a free decay shows only against the board's record: another rest angle, inertia, weight or clock.

A decay alone holds k/I, d/I and a constant shift. Effects that change just these cannot be found by
fitting; they show where the record knew the numbers, as a deviation with a direction of its own.
"""

from dataclasses import dataclass

import numpy as np

from sysid.board import Board
from sysid.diagnosis.search import Candidate, promise
from sysid.effects import catalogue, drifting, effect
from sysid.effects._base import TorqueEffect
from sysid.fitting.covariance import parameter_covariance, scale_covariance
from sysid.fitting.search import catalogue_starts
from sysid.joint.sampled import sampled_k_d
from sysid.joint.structure import structure_of
from sysid.noise.floor import pooled_step
from sysid.noise.whiteness import correlation_length
from sysid.text import display

SURE = 4.0
"""Standard deviations from which a deviation counts."""
SMALLEST_SHIFT = 0.01
"""Of the rest angle over the amplitude, below which it does not matter: its torque is as small a share of the spring's."""
TIE, BETTER = 8.0, 6.0
"""χ² within which two causes look the same, and from which one is the better."""
NEAR = 3.0
"""Standard deviations within which a cause explains how the fitted numbers differ from the record."""
BEGUN = 8
"""Iterations after which a start is left where it is if it does not promise to be so near: a choice."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """How the fitted numbers differ from the record."""

    effects: tuple[str, ...] = ()
    alike: tuple[tuple[str, ...], ...] = ()
    text: str = ""
    experiment: str = ""


def record_deviation(model: Candidate, board: Board, *, look_at_linear: bool) -> Deviation:
    """Compare a fitted model with the record.

    Args:
        model: The model that was chosen.
        board: The record.
        look_at_linear: Compare stiffness and damping too; with another effect in the model they
            legitimately differ.
    """
    covariance = parameter_covariance(model.problem, model.minimum, model.residuals)
    covariance = covariance + scale_covariance(model.problem, model.minimum)
    names = list(model.problem.names)
    linear = _linear(model, board, covariance, names) if look_at_linear else Deviation()
    linear = linear if linear.text else _pulls_back(model, board, covariance, names)
    named = tuple(name for name in linear.effects if effect(name).role in ("torque", "measurement"))
    shift = _shift(model, board, covariance, names, named)
    effects = (*linear.effects, *shift.effects)
    alike = [(*other, *shift.effects) for other in linear.alike]
    alike += [(*linear.effects, *other) for other in shift.alike]
    return Deviation(
        effects, tuple(alike), f"{linear.text} {shift.text}".strip(), linear.experiment or shift.experiment
    )


def _pulls_back(model: Candidate, board: Board, covariance: np.ndarray, names: list[str]) -> Deviation:
    """Compare what alone pulls the joint back, over its inertia, with the record, and name what would change it."""
    priors = model.problem.priors
    ratio = next((name for name in names if name in priors), None)
    if ratio is None:
        return Deviation()
    index, (known, std) = names.index(ratio), priors[ratio]
    change = model.parameters[ratio] / known
    if abs(change - 1) < SURE * float(np.hypot(std, np.sqrt(max(covariance[index, index], 0.0)))) / known:
        return Deviation()
    causes = [name for name, part in catalogue().items() if ratio.split(".")[0] in part.identifiable_with]
    causes += [
        name
        for name, part in catalogue().items()
        if part.record_direction is not None and part.record_direction[0]
    ]
    text = (
        f"What pulls it back over its inertia is {100 * (change - 1):+.1f} % against the record, which knows it to "
        f"± {196 * std / known:.2g} %; a free decay cannot tell whether the inertia is another, the weight, or the log's clock."
    )
    return Deviation((causes[0],), tuple((name,) for name in causes[1:]), text, board.experiment(causes[0]))


def _shifts(name: str) -> bool:
    """Whether an effect moves the middle of a decay, at once or slowly, and a free decay can show no more of it."""
    part = effect(name)
    return "rest_angle" in part.same_as or name in drifting() or not part.identifiable_from_decay


def _shift(
    model: Candidate, board: Board, covariance: np.ndarray, names: list[str], named: tuple[str, ...]
) -> Deviation:
    """Name the rest angle if it moved; what moved it cannot be told. `named` is said already and may explain it."""
    grounded = any(part.adds_stiffness for part in model.problem.structure.torques)
    if "rest_angle" not in names or model.problem.bias == "per-release" or grounded:
        return Deviation()
    if model.problem.records[0].is_rate:
        return Deviation()
    index = names.index("rest_angle")
    moved = model.parameters["rest_angle"] - board.rest_angle
    rounding = pooled_step([r.release for r in model.problem.records], rate=False) / np.sqrt(12)
    known = board.tilt["rest_angle"].std
    deviation = float(np.sqrt(max(covariance[index, index], 0.0) + known**2 + rounding**2))
    rest = model.parameters["rest_angle"]
    amplitude = max(float(np.abs(record.signal - rest).max()) for record in model.problem.records)
    if abs(moved) < max(SURE * deviation, SMALLEST_SHIFT * amplitude):
        return Deviation()
    show = display(is_rate=False, slides=board.slides)
    far = f"{show.scale * moved:+.3g}{show.unit}"
    if board.is_unmeasured:
        return Deviation(
            text=f"The deck rests {far} from the log's zero: the record has no rest angle yet, and a fit writes it."
        )
    # Where a deck sticks the cost has kinks, and the deviation above may be too small: refit without the shift.
    slack = 2 * float(np.hypot(known, rounding))
    held = board.rest_angle + float(np.clip(moved, -slack, slack))
    named = tuple(name for name in named if not _shifts(name))
    if _worse(model, held) < SURE**2 or (named and _worse(model, held, *named) < SURE**2):
        return Deviation()
    moved_by = [name for name, part in catalogue().items() if "rest_angle" in part.same_as]
    drift = drifting()[0]
    by_drift = _worse(model, held, drift) if drift not in model.effects else float("inf")
    if by_drift < -BETTER:
        text = (
            f"The middle of the decay is {far} from the record's rest angle, and a sensor that drifts "
            "explains that better than a rest angle that moved."
        )
        alike = tuple((name,) for name in moved_by) if by_drift > -TIE else ()
        return Deviation((drift,), alike, text, board.experiment(drift))
    others = [*moved_by[1:], *([drift] if by_drift < TIE else [])]
    torque = model.parameters["stiffness"] * moved
    text = (
        f"The deck rests {far} from the record's rest angle: its rest angle moved, or a "
        f"constant {'force' if board.slides else 'torque'} of {torque:+.3g} {'N' if board.slides else 'N*m'} acts, or the sensor is off by as much; a free decay cannot tell."
    )
    return Deviation((moved_by[0],), tuple((name,) for name in others), text, board.experiment(moved_by[0]))


def _worse(model: Candidate, rest_angle: float, *more: str) -> float:
    """Return how much worse a model fits with its rest angle held, and with effects more, in χ² of the residual."""
    problem = model.problem
    held = problem.with_(
        structure=structure_of(tuple(sorted((*model.effects, *more)))),
        fixed={**problem.fixed, "rest_angle": rest_angle},
    )
    known = {**dict.fromkeys(held.names, 0.0), **model.parameters}
    rough = [name for name in held.structure.rough if name in held.names]
    starts = [
        held.start({**known, **{name: share * known[name] for name in rough}})
        for share in ((0.6, 0.8, 1.0, 1.25, 1.6) if rough else (1.0,))
    ]
    costs = [held.fitted(start, 25, 1e-6).normal.cost for start in starts]
    unit = max(model.chi2 / model.samples, 0.25) * max(1.0, correlation_length(model.residuals))
    return (2 * min(costs) - 2 * model.minimum.normal.cost) / unit


def _linear(model: Candidate, board: Board, covariance: np.ndarray, names: list[str]) -> Deviation:
    """Compare k/I and d/I with the record, and name what would change them in just this proportion."""
    record = {name: board.tilt[name] for name in ("stiffness", "damping")}
    known = all(q.std > 0 for q in record.values())
    if not known or any(name not in names for name in record) or model.parameters["damping"] <= 0:
        return Deviation()
    values = np.array([model.parameters[name] for name in record])
    if values[0] <= 0:
        return Deviation()
    pick = [names.index(name) for name in record]
    logs = np.log(values / np.array([q.value for q in record.values()]))
    spread = covariance[np.ix_(pick, pick)] / np.outer(values, values)
    spread = spread + np.diag([(q.std / q.value) ** 2 for q in record.values()])
    if float(logs @ np.linalg.solve(spread, logs)) < SURE**2 + 3.0:
        return Deviation()
    misses = _explanations(logs, spread, board) + _faithful(model, board)
    near = sorted((len(effect(name).parameters), miss, name) for name, miss in misses if miss < NEAR)
    matches = [name for _, _, name in near]
    change = (
        f"Against the record, k/I is {100 * np.expm1(logs[0]):+.1f} % and d/I is {100 * np.expm1(logs[1]):+.1f} %; a free decay "
        "cannot tell whether stiffness and damping changed or "
    )
    titles = [f"'{name}' ({effect(name).title})" for name in matches]
    cause = "the inertia did"
    if titles:
        cause = "one cause makes both, " + " or ".join(filter(None, (", ".join(titles[:-1]), titles[-1])))
    text = f"{change}{cause}."
    # With more numbers than the two that changed, an effect says no more than that they did.
    if not matches or len(effect(matches[0]).parameters) > len(record):
        return Deviation(text=f"{text} A fit to these logs brings the record up to date.")
    return Deviation(
        (matches[0],),
        tuple((name,) for name in matches[1:]),
        text,
        board.experiment(matches[0]),
    )


def _faithful(model: Candidate, board: Board) -> list[tuple[str, float]]:
    """Return effects that fit with the record's own stiffness and damping, and how badly.

    An effect that is too weak to show in the shape of the decay may still have moved the k and d that a fit
    without it finds. The distance is that of inertia or clock: how much worse the fit with the effect is,
    and how far it is from the record, in standard deviations. A support that takes from the stiffness starts as what was taken.
    """
    problem, found = model.problem, list[tuple[str, float]]()
    priors = {key: (board.tilt[key].value, board.tilt[key].std) for key in ("stiffness", "damping")}
    record = {key: value for key, (value, _) in priors.items()}
    softer = max(1 / model.parameters["stiffness"] - 1 / record["stiffness"], 1e-300)
    for name, part in catalogue().items():
        acts = part.role in ("torque", "measurement", "support") and name not in model.effects
        if not acts or part.record_direction is not None or _shifts(name):
            continue
        richer = problem.with_(structure=structure_of((*model.effects, name)), priors=priors)
        alone = structure_of((name,))
        given = {f"{name}.{support.series_stiffness}": 1 / softer for support in alone.supports}
        own = catalogue_starts(alone, problem.scales)
        starts = [richer.start({**model.parameters, **record, **start, **given}) for start in own]
        begun = [richer.fitted(start, BEGUN, 1e-6) for start in starts]
        enough = model.minimum.normal.cost + 0.5 * NEAR**2
        hopeful = [m for m in begun if promise(m) < enough]
        ends = [richer.fitted(m.point, 60, 1e-6, m.normal) for m in hopeful] or begun
        cost = min(m.normal.cost for m in ends)
        found.append((name, float(np.sqrt(max(2 * (cost - model.minimum.normal.cost), 0.0)))))
    return found


def _explanations(logs: np.ndarray, spread: np.ndarray, board: Board) -> list[tuple[str, float]]:
    """Return effects with one parameter and their distance from (ln k, ln d) in standard deviations."""
    inverse = np.linalg.inv(spread)
    misses: list[tuple[str, float]] = []
    for name, part in catalogue().items():
        if part.record_direction is None:
            continue
        d = np.array(part.record_direction)
        along = float(d @ inverse @ logs) / float(d @ inverse @ d)
        rest = logs - along * d
        misses.append((name, float(np.sqrt(rest @ inverse @ rest))))
    steps = np.geomspace(2e-4, 0.02, 400)
    path = np.array([stepped_logs(board, h) for h in steps])
    rest = logs - path
    distance = np.sqrt(np.einsum("ij,jk,ik->i", rest, inverse, rest))
    steps_time = (n for n, part in catalogue().items() if isinstance(part, TorqueEffect) and part.timestep)
    misses += [(name, float(np.nanmin(distance))) for name in steps_time]
    return sorted(misses, key=lambda item: item[1])


def stepped_logs(board: Board, h: float) -> tuple[float, float]:
    """Return ln(k'/k) and ln(d'/d) of the continuous joint that moves like the record stepped by implicitfast."""
    stiffness, damping = sampled_k_d(board.inertia.value, board.stiffness, board.damping, h)
    return float(np.log(stiffness / board.stiffness)), float(np.log(damping / board.damping))
