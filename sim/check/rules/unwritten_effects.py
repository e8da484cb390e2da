"""Effects of the record that MuJoCo cannot hold stand in the scene as their substitutes, or lack a part."""

from collections.abc import Iterator

import numpy as np

from sim.board.bodies import as_represented, substituted
from sim.check.decays import smooth_power
from sim.check.rules._base import Case, Rule
from sysid.joint import JointLaw, simulate


def _says(case: Case) -> Iterator[str]:
    yield from substituted(case.board)
    lacking = as_represented(case.board)
    if lacking != case.board:
        share = _error(case, JointLaw.from_board(lacking))
        yield f"the record's law without it, in continuous time, is {100 * share:.1f} % off these logs itself"


def _error(case: Case, law: JointLaw) -> float:
    """Return the NRMSE of a law against the decays, its starts fitted, without the sensor's noise."""
    from scipy.optimize import least_squares

    powers: list[float] = []
    for one in case.decays.releases:
        time, roll = one.time - one.time[0], one.measured - one.zero
        found = least_squares(
            lambda start, one=one, time=time, roll=roll: (
                simulate(law, time, *start, begin=float(one.time[0])).roll - roll
            ),
            one.start,
            x_scale=[abs(one.start[0]) + 1e-3, law.frequency * abs(one.start[0]) + 1e-3],
            diff_step=1e-5,
            max_nfev=12,
        )
        power, _ = smooth_power(found.fun, float(np.median(np.diff(time))))
        powers.append(power)
    mean = np.average(powers, weights=[len(one.time) for one in case.decays.releases])
    return float(np.sqrt(max(mean, 0.0))) / case.decays.motion


RULE = Rule(order=3, asked=("failed", "passed"), says=_says)
