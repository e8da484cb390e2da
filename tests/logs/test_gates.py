"""Light gates: period and decrement of a pendulum from the times at which it passes."""

import numpy as np
import pytest
from rocking import rocking, write_csv

from sysid.errors import SysidError
from sysid.logs import read_roll
from sysid.logs.formats.registry import open_log
from sysid.logs.gates import passes_of

OMEGA, ZETA, WIDTH = 5.0, 0.004, 0.01
PERIOD = 2 * np.pi / (OMEGA * np.sqrt(1 - ZETA**2))
DECREMENT = 2 * np.pi * ZETA / np.sqrt(1 - ZETA**2)


def crossings(at):
    """Times at which the swing passes an angle."""
    time = np.arange(0, 30, 1e-4)
    roll = rocking(time, omega=OMEGA, zeta=ZETA, rest=0.0, release=0.0)[0]
    rows = np.flatnonzero(np.diff(np.sign(roll - at)) != 0)
    times = time[rows] + 1e-4 * (at - roll[rows]) / (roll[rows + 1] - roll[rows])
    return times + np.random.default_rng(7 if at < 0 else 8).normal(0, 2e-5, len(times))


def within(quantity, truth):
    low, high = quantity.ci95
    assert abs(quantity.value - truth) < high - low  # twice the interval
    assert high - low < 0.1 * truth


def test_one_gate_gives_the_period(tmp_path):
    path = write_csv(tmp_path / "log.csv", ("gate_time_s",), crossings(0.004))
    passes = passes_of(open_log(path))
    assert passes is not None
    within(passes.period, PERIOD)
    assert passes.decrement is None
    with pytest.raises(
        SysidError, match=r"passes of a light gate, no angle: period T = 1\.25.*A second gate"
    ):
        read_roll(path)


def test_two_gates_give_the_decrement(tmp_path):
    path = write_csv(tmp_path / "log.csv", ("gate 1 (s)", "gate 2 (s)"), crossings(-WIDTH), crossings(WIDTH))
    passes = passes_of(open_log(path))
    assert passes is not None
    within(passes.period, PERIOD)
    assert passes.decrement is not None
    within(passes.decrement, DECREMENT)
    with pytest.raises(SysidError, match="log decrement"):
        read_roll(path)


def test_the_state_of_a_gate_gives_both(tmp_path):
    edges = np.sort(np.concatenate((crossings(-WIDTH), crossings(WIDTH))))
    states = (np.arange(len(edges)) + 1) % 2
    path = write_csv(tmp_path / "log.csv", ("Time (s)", "Gate State"), edges, states)
    passes = passes_of(open_log(path))
    assert passes is not None
    assert passes.decrement is not None
    within(passes.period, PERIOD)
    within(passes.decrement, DECREMENT)


def test_a_motion_beside_a_gate_is_read_as_motion(tmp_path):
    time = np.arange(0, 6, 0.01)
    path = write_csv(tmp_path / "log.csv", ("time_s", "roll_rad", "beam"), time, rocking(time)[0], 0 * time)
    assert passes_of(open_log(path)) is None
    assert read_roll(path).origin == "angle"
