"""Units are what their definitions say, whatever they are called."""

from math import pi

import pytest

from sysid.logs.table import names

STANDARD_GRAVITY = 9.80665
"""Third General Conference on Weights and Measures, 1901 [m/s²]."""


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("rad", 1.0), ("mrad", 0.001), ("deg", pi / 180), ("°", pi / 180), ("turn", 2 * pi), ("rev", 2 * pi),
        ("rad/s", 1.0), ("mrad/s", 0.001), ("deg/s", pi / 180), ("dps", pi / 180), ("mdeg/s", pi / 180 / 1000),
        ("mdps", pi / 180 / 1000), ("rpm", 2 * pi / 60), ("m/s^2", 1.0), ("m/s²", 1.0), ("g", STANDARD_GRAVITY),
        ("mg", STANDARD_GRAVITY / 1000), ("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9), ("min", 60.0),
    ],
)  # fmt: skip
def test_size_of_a_unit(text, size):
    tables = (names.ANGLE_UNITS, names.RATE_UNITS, names.ACCEL_UNITS, names.TIME_UNITS)
    unit = names.parse_unit(text)
    (found,) = (table[unit] for table in tables if unit in table)
    assert found == pytest.approx(size, rel=1e-12)
