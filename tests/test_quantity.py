"""Quantities print to their own error and survive JSON."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sysid.quantity import Quantity, round_to_error


@pytest.mark.parametrize(
    ("value", "error", "expected"),
    [
        (14.68412, 0.0613, ("14.684", "0.061")),
        (0.4022, 0.0013, ("0.4022", "0.0013")),
        (41.08, 1.26, ("41.1", "1.3")),
        (8.7e-3, 5.7e-6, ("0.0087000", "0.0000057")),
        (1.23456e-5, 2.1e-7, ("1.235e-5", "0.021e-5")),
        (1234.5, 345.0, ("1234", "345")),
        (-3.14159, 0.02, ("-3.142", "0.020")),
    ],
)
def test_value_is_printed_to_two_digits_of_its_error(value, error, expected):
    assert round_to_error(value, error) == expected


@given(value=st.floats(-1e9, 1e9), relative=st.floats(1e-10, 1e3))
def test_rounding_loses_less_than_a_tenth_of_the_error(value, relative):
    error = relative * max(abs(value), 1e-9)
    text, error_text = round_to_error(value, error)
    assert abs(float(text) - value) <= 0.1 * error
    assert abs(float(error_text) - error) <= 0.1 * error


def test_interval_is_normal_unless_given():
    low, high = Quantity(1.0, 0.5, "rad").ci95
    assert (low, high) == pytest.approx((0.0200180, 1.9799820), abs=1e-6)
    assert Quantity(1.0, 0.5, "rad", interval=(0.2, 4.0)).ci95 == (0.2, 4.0)


def test_unknown_uncertainty_is_null_in_json_and_absent_in_print():
    quantity = Quantity(2.0, math.nan, "N*m/rad")
    assert json.loads(json.dumps(quantity.to_json(), allow_nan=False)) == {
        "value": 2.0,
        "std": None,
        "ci95": [None, None],
        "unit": "N*m/rad",
    }
    assert str(quantity) == "2 N·m/rad"


def test_print_names_the_unit_but_not_of_a_pure_number():
    assert str(Quantity(14.684, 0.0467, "N*m/rad")) == "14.684 ± 0.092 N·m/rad"
    assert str(Quantity(0.5627, 0.001, "1")) == "0.5627 ± 0.0020"
    assert str(Quantity(0.0087, 1e-4, "kg*m^2")) == "0.00870 ± 0.00020 kg·m²"
    assert str(Quantity(0.5e-4, 1.6e-4, "rad")) == "(0.5 ± 3.1)e-4 rad"
