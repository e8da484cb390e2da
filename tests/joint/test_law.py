"""The continuous law against closed forms and against an integrator that shares nothing with it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from sysid.errors import SysidError
from sysid.joint import JointLaw, simulate

LAW = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.402)
TIME = np.arange(0.0, 1.0, 1e-3)


@settings(max_examples=30, deadline=None)
@given(
    st.floats(1e-3, 1e-1),
    st.floats(2.0, 60.0),
    st.floats(0.01, 0.9),
    st.floats(-0.3, 0.3),
    st.floats(-3.0, 3.0),
)
def test_linear_law_is_the_closed_form(inertia, stiffness, zeta, angle, rate):
    omega = np.sqrt(stiffness / inertia)
    damped = omega * np.sqrt(1 - zeta**2)
    law = JointLaw(inertia=inertia, stiffness=stiffness, damping=2 * zeta * omega * inertia, rest_angle=0.02)
    time = np.linspace(0.0, 6 * 2 * np.pi / omega, 400)
    path = simulate(law, time, angle, rate)
    x0 = angle - 0.02
    exact = np.exp(-zeta * omega * time) * (
        x0 * np.cos(damped * time) + (rate + zeta * omega * x0) / damped * np.sin(damped * time)
    )
    assert np.abs(path.roll - 0.02 - exact).max() < 3e-6 * (abs(x0) + abs(rate) / omega) + 1e-15


def test_dry_friction_loses_exactly_4F_over_k_a_period_and_then_sticks():
    law = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.0).with_effect("coulomb", 0.1)
    time = np.arange(0.0, 4.0, 1e-3)
    path = simulate(law, time, 0.2)
    period = 2 * np.pi / law.frequency
    step = 4 * 0.1 / law.stiffness
    for number in (1, 3, 5):
        peak = simulate(law, np.array([0.0, number * period]), 0.2).roll[-1]
        assert peak == pytest.approx(0.2 - number * step, abs=1e-6)
    assert np.ptp(path.roll[-500:]) < 1e-15
    assert abs(path.roll[-1]) <= 0.1 / law.stiffness + 1e-9


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


def test_sensor_effects_change_the_reading_not_the_motion():
    plain = simulate(LAW, TIME, 0.2).roll
    assert simulate(LAW.with_effect("sensor-bias", 0.01), TIME, 0.2).roll == pytest.approx(plain + 0.01)
    assert simulate(LAW.with_effect("sensor-drift", 0.01), TIME, 0.2).roll == pytest.approx(
        plain + 0.01 * TIME
    )
    fast = simulate(LAW.with_effect("clock", 2.0), 2 * TIME, 0.2).roll
    assert fast == pytest.approx(plain, abs=1e-9)
    lag = simulate(LAW.with_effect("lowpass", 0.01), TIME, 0.2).roll
    slope = np.gradient(lag, TIME)
    assert (lag + 0.01 * slope)[5:-5] == pytest.approx(plain[5:-5], abs=5e-5)


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
