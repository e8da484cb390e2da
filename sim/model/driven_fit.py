"""All driven joints of a model fitted together, each beside the simulated motion of the others."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from sim.model.coupled import ZERO, Beside, posed_beside, widenings
from sim.model.driven import Stated
from sim.model.setup import Setup
from sysid.driven.fit import FINER, DrivenFit, fit, free_of
from sysid.driven.joint import Simulator
from sysid.driven.log import DrivenLog
from sysid.driven.problem import Problem

PASSES = 6
"""Fits of each joint beside the motion of the others: encoder zeros of two joints keep a fifth of their error each time."""

Fits = dict[str, list[DrivenFit]]
"""Fits of each joint, one for each log."""


def fit_joints(
    setup: Setup, logs: Mapping[str, Sequence[DrivenLog]], stated: Mapping[str, Stated], effects: Sequence[str], *,
    fixed: Mapping[str, float] | None = None, bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Fits:  # fmt: skip
    """Fit the joints of a model to logs.

    Args:
        logs: By joint, in the same order for each.
        fixed: Parameters that are held, in SI.
        bounds: Ends of parameters, in SI; those are fitted too.

    Raises:
        SysidError: An effect or a parameter is unknown, or the motion runs away.
    """
    fixed, bounds = fixed or {}, bounds or {}
    fits: Fits = {}
    coupled = len(logs) > 1 or ZERO in bounds
    for joint, own in logs.items():
        known = stated[joint]
        structure = replace(known.structure, effects=tuple(sorted({*known.structure.effects, *effects})))
        free = free_of(structure, structure.effects, fixed, more=tuple(bounds))
        given = {**known.values, **fixed}
        posed = (Problem(log=log, structure=structure, values=given, free=free, bounds=bounds) for log in own)
        law = None if coupled else known.simulator
        fits[joint] = [fit(one, quick=coupled, simulator=law) for one in posed]
    for number in range(len(next(iter(logs.values())))) if coupled else ():
        alone = {joint: own[number] for joint, own in fits.items()}
        simulators = {joint: one.simulator for joint, one in stated.items()}
        for joint, one in _together(setup, alone, simulators).items():
            fits[joint][number] = one
    return fits


def _together(
    setup: Setup, fits: Mapping[str, DrivenFit], simulators: Mapping[str, Simulator]
) -> dict[str, DrivenFit]:
    """Return the fits of the joints to one log, each beside the motions that the fits of the others have."""
    joints = {name: Beside(fit=one, simulator=simulators[name]) for name, one in fits.items()}
    for number in range(PASSES):
        first, last = number == 0, number == PASSES - 1
        for name, one in joints.items():
            problem, simulator = posed_beside(setup, joints, name, 1 if first else FINER)
            if first or last:
                found = fit(problem, begins=[problem.values], quick=first, simulator=simulator)
            else:
                found = one.fit.continued(problem)
            joints[name] = replace(one, fit=found)
    if len(joints) == 1:
        return {name: one.fit for name, one in joints.items()}
    factors = widenings(setup, joints)
    return {
        name: one.fit.widened(factor[: len(one.fit.quantities)])
        for (name, one), factor in zip(joints.items(), factors, strict=True)
    }
