"""The continuous law against closed forms and against an integrator that shares nothing with it."""

import numpy as np
import pytest
from scipy.linalg import expm

from sysid.errors import SysidError
from sysid.joint import JointLaw, simulate

LAW = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.402)
TIME = np.arange(0.0, 1.0, 1e-3)


@pytest.mark.parametrize(
    ("hold", "left"), [(0.0, 1.0), (0.1 * np.log(2), 0.5), (0.1, np.exp(-1)), (1.0, np.exp(-10))]
)
def test_rubber_creeps_while_it_is_held(hold, left):
    """A hold of T ln 2 leaves half of the arm's stretch; from there it is a linear system."""
    k, d, inertia, arm, constant, angle = 14.684, 0.05, 8.7e-3, 5.0, 0.1, 0.2
    law = JointLaw(inertia=inertia, stiffness=k, damping=d).with_effect("viscoelastic", arm, constant)
    system = np.array([[0, 1, 0], [-k / inertia, -d / inertia, -arm / inertia], [0, 1, -1 / constant]])
    time = np.linspace(0.0, 0.5, 40)
    exact = [(expm(system * t) @ [angle, 0.0, left * angle])[0] for t in time]
    assert simulate(law, time, angle, hold=hold).roll == pytest.approx(exact, abs=1e-6)


def test_an_implicitfast_step_loses_the_damping_that_it_is_known_to_lose():
    """On the stiff board 5 ms cost 8.3 % of the damping ratio: the poles of the step's map say so."""
    law = JointLaw(inertia=7.15e-3, stiffness=34.85, damping=0.54).with_effect("discretisation", 0.005)
    time = np.arange(0.0, 0.4, 0.005)
    roll = simulate(law, time, 0.2).roll
    # Two samples of a linear map of order two fix its poles.
    a, b = np.linalg.lstsq(np.column_stack([roll[1:-1], roll[:-2]]), roll[2:], rcond=None)[0]
    pole = np.log(np.roots([1.0, -a, -b])[0]) / 0.005
    zeta = -pole.real / abs(pole)
    exact = 0.54 / 2 / np.sqrt(34.85 * 7.15e-3)
    assert zeta / exact - 1 == pytest.approx(-0.0831, abs=0.001)


def test_a_law_without_a_stable_rest_says_so():
    law = LAW.with_effect("cubic-stiffness", -2000.0)
    with pytest.raises(SysidError, match="grows without bound"):
        simulate(law, TIME, 0.3)
