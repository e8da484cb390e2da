"""Profile likelihood: the cost along one parameter while all others are refitted.

The interval from the Jacobian takes the cost for a parabola. A friction near zero, a stop that is hardly touched or a pair of correlated
parameters have another cost. The profile shows it: the parameter is held beside its best value, all others are fitted again, and the rise
of the cost is read.

Correlated residuals make the plain interval too narrow. The rise is divided by the factor by which correlation widens the variance of
this parameter (Chandler and Bate, Biometrika 2007). Of a parabola both intervals are then the same.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from sysid.board import Board
from sysid.fitting.covariance import common_covariance, parameter_covariance
from sysid.fitting.result import JointFit
from sysid.least_squares import Minimum, Normal, minimise
from sysid.progress import steps
from sysid.quantity import Z95
from sysid.roll import Array

_CLOSE = 0.005
"""How closely an end of the interval is found, as a share of its half-width [1]."""
_FARTHEST = 40.0
"""Of the Jacobian's deviations: beyond, the data leave the parameter open."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """The cost along one parameter, in its unit."""

    name: str = ""
    best: float
    """Value with the lowest cost of all points."""
    values: Array
    """Values of the points, ascending, shape (n,)."""
    rise: Array
    """Rise of the adjusted deviance there; 3.84 ends the 95 % interval; shape (n,)."""
    interval: tuple[float, float]
    """95 %; ±inf where the data leave it open."""
    at_bound: tuple[bool, bool]
    """Whether an end is the unknown's own bound (a friction is not negative) and not the data's."""
    deeper: float
    """By how much the deviance fell below the fit's own minimum; 0 where the fit was right."""

    def to_json(self) -> dict[str, object]:
        """Return the profile for machines."""
        low, high = (float(end) if np.isfinite(end) else None for end in self.interval)
        return {
            "ci95": [low, high], "at_bound": list(self.at_bound), "values": self.values.tolist(),
            "rise": self.rise.tolist(),
        }  # fmt: skip


def profiles(fit: JointFit, board: Board) -> Iterator[Profile]:
    """Profile each free parameter of a fit, one after another, what all releases share (inertia, scale of the sensor) added in quadrature."""
    problem, minimum = fit.problem, fit.minimum
    low, high = problem.bounds()
    own = parameter_covariance(problem, minimum, fit.residuals)
    common = common_covariance(problem, minimum, board)
    sizes = problem.sizes()
    for index, name in steps(list(enumerate(problem.names))):
        if minimum.at_bound[index]:
            continue
        size = float(sizes[index])
        deviation = float(np.sqrt(own[index, index])) / size
        shape = profile(problem.normal, minimum, low, high, index, deviation)
        best = float(minimum.point[index])
        beyond = Z95 * float(np.sqrt(common[index, index])) / size
        below, above = (float(np.hypot(end - best, beyond)) for end in shape.interval)
        ends = size * (best - below), size * (best + above)
        yield replace(shape, name=name, best=size * shape.best, values=size * shape.values, interval=ends)


def profile(
    normal: Callable[[Array], Normal], minimum: Minimum, low: Array, high: Array, index: int, deviation: float
) -> Profile:
    """Walk away from a minimum to both sides along one unknown.

    Args:
        low: Lower bounds in units of the unknowns' sizes, shape (p,).
        high: Upper bounds, likewise, shape (p,).
        deviation: Its standard deviation in units of its size, correlation of the residuals included.
    """
    free = np.flatnonzero(~minimum.at_bound)
    inverse = np.linalg.pinv(minimum.normal.hessian[np.ix_(free, free)], rcond=1e-13, hermitian=True)
    plain = float(inverse.diagonal()[np.searchsorted(free, index)])
    adjustment = deviation**2 / plain if plain > 0 else 1.0

    def rise(value: float, near: Minimum) -> tuple[float, Minimum]:
        found = _refit(normal, near, low, high, index, value)
        return 2 * (found.normal.cost - minimum.normal.cost) / adjustment, found

    here = float(minimum.point[index])
    below, above = (
        _walk(rise, minimum, here, float(bound), sign * deviation)
        for sign, bound in ((-1.0, low[index]), (1.0, high[index]))
    )
    points = sorted([*below[0], (here, 0.0), *above[0]])
    values, rises = (np.array(column) for column in zip(*points, strict=True))
    return Profile(
        best=float(values[np.argmin(rises)]), values=values, rise=rises, interval=(below[1], above[1]),
        at_bound=(below[2], above[2]), deeper=float(max(0.0, -rises.min())),
    )  # fmt: skip


def _walk(
    rise: Callable[[float, Minimum], tuple[float, Minimum]],
    minimum: Minimum,
    best: float,
    bound: float,
    step: float,
) -> tuple[list[tuple[float, float]], float, bool]:
    """Find where the deviance has risen to 1.96² on one side, and look at some points more for the picture.

    Returns:
        Values and deviances of the points, the end of the interval, and whether it is the bound.
    """
    from scipy.optimize import brentq

    limit = float(np.clip(bound, best - _FARTHEST * abs(step), best + _FARTHEST * abs(step)))
    most = (limit - best) / step if step else 0.0
    seen: dict[float, tuple[float, Minimum]] = {0.0: (0.0, minimum)}

    def height(deviations: float) -> float:
        """Root of the deviance, less 1.96: nearly a straight line."""
        if deviations not in seen:
            near = min(seen, key=lambda other: abs(other - deviations))
            deviance, found = rise(best + deviations * step, seen[near][1])
            if not np.isfinite(deviance):  # a joint that runs away
                return 1e3
            seen[deviations] = deviance, found
        return float(np.sqrt(max(seen[deviations][0], 0.0))) - Z95

    inside, outside = 0.0, min(Z95, most)
    while (rest := height(outside)) < 0 and outside < most:
        growth = Z95 / max(rest + Z95, 1e-3)
        inside, outside = outside, min(outside * float(np.clip(growth, 1.05, 3.0)), most)
    open_ended = rest < 0
    end: float = most if open_ended else brentq(height, inside, outside, xtol=_CLOSE * Z95)  # pyright: ignore[reportAssignmentType]
    for quarter in (1, 2, 3, 5):  # for the picture
        if end and quarter * end / 4 <= most:
            height(quarter * end / 4)
    points = [(best + where * step, deviance) for where, (deviance, _) in seen.items() if where]
    if not open_ended:
        return points, best + end * step, False
    return points, bound if limit == bound else float(np.copysign(np.inf, step)), limit == bound


def _refit(
    normal: Callable[[Array], Normal], last: Minimum, low: Array, high: Array, index: int, value: float
) -> Minimum:
    """Fit all unknowns but one, from where they were, moved along with it."""
    others = np.arange(len(low)) != index
    hessian = last.normal.hessian
    start = last.point.copy()
    free = others & ~last.at_bound
    pull = hessian[np.ix_(free, [index])][:, 0] * (value - start[index])
    start[free] -= np.linalg.lstsq(hessian[np.ix_(free, free)], pull, rcond=1e-10)[0]
    start[index] = value
    pinned_low, pinned_high = low.copy(), high.copy()
    pinned_low[index] = pinned_high[index] = value
    moved = minimise(normal, start, pinned_low, pinned_high, iterations=40, tolerance=1e-6)
    if np.isfinite(moved.normal.cost):
        return moved
    plain = last.point.copy()
    plain[index] = value
    return minimise(normal, plain, pinned_low, pinned_high, iterations=40, tolerance=1e-6)
