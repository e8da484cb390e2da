"""Light gates: period and decrement of a pendulum from the times at which it passes."""

import re

import numpy as np
import pytest
from rocking import rocking, write_csv

from sysid.errors import SysidError
from sysid.logs import read_roll

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


def told(path):
    """Period and decrement, with their 95 % half-widths, in the refusal of a log; the decrement is absent without a second gate."""
    with pytest.raises(SysidError, match="passes of a light gate, no angle") as refusal:
        read_roll(path)
    return [tuple(map(float, pair)) for pair in re.findall(r"= (\S+) ± ([\d.e-]+\d)", str(refusal.value))]


def is_true(pair, truth):
    return abs(pair[0] - truth) < 2 * pair[1] < 0.1 * truth


def test_one_gate_gives_the_period(tmp_path):
    (period,) = told(write_csv(tmp_path / "log.csv", ("gate_time_s",), crossings(0.004)))
    assert is_true(period, PERIOD)


@pytest.mark.parametrize("kind", ["two columns", "state", "number"])
def test_two_edges_give_the_decrement(tmp_path, kind):
    one, other = crossings(-WIDTH), crossings(WIDTH)
    edges = np.concatenate((one, other))
    order = np.argsort(edges)
    if kind == "two columns":
        path = write_csv(tmp_path / "log.csv", ("gate 1 (s)", "gate 2 (s)"), one, other)
    elif kind == "state":
        path = write_csv(
            tmp_path / "log.csv", ("Time (s)", "Gate State"), edges[order], (np.arange(len(edges)) + 1) % 2
        )
    else:
        number = np.concatenate((np.ones(len(one)), 2 * np.ones(len(other))))
        path = write_csv(tmp_path / "log.csv", ("photogate", "ms"), number[order], 1e3 * edges[order])
    period, decrement = told(path)
    assert is_true(period, PERIOD)
    assert is_true(decrement, DECREMENT)


def test_a_motion_beside_a_gate_is_read_as_motion(tmp_path):
    time = np.arange(0, 6, 0.01)
    path = write_csv(tmp_path / "log.csv", ("time_s", "roll_rad", "beam"), time, rocking(time)[0], 0 * time)
    assert read_roll(path).origin == "angle"
