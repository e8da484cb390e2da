"""A log in the wrong unit must not pass for a board that swings."""

from dataclasses import replace

import numpy as np
import pytest
from made import release

from sysid.decay.numbers import decay_numbers
from sysid.decay.plausibility import amplitude_warnings, period_warnings, record_warnings, refuse_period
from sysid.errors import SysidError
from sysid.quantity import Quantity


def falling(amplitude):
    time = np.linspace(0, 1, 50)
    return release(time, amplitude * np.exp(-time), 1e-3, log="log.csv", end="rest")


def test_degrees_taken_for_radians_are_refused(pink):
    with pytest.raises(SysidError, match=r"log\.csv: .* 10 rad from rest.*--unit deg"):
        amplitude_warnings([falling(0.1), falling(-10.0)], pink)


@pytest.mark.parametrize(("amplitude", "word"), [(0.5, "allows ±0.2 rad"), (0.003, "only")])
def test_odd_amplitudes_are_named(pink, amplitude, word):
    (warning,) = amplitude_warnings([falling(amplitude)], pink)
    assert word in warning


def wide(inertia, period, pink):
    """A board with another roll inertia, and the natural frequency of a period."""
    return 2 * np.pi / period, replace(pink, inertia=Quantity(inertia, 0.0, "kg*m^2"))


@pytest.mark.parametrize(
    ("inertia", "period"),
    [(8.7e-3, 0.153), (7.15e-3, 0.09), (0.17, 2.08), (6.71e-3, 0.76), (0.0527, 0.42), (135, 2.54), (2e11, 21.0), (8.7e-3, 2.08)],
)  # fmt: skip
def test_real_periods_are_not_doubted(pink, inertia, period):
    """Boards, a ball on a string, a servo with a weight, a wheel on a rod, a ship's model and the ship."""
    omega, thing = wide(inertia, period, pink)
    assert period_warnings(omega, thing, log="log.csv") == []
    refuse_period(omega, thing, log="log.csv")


@pytest.mark.parametrize("period", [153.0, 1.5e-4])
def test_times_in_another_unit_are_doubted_and_refused(pink, period):
    omega, thing = wide(8.7e-3, period, pink)
    (warning,) = period_warnings(omega, thing, log="log.csv")
    assert f"natural period is {period:.4g} s" in warning
    assert "--rate" in warning
    with pytest.raises(SysidError, match=r"--rate.*The record is unchanged.*--any-period"):
        refuse_period(omega, thing, log="log.csv")


def numbers(omega, zeta):
    covariance = np.diag([(0.01 * omega) ** 2, 0.005**2])
    return decay_numbers(omega, zeta, covariance, Quantity(8.7e-3, 0.0, "kg*m^2"))


def test_what_lies_outside_the_record_is_said_with_its_likely_cause(pink):
    omega, zeta = 41.083, 0.56265
    assert record_warnings(numbers(1.01 * omega, zeta), pink, log="x", linear=True) == []
    (slow,) = record_warnings(numbers(omega / 4, zeta), pink, log="x", linear=True)
    assert "the period is 4 times the record's" in slow
    assert "--rate" in slow
    (stiff,) = record_warnings(numbers(1.4 * omega, 0.3), pink, log="x", linear=True)
    assert "k = " in stiff
    assert "is it this board" in stiff
    assert "dry friction" not in stiff
    (stuck,) = record_warnings(numbers(1.4 * omega, 0.8), pink, log="x", linear=True, one_sided=True)
    assert "release to the other side" in stuck
    (wrong,) = record_warnings(numbers(1.4 * omega, 0.8), pink, log="x", linear=False)
    assert "wrong model" in wrong
