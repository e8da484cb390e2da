"""Effects of the record that MuJoCo cannot represent are replaced by substitutes in the scene, or lack a part."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sim.board.bodies import as_represented, substituted
from sim.check.decays import smooth_power
from sim.check.rules._base import Case, Rule
from sysid.errors import SysidError
from sysid.fitting.initial_state import fit_initial_states
from sysid.fitting.records import Record
from sysid.joint import JointLaw


def _says(case: Case) -> Iterator[str]:
    yield from substituted(case.board)
    lacking = as_represented(case.board)
    if lacking != case.board:
        try:
            share = _error(case, JointLaw.from_board(lacking))
        except SysidError:  # an extremely stiff stop
            yield "the record's law without it, in continuous time, moves without bound from these logs' releases"
        else:
            yield f"the record's law without it, in continuous time, is {100 * share:.1f} % off these logs itself"


def _error(case: Case, law: JointLaw) -> float:
    """Return the NRMSE of a law with fitted starts against the decays, without noise [1]."""
    records: list[Record] = []
    for one in case.decays.releases:
        free = replace(one.release, roll=one.release.roll - one.zero, rest=one.release.rest - one.zero)
        time = free.time - free.time[0]
        records.append(Record(release=free, time=time, signal=free.roll, is_rate=False, std=one.rmse))
    residuals, _ = fit_initial_states(law, records)
    powers = [
        smooth_power(residual, float(np.median(np.diff(record.time))))
        for residual, record in zip(residuals, records, strict=True)
    ]
    mean = np.average([power for power, _ in powers], weights=list(map(len, residuals)))
    return float(np.sqrt(max(mean, 0.0))) / case.decays.motion


RULE = Rule(order=3, asked=("failed", "passed"), says=_says)
