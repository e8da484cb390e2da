"""A log in the wrong unit must not pass for a board that swings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid.decay.numbers import decay_numbers
from sysid.decay.plausibility import amplitude_warnings, period_warnings, record_warnings, refuse_period
from sysid.errors import SysidError
from sysid.quantity import Quantity
from sysid.roll import Release
from sysid.workspace import Workspace


def release(amplitude):
    time = np.linspace(0, 1, 50)
    return Release(
        log="log.csv", number=1, time=time, roll=amplitude * np.exp(-time), std=0 * time + 1e-3, origin="angle",
        rest=0.0, hold=1.0, end="rest",
    )  # fmt: skip


@pytest.fixture
def board():
    return Workspace(Path()).load_board("pink")


def test_degrees_taken_for_radians_are_refused(board):
    with pytest.raises(SysidError, match=r"log\.csv: .* 10 rad from rest.*--unit deg"):
        amplitude_warnings([release(0.1), release(-10.0)], board)


@pytest.mark.parametrize(("amplitude", "word"), [(0.5, "allows ±0.2 rad"), (0.003, "only")])
def test_odd_amplitudes_are_named(board, amplitude, word):
    (warning,) = amplitude_warnings([release(amplitude)], board)
    assert word in warning


def wide(inertia, period, board):
    """A board with another roll inertia, and the natural frequency of a period."""
    return 2 * np.pi / period, replace(board, inertia=Quantity(inertia, 0.0, "kg*m^2"))


@pytest.mark.parametrize(
    ("inertia", "period"),
    [(8.7e-3, 0.153), (7.15e-3, 0.09), (0.17, 2.08), (6.71e-3, 0.76), (0.0527, 0.42), (135, 2.54), (2e11, 21.0), (8.7e-3, 2.08)],
)  # fmt: skip
def test_real_periods_are_not_doubted(board, inertia, period):
    """Boards, a ball on a string, a servo with a weight, a wheel on a rod, a ship's model and the ship."""
    omega, thing = wide(inertia, period, board)
    assert period_warnings(omega, thing, log="log.csv") == []
    refuse_period(omega, thing, log="log.csv")


@pytest.mark.parametrize(("period", "refused"), [(153.0, True), (40.0, False), (1.5e-4, True)])
def test_times_in_another_unit_are_doubted_and_the_impossible_refused(board, period, refused):
    omega, thing = wide(8.7e-3, period, board)
    (warning,) = period_warnings(omega, thing, log="log.csv")
    assert f"natural period is {period:.4g} s" in warning
    assert "--rate" in warning
    if refused:
        with pytest.raises(SysidError, match=r"the record is unchanged.*--rate.*--any-period"):
            refuse_period(omega, thing, log="log.csv")
    else:
        refuse_period(omega, thing, log="log.csv")


def numbers(omega, zeta):
    covariance = np.diag([(0.01 * omega) ** 2, 0.005**2])
    return decay_numbers(omega, zeta, covariance, Quantity(8.7e-3, 0.0, "kg*m^2"))


def test_what_lies_outside_the_record_is_said_with_its_likely_cause(board):
    omega, zeta = 41.083, 0.56265
    assert record_warnings(numbers(1.01 * omega, zeta), board, log="x", linear=True) == []
    (slow,) = record_warnings(numbers(omega / 4, zeta), board, log="x", linear=True)
    assert "the period is 4 times the record's" in slow
    assert "--rate" in slow
    (stiff,) = record_warnings(numbers(1.4 * omega, 0.3), board, log="x", linear=True)
    assert "k = " in stiff
    assert "is it this board" in stiff
    assert "dry friction" not in stiff
    (stuck,) = record_warnings(numbers(1.4 * omega, 0.8), board, log="x", linear=True, one_sided=True)
    assert "release to the other side" in stuck
    (wrong,) = record_warnings(numbers(1.4 * omega, 0.8), board, log="x", linear=False)
    assert "wrong model" in wrong
