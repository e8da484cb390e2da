"""The torque that a motion demands holds the true one, with a band that follows the noise."""

from dataclasses import replace

import decay_truths
import numpy as np
import pytest

from sysid.board import load_board
from sysid.diagnosis.demand import demand_of
from sysid.diagnosis.posterior import Size
from sysid.diagnosis.report import size_in_words
from sysid.joint import JointLaw
from sysid.noise.floor import noise_floor
from sysid.quantity import Quantity
from sysid.workspace import shipped_data

OMEGA, ZETA, WIDE, CUBE = 12.0, 0.05, 0.3, 0.4


def seen(law, seed, sensor="plain"):
    """Return the demand of one log about a joint of 12 rad/s that swings by 0.3 rad, and the unit of torque."""
    truth = decay_truths.Truth(
        kind="known", families=("hardening",), omega=OMEGA, zeta=ZETA, amplitude=WIDE, bent=False, hand="clean", sensor=sensor, laws=law
    )  # fmt: skip
    recording, _ = decay_truths._record(truth, np.random.default_rng(seed), seed)
    pink = load_board(shipped_data() / "boards/pink.toml")
    board = pink.with_tilt(
        stiffness=Quantity(OMEGA**2, 0.0, "N*m/rad"), damping=Quantity(2 * ZETA * OMEGA, 0.0, "N*m*s/rad")
    )
    board = replace(board, inertia=Quantity(1.0, 0.0, "kg*m^2"))
    is_rate = sensor == "gyro"
    noise = noise_floor(recording.releases, rate=is_rate)
    demand = demand_of(recording.releases, JointLaw.from_board(board), noise.std, rate=is_rate)
    return demand, OMEGA**2 * WIDE


@pytest.mark.parametrize(("sensor", "share"), [("plain", 0.9), ("gyro", 0.7)])
def test_the_band_holds_the_true_torque(sensor, share):
    """A cubic spring's torque is inside 95 % bands, and stands out of them. A gyro does not know the angle's zero."""
    inside, clear = [], []
    for seed in range(4):
        demand, unit = seen([("cubic", lambda x, v, z, t: (CUBE * x**3, []), 0)], seed, sensor)
        profile = demand.over(demand.angle)
        truth = -CUBE * unit * (profile.at / WIDE) ** 3
        inside += list(np.abs(profile.torque - truth) < 1.96 * profile.std)
        clear.append(float(np.sqrt(np.mean((profile.torque / profile.std) ** 2))))
    assert np.mean(inside) > share
    assert min(clear) > 4


def test_a_linear_joint_demands_nothing():
    demand, unit = seen([], 5)
    for at in (demand.angle, demand.rate):
        profile = demand.over(at)
        assert np.abs(profile.torque / profile.std).mean() < 2
        assert np.abs(profile.torque).max() < 0.1 * unit


def test_a_share_without_a_limit_has_no_interval():
    """Friction that stops each release after half a swing has no largest value."""
    sizes = Size(torque_share=0.063, torque_std=190.0, energy_share=1.15, energy_std=0.01)
    assert size_in_words(sizes) == "6 % of the peak torque, 115 % ± 2 % of the energy lost"
