"""Covariance and intervals of the fitted parameters, and what the data leave open, in words."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.board import Board
from sysid.effects import effect
from sysid.fitting.problem import Problem
from sysid.fitting.records import Record
from sysid.joint.structure import Structure
from sysid.least_squares import Minimum
from sysid.noise.autoregression import ResidualNoise, residual_noise
from sysid.noise.lasting import kept_after, own_std
from sysid.quantity import Quantity, slide_unit
from sysid.roll import Array


def common_covariance(problem: Problem, minimum: Minimum, board: Board) -> Array:
    """Return the covariance of the free parameters from errors common to all releases, shape (free, free), in their units.

    These are the errors of the inertia, of a known weight, and of the sensor's scale: more releases leave them as they are.
    """
    shifts = (*torque_shifts(problem, minimum, board), scale_shift(problem, minimum))
    return sum((np.outer(shift, shift) for shift in shifts), np.zeros((len(problem.names),) * 2))


def scale_shift(problem: Problem, minimum: Minimum) -> Array:
    """Return how far one deviation of the sensor's scale moves the free parameters, shape (free,), in their units.

    A signal y that is larger by a share ε moves the minimum by H⁻¹ Jᵀ y ε. A linear joint's spring and damper stay, whatever the scale.
    """
    shared, stds = len(problem.names), [record.release.scale_std for record in problem.records]
    if not any(stds):
        return np.zeros(shared)
    sensitivity = sensitivity_of(problem, minimum)
    pull = np.zeros(shared)
    for row, std, record in zip(sensitivity.rows, stds, problem.records, strict=True):
        pull += row.T @ (std * record.signal)
    return sensitivity.root @ (sensitivity.root.T @ pull) * problem.sizes()[:shared]


def torque_shifts(problem: Problem, minimum: Minimum, board: Board) -> tuple[Array, Array]:
    """Return how far one deviation of the inertia, and of a held weight, move the free parameters, shape (free,) each, in their units.

    All torques scale with the inertia. A fitted inertia scales with the weight, as all torques do.
    """
    parameters, inertia = problem.parameters(minimum.point), board.inertia
    torques = np.array([parameters[n] if torque_like(problem, n) else 0.0 for n in problem.names])
    added = {f"{part.name}.{part.adds_inertia}" for part in problem.structure.torques if part.adds_inertia}
    shares = [
        q.std / abs(q.value)
        for part in board.effects for p in effect(part.name).parameters
        if p.assumed and f"{part.name}.{p.name}" in problem.fixed and (q := part.parameters[p.name]).value
    ]  # fmt: skip
    if not added & {*problem.names}:
        shares = []
    scaled = torques + np.array([inertia.value if name in added else 0.0 for name in problem.names])
    return torques * (inertia.std / inertia.value), scaled * float(np.linalg.norm(shares))


def torque_like(problem: Problem, name: str) -> bool:
    """Whether a parameter scales with the roll inertia: a decay fixes only its ratio to it."""
    return _units(problem.structure)[name][:3] in ("N*m", "kg*")


def parameter_quantities(
    problem: Problem, minimum: Minimum, covariance: Array, *, slides: bool
) -> dict[str, Quantity]:
    """Return the free parameters with their covariance, shape (free, free), in their units, as quantities."""
    units = _units(problem.structure)
    if slides:
        units = {name: slide_unit(unit) for name, unit in units.items()}
    parameters = problem.parameters(minimum.point)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0))
    return {
        name: Quantity(parameters[name], float(std), units[name], "least squares of the decay")
        for name, std in zip(problem.names, deviation, strict=True)
    }


def table_values(structure: Structure) -> frozenset[str]:
    """Return the parameters that are values of a learned table: alone they mean nothing."""
    return frozenset(
        f"{part.name}.{name}"
        for part in structure.torques
        if part.smoothness
        for name in part.smoothness().names
    )


def _units(structure: Structure) -> dict[str, str]:
    """Return the units of the parameters that a fit may free."""
    linear = {"stiffness": "N*m/rad", "damping": "N*m*s/rad", "rest_angle": "rad"}
    return {
        **linear,
        **{f"{part.name}.{p.name}": p.unit for part in structure.parts for p in part.parameters},
    }


def parameter_covariance(problem: Problem, minimum: Minimum, residuals: Sequence[Array]) -> Array:
    """Return the covariance of the free parameters, with residuals that may be correlated.

    The sandwich H⁻¹ (Jᵀ R J) H⁻¹, where R is the covariance of the noise behind the residuals
    (`sysid.noise.autoregression`); for white noise R = σ² 1. A film states slow errors, which a fit takes for motion: the stated deviation is the least.

    Returns:
        Covariance, shape (free, free), in the parameters' units.
    """
    sensitivity = sensitivity_of(problem, minimum)
    noise = noise_behind(problem, minimum, residuals, sensitivity)
    shared, sizes = len(problem.names), problem.sizes()
    variance = problem.records[0].std ** 2

    root = sensitivity.root
    # In coordinates in which H is 1, so that rounding makes no variance negative.
    rows = [row @ root for row in sensitivity.rows]

    def sandwich(noises: Sequence[ResidualNoise]) -> Array:
        meat = sum(
            (row.T @ noise.applied(row) for row, noise in zip(rows, noises, strict=True)), np.zeros_like(root)
        )
        if problem.smoothing or problem.priors:
            # As if the prior's own residuals scattered as the sensor does.
            meat = meat + variance * (
                np.eye(len(root)) - sum((row.T @ row for row in rows), np.zeros_like(root))
            )
        else:
            meat = meat + variance * np.diag(sensitivity.lent)
        return root @ meat @ root.T

    covariance = sandwich([noise] * len(sensitivity.rows))
    if any(record.release.errors_last for record in problem.records):
        stated = sandwich([_stated_noise(record, problem) or noise for record in problem.records])
        covariance = max(covariance, stated, key=lambda matrix: float(np.trace(matrix)))
    return covariance * np.outer(sizes[:shared], sizes[:shared])


def _stated_noise(record: Record, problem: Problem) -> ResidualNoise | None:
    """Return the noise that a film states of itself, which lasts from frame to frame; None for a sensor."""
    release = record.release
    if not release.errors_last:
        return None
    std = float(np.median(own_std(release)))
    step = np.median(np.diff(record.time), keepdims=True)
    kept = kept_after(step, problem.scales.frequency)
    return ResidualNoise(std**2 * (1 - float(kept[0]) ** 2), kept)


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Sensitivity of the residuals to the free parameters, in units of their sizes, where each release's own unknowns follow them."""

    rows: tuple[Array, ...]
    """Of each record, shape (n, free); zero in columns of parameters at a bound."""
    own: tuple[Array, ...]
    """Orthonormal columns that span the record's own unknowns, shape (n, own)."""
    root: Array
    """A root of H⁻¹ = (JᵀJ + prior)⁻¹, which is root rootᵀ, shape (free, free); zero for parameters at a bound."""
    lent: Array
    """How much of H in each of root's columns no data fix, from 0 to 1, shape (free,)."""


def sensitivity_of(problem: Problem, minimum: Minimum) -> Sensitivity:
    """Return the Jacobian at a minimum and what its square makes of noise.

    Own unknowns of a release touch no other. So they are eliminated release by release, and memory grows with the samples alone.
    """
    shared, sizes = len(problem.names), problem.sizes()
    free = ~minimum.at_bound
    rows: list[Array] = []
    own: list[Array] = []
    squares = np.zeros(shared)
    for index, (_, jacobian) in enumerate(problem.linearise(minimum.point)):
        where, _ = problem.places[index]
        scaled = jacobian * (sizes * free)[where]
        slopes, mine = scaled[:, :shared], scaled[:, shared:]
        mine = mine @ _root(mine.T @ mine)[0]
        squares += np.sum(slopes**2, axis=0)
        rows.append(slopes - mine @ (mine.T @ slopes))
        own.append(mine)
    square = sum((row.T @ row for row in rows), np.zeros((shared, shared)))
    prior = problem.records[0].std ** 2 * problem.prior
    root, lent, moving = np.zeros_like(square), np.zeros(shared), free[:shared]
    block, diagonal = (square + prior)[np.ix_(moving, moving)], (squares + prior.diagonal())[moving]
    root[np.ix_(moving, moving)], lent[moving] = _root(block, diagonal)
    return Sensitivity(tuple(rows), tuple(own), root, lent)


def known_together(problem: Problem, minimum: Minimum) -> dict[str, tuple[float, float]]:
    """Return how well all releases fix each parameter, and how well the best of their poses alone, for white noise.

    Releases of one pose and load are those of which the same is known (`Release.known`).

    Returns:
        Standard deviations by name, in the parameters' units; none where there is only one pose.
    """
    poses = [tuple(sorted(record.release.known.items())) for record in problem.records]
    if len(set(poses)) < 2:
        return {}
    sensitivity = sensitivity_of(problem, minimum)
    rows, shared, sizes, noise = sensitivity.rows, len(problem.names), problem.sizes(), problem.records[0].std

    def spread(chosen: Sequence[int]) -> Array:
        square = sum((rows[i].T @ rows[i] for i in chosen), np.zeros_like(sensitivity.root))
        used = np.flatnonzero(np.diag(square) > 0)
        found = np.full(len(square), np.inf)
        found[used] = np.linalg.norm(_root(square[np.ix_(used, used)])[0], axis=1)
        return noise * found * sizes[:shared]

    each = [spread([i for i, pose in enumerate(poses) if pose == one]) for one in dict.fromkeys(poses)]
    whole, best = spread(range(len(poses))), np.min(each, axis=0)
    return {name: (float(whole[i]), float(best[i])) for i, name in enumerate(problem.names)}


def noise_behind(
    problem: Problem, minimum: Minimum, residuals: Sequence[Array], sensitivity: Sensitivity | None = None
) -> ResidualNoise:
    """Return the noise behind the residuals [rad or rad/s], shape (n,) each, of a minimum with this sensitivity."""
    sensitivity = sensitivity or sensitivity_of(problem, minimum)
    directions = [
        np.column_stack((row @ sensitivity.root, own))
        for row, own in zip(sensitivity.rows, sensitivity.own, strict=True)
    ]
    return residual_noise(residuals, directions, len(problem.names))


def _root(matrix: Array, sizes: Array | None = None) -> tuple[Array, Array]:
    """Return a root of the inverse of a matrix, and how much of each of its columns the matrix does not fix.

    Args:
        matrix: Shape (n, n).
        sizes: Diagonal of a matrix that rounding is small against, shape (n,); its own if left out.
    """
    diagonal = np.diag(matrix) if sizes is None else sizes
    scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-24 * max(float(diagonal.max(initial=0.0)), 1e-200)))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    # A direction that the data leave open keeps a huge variance instead of none.
    floored = np.maximum(values, 1e-13 * max(float(values[-1]), 1e-300 if sizes is None else 1.0))
    return scale[:, None] * vectors / np.sqrt(floored), 1.0 - np.maximum(values, 0.0) / floored


def correlation_of(covariance: Array) -> Array:
    """Return the dimensionless correlations of a covariance, shape (n, n) both."""
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return covariance / np.outer(deviation, deviation)


def identifiability_warnings(
    problem: Problem, minimum: Minimum, quantities: Mapping[str, Quantity], covariance: Array, own: Array
) -> list[str]:
    """Say what the data do not fix.

    Args:
        covariance: Of `quantities`, in their order, shape (free, free), in their units.
        own: The same for an inertia that is known: what all share by its uncertainty, no other release parts.
    """
    lines: list[str] = []
    values = table_values(problem.structure)
    for name, bound in zip(problem.names, minimum.at_bound, strict=False):
        if bound:
            lines.append(f"{name} = {quantities[name].value:.4g} {quantities[name].unit} is at its bound")
    correlation = correlation_of(own)
    names = list(problem.names)
    for i, j in itertools.combinations([i for i, n in enumerate(names) if n not in values], 2):
        if abs(correlation[i, j]) > 0.995:
            lines.append(
                f"{names[i]} and {names[j]} cannot be told apart by these releases (correlation "
                f"{correlation[i, j]:+.4f}): only their combination is fixed"
            )
    for name, quantity in quantities.items():
        if name in ("stiffness", "damping", "rest_angle", *values) or not np.isfinite(quantity.std):
            continue
        if quantity.std > abs(quantity.value) and quantity.value != 0:
            lines.append(f"{name} is not different from zero within its uncertainty ({quantity})")
    lines += [
        line
        for part in problem.structure.effects
        if not values and (line := identified_combination(part, quantities, covariance))
    ]
    return lines


def identified_combination(effect: str, quantities: Mapping[str, Quantity], covariance: Array) -> str:
    """Name the combination of an effect's parameters that the data fix better than each of them.

    In logarithms a product of powers is a direction, and the best known one is the covariance's narrowest.

    Args:
        covariance: Of `quantities`, in their order, shape (free, free), in their units.
    """
    names = list(quantities)
    own = [
        i for i, (name, q) in enumerate(quantities.items())
        if name.startswith(f"{effect}.") and q.value != 0 and 0 < q.std < np.inf
    ]  # fmt: skip
    values = np.array([quantities[names[i]].value for i in own])
    if len(own) < 2:
        return ""
    spread = covariance[np.ix_(own, own)] / np.outer(values, values)
    shares = np.sqrt(np.diag(spread))
    variances, directions = np.linalg.eigh(spread)
    best = float(np.sqrt(max(variances[0], 0.0)))
    if shares.max() < 0.3 or np.count_nonzero(shares > 0.04) < 2 or best > 0.25 * float(shares.max()):
        return ""
    powers = directions[:, 0] / directions[np.argmax(np.abs(directions[:, 0])), 0]
    best /= float(np.abs(directions[:, 0]).max())
    if np.count_nonzero(np.abs(powers) > 0.05) < 2:
        return ""
    product = " · ".join(
        names[i].split(".")[1] + ("" if abs(power - 1) < 0.005 else f"^{power:.2f}")
        for i, power in zip(own, powers, strict=True)
        if abs(power) > 0.05
    )
    each = ", ".join(f"{names[i].split('.')[1]} ± {196 * s:.0f} %" for i, s in zip(own, shares, strict=True))
    return f"{effect}: the releases fix {product} to ± {196 * best:.1f} %, but not its factors ({each})"
