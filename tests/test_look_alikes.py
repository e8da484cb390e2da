"""Truths that no free decay tells apart: the same roll, sample for sample."""

import numpy as np
import pytest

from sysid.joint import JointLaw, simulate
from sysid.record_check import stepped_logs
from sysid.workspace import Workspace

LAW = JointLaw(inertia=8.7e-3, stiffness=14.684, damping=0.2)
TIME = np.linspace(0.0, 1.0, 400)


def same(one, other, tolerance):
    assert np.abs(one.roll - other.roll).max() < tolerance


def test_offset_preload_and_sensor_bias_move_a_linear_decay_alike():
    shift = 0.02
    offset = simulate(LAW.with_effect("offset", shift), TIME, 0.15 + shift)
    preload = simulate(LAW.with_effect("preload", shift * LAW.stiffness), TIME, 0.15 + shift)
    bias = simulate(LAW.with_effect("sensor-bias", shift), TIME, 0.15)
    same(offset, preload, 1e-9)
    same(offset, bias, 1e-9)


@pytest.mark.parametrize("ratio", [0.7, 1.4])
def test_another_inertia_is_another_spring_and_damper(ratio):
    other = JointLaw(inertia=8.7e-3, stiffness=14.684 / ratio, damping=0.2 / ratio)
    same(simulate(LAW.with_effect("inertia", ratio), TIME, 0.15), simulate(other, TIME, 0.15), 1e-6)


def test_a_fast_clock_is_a_softer_board():
    other = JointLaw(inertia=8.7e-3, stiffness=14.684 / 1.1**2, damping=0.2 / 1.1)
    same(simulate(LAW.with_effect("clock", 1.1), TIME, 0.15), simulate(other, TIME, 0.15), 1e-7)


def test_gravity_is_a_stiffer_spring_for_small_tilts():
    other = JointLaw(inertia=8.7e-3, stiffness=14.684 + 1.0, damping=0.2)
    same(simulate(LAW.with_effect("gravity", 1.0), TIME, 0.15), simulate(other, TIME, 0.15), 2e-4)


def test_a_step_is_another_spring_and_damper_at_the_samples():
    pink = Workspace(__import__("pathlib").Path("/nonexistent")).load_board("pink")
    law, h = JointLaw.from_board(pink), 0.004
    grid = np.arange(0.0, 0.4, h)
    stepped = simulate(law.with_effect("discretisation", h), grid, 0.15)
    k, d = np.exp(stepped_logs(pink, h))
    # The semi-implicit rate is half a step late: the same poles, another start.
    other = JointLaw(inertia=law.inertia, stiffness=law.stiffness * k, damping=law.damping * d)
    basis = np.column_stack([simulate(other, grid, 0.1).roll, simulate(other, grid, 0.0, 1.0).roll])
    left = stepped.roll - basis @ np.linalg.lstsq(basis, stepped.roll, rcond=None)[0]
    assert np.abs(left).max() < 1e-6


def test_what_differs_is_not_called_the_same():
    """The comparison is not blind: a cubic spring cannot be undone by k and d."""
    cubic = simulate(LAW.with_effect("cubic-stiffness", 150.0), TIME, 0.15).roll
    best = min(
        float(
            np.abs(
                simulate(JointLaw(inertia=8.7e-3, stiffness=k, damping=0.2), TIME, 0.15).roll - cubic
            ).max()
        )
        for k in np.linspace(14.0, 19.0, 60)
    )
    assert best > 1e-3
