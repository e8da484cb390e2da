"""Joints of one model that are fitted together."""

import pytest
from driven_coverage import run


@pytest.mark.slow
def test_a_double_pendulum_of_mujoco_gives_its_parameters_back():
    row = run("double", 1)  # Euler at 2 ms, MuJoCo's own friction
    assert row["simulator"] == [True, True]
    assert row["error"] < 1.02  # times the noise of the encoders
    for name in ("armature", "damping", "friction", "bias", "delay"):
        assert max(map(abs, row[name])) < 3.5, name  # deviations
