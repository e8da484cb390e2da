"""Whether a learned torque is better explained by a spring or a damper that changes with time.

Within a release the amplitude falls as time goes on, so a torque of tilt and rate can stand in for one of time, and the other
way round; releases from several angles tell them apart. A spring and a damper that follow cubics of the time since the
release are fitted in the tables' place: the better explanation, each number at BIC's price, is the likelier one.
"""

from collections.abc import Sequence

import numpy as np

from sysid.effects._algebra import Algebra, Value, Values
from sysid.effects._base import JointState, Parameter
from sysid.effects._unlisted import CLOCK, unlisted
from sysid.fitting.problem import Problem
from sysid.fitting.smoothing import ZERO_TABLE_WEIGHT, directions, fit_instead
from sysid.least_squares import Minimum

_NAMES = tuple(f"{what}_{power}" for what in ("stiffness", "damping") for power in (1, 2, 3))


def _torque(m: Algebra, motion: JointState, parameters: Values, states: Sequence[Value]) -> Value:
    time, swing = states[0] / parameters["duration"], (motion.tilt, motion.rate / parameters["frequency"])
    return -sum(parameters[name] * swing[i // 3] * time ** (i % 3 + 1) for i, name in enumerate(_NAMES))


_EFFECT = unlisted(
    "changing",
    _torque,
    (
        *(Parameter(name=n, unit="N*m/rad", size=lambda s: 0.3 * s.stiffness, low=-10.0, high=10.0) for n in _NAMES),
        Parameter(name="duration", unit="s", size=lambda s: s.duration, low=0.0, high=2.0),
        Parameter(name="frequency", unit="rad/s", size=lambda s: s.frequency, low=0.0, high=2.0),
    ),
    (CLOCK,),
)  # fmt: skip


def changes_with_time(problem: Problem, minimum: Minimum) -> bool:
    """Return whether a joint that changes during each of several releases explains them better than a problem's tables."""
    if len(problem.records) < 2 or all(weight == ZERO_TABLE_WEIGHT for weight in problem.smoothing):
        return False
    held = {"changing.duration": problem.scales.duration, "changing.frequency": problem.scales.frequency}
    rival, other = fit_instead(problem, minimum.point, _EFFECT, problem.parameters(minimum.point), held)
    samples = problem.samples
    tables, changing = (
        samples * np.log(sum(float(np.sum((r / record.std) ** 2)) for r, record in zip(p.residuals(found.point), p.records, strict=True)))
        + directions(p, found) * np.log(samples)
        for p, found in ((problem, minimum), (rival, other))
    )  # fmt: skip
    return bool(changing < tables)
