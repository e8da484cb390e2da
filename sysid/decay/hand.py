"""A hand that stops a joint whose swing is hardly larger than the noise.

A free joint keeps its amplitude and phase. A hand changes both at one time, by any amount: two more columns of the fit, from that time on.
The time of the largest likelihood ratio counts (Willsky and Jones, 1976). Its cost covers noise alone at any time of the decay.
Another law of the joint also changes amplitude and phase, so it must be less likely. Dry friction may stop a joint like a hand; it must be
smaller than the swing that the hand stops.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from sysid.decay.doubt import TORQUES, second_laws, wander
from sysid.decay.linear_fit import FittedTrace, TraceFit, columns_of, project
from sysid.noise.whiteness import lag_one
from sysid.quantity import SURE, Z95
from sysid.releases.find import FEWEST_SAMPLES
from sysid.roll import Array, Release


def without_hand(
    releases: Sequence[Release], fit: TraceFit, refit: Callable[[Sequence[Release]], TraceFit]
) -> tuple[Sequence[Release], TraceFit]:
    """Return the releases up to the hand that stops them, and their fit.

    Args:
        releases: Free decays.
        fit: Of the releases.
        refit: Fits releases.
    """
    laws = {law.name: law for law in second_laws(fit)}
    while True:
        changes = [_change(one, fit) for one in fit.releases]
        evidence = sum(max(gain, 0.0) for _, gain, _ in changes)
        rival = max([SURE, *(laws[name].share / laws[name].std for name in TORQUES)]) ** 2 - SURE**2
        if not evidence > rival:
            return releases, fit
        cut = [
            replace(release[release.time < time], end="caught") if gain > 0 else release
            for release, (time, gain, _) in zip(releases, changes, strict=True)
        ]
        free = refit(cut)
        laws = {law.name: law for law in second_laws(free)}
        widest = max(float(np.abs(one.modelled - one.level).max()) for one in free.releases)
        smallest = min(size for _, gain, size in changes if gain > 0)
        if (laws["dry friction"].share + Z95 * laws["dry friction"].std) * widest > smallest:
            return releases, fit  # friction may have stopped it
        releases, fit = cut, free


def _change(one: FittedTrace, fit: TraceFit) -> tuple[float, float, float]:
    """Return when a release changes [s], twice the log-likelihood ratio less its cost, and the widest swing predicted from then on.

    A change before half of the motion counts 0: it may be a hand at the beginning, or another law.
    """
    columns = one.trace.whiten(columns_of(one.trace, fit.poles, one.swing, fit.signal)[1])
    _, residual, jacobian, *_ = project(one.trace, fit.poles, one.swing, fit.signal)
    moves = columns[:, :2] / (np.linalg.norm(columns[:, :2], axis=0) + 1e-300)
    others = np.column_stack([columns, jacobian])
    orthogonal, _ = np.linalg.qr(others / (np.linalg.norm(others, axis=0) + 1e-300))
    residual = residual - orthogonal @ (orthogonal.T @ residual)  # other releases decide on the poles too

    def from_each_on(values: Array) -> Array:
        return np.cumsum(values[::-1], axis=0)[::-1]

    size = np.sqrt(from_each_on(moves**2)) + 1e-100  # its square is not zero yet
    shared = from_each_on(orthogonal[:, :, None] * moves[:, None, :])
    own = from_each_on(moves[:, :, None] * moves[:, None, :]) - np.swapaxes(shared, 1, 2) @ shared
    own = own / (size[:, :, None] * size[:, None, :]) + 1e-9 * np.eye(2)
    each = from_each_on(moves * residual[:, None]) / size
    change = np.linalg.solve(own, each[:, :, None])[:, :, 0]
    gains = np.einsum("ij,ij->i", each, change)
    gains[:FEWEST_SAMPLES] = gains[-FEWEST_SAMPLES:] = 0.0
    at = int(np.argmax(gains))
    after = np.where((np.arange(len(residual)) < at)[:, None], 0.0, moves)
    after -= orthogonal @ (orthogonal.T @ after)
    rest = residual - after @ (change[at] / size[at])
    rho = lag_one([rest])
    white = float(rest @ rest) / max(len(rest) - others.shape[1] - 3, 1) * (1 + rho) / (1 - rho)
    later = from_each_on(after)
    walk = wander(fit) * (later.T * np.gradient(one.trace.time)) @ later
    seen = after.T @ residual
    gain = float(seen @ np.linalg.lstsq(white * after.T @ after + walk, seen)[0])
    motion = one.modelled - one.level
    if np.sum(motion[:at] ** 2) < np.sum(motion[at:] ** 2):
        return math.inf, 0.0, 0.0
    gain -= SURE**2 + 2 * math.log(len(rest))
    return float(one.trace.time[at]), gain, float(np.abs(motion[at:]).max())
