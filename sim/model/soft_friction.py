"""MuJoCo's soft dry friction in a log: a log simulated with the default `solreffriction` creeps where a real joint sticks."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from sysid.joint.law import JointLaw
from sysid.joint.sampled import stepper
from sysid.quantity import slide_unit
from sysid.roll import Array, Release
from sysid.text import display

STEP = 5e-4
"""Time step of the comparison [s]: a fortieth of the default time constant of friction, 20 ms."""


def fit_soft(law: JointLaw, free: Sequence[str], releases: Sequence[Release]) -> tuple[JointLaw, float]:
    """Fit a law whose dry friction yields as MuJoCo's default frictionloss does.

    Args:
        law: The law with hard friction; the fit starts there.
        releases: Measured decays; angle and rate at their starts, and their zeros, are fitted too.

    Returns:
        The law, and its RMS error [rad or m].
    """
    from scipy.optimize import least_squares

    names = law.structure.parameters
    where = [names.index(name) for name in free]
    times = [release.time - release.time[0] for release in releases]
    moves = [stepper(law.structure, STEP, float(time[-1])) for time in times]
    sizes = np.array([max(abs(law.vector[i]), 1e-6) for i in where])

    def law_at(unknown: Array) -> Array:
        vector = law.vector.copy()
        vector[where] = sizes * unknown[: len(where)]
        return vector

    def misfit(unknown: Array) -> Array:
        vector, starts = law_at(unknown), unknown[len(where) :].reshape(-1, 3)
        errors: list[Array] = []
        for move, time, (angle, rate, zero), one in zip(moves, times, starts, releases, strict=True):
            grid, roll, _ = move(vector, angle, rate)
            errors.append(zero + np.interp(time, grid, roll) - one.roll)
        return np.concatenate(errors)

    guess = [*(law.vector[where] / sizes), *(value for one in releases for value in (one.roll[0], 0.0, 0.0))]
    found = least_squares(misfit, guess, x_scale="jac", diff_step=1e-5, max_nfev=20)
    return JointLaw.from_vector(law.structure, law_at(found.x)), float(np.sqrt(np.mean(found.fun**2)))


def soft_friction_warning(fit: Any, *, slides: bool) -> list[str]:
    """Return a warning where soft friction explains most of the error that a fit leaves above the noise."""
    law, noise = fit.law, fit.noise
    if (
        not any(part.friction for part in law.structure.torques)
        or law.structure.states
        or fit.records[0].is_rate
    ):
        return []
    if noise.excess(fit.rmse)[0] <= 0:
        return []
    soft, error = fit_soft(law, list(fit.quantities), [record.release for record in fit.records])
    if fit.rmse**2 - error**2 < (fit.rmse**2 - noise.std**2) / 2:
        return []
    show = display(is_rate=False, slides=slides)
    numbers = ", ".join(
        f"{name} {soft.parameters[name]:.4g} {slide_unit(q.unit) if slides else q.unit}"
        for name, q in fit.quantities.items()
    )
    return [
        f"the log moves as MuJoCo's default frictionloss does, which yields (error {show(error)} instead of {show(fit.rmse)}): was it "
        f"simulated? With that soft friction the numbers are: {numbers}. The hard law of a real joint is not this log's"
    ]
