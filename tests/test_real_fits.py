"""Real measurements: a servo that swings to rest, with the friction that its makers' rig found."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.board import load_board
from sysid.fit_mjcf import fit_joint
from sysid.fit_problem import make_records
from sysid.logs import LogOptions, read_roll
from sysid.noise import noise_floor
from sysid.own_motion import own_motion
from sysid.quantity import Quantity
from sysid.releases import find_releases
from sysid.workspace import shipped_data

INERTIA = 0.00671
"""0.49 kg at 0.10 m and the servo's armature [kg*m^2]."""


@pytest.fixture(scope="module")
def servo(real_logs):
    pink = load_board(shipped_data() / "boards" / "pink.toml")
    board = replace(pink, inertia=Quantity(INERTIA, 1e-4, "kg*m^2")).with_tilt(
        stiffness=Quantity(0.48, 0.0, "N*m/rad"), damping=Quantity(0.004, 0.0, "N*m*s/rad")
    )
    releases = []
    for gain in (100, 200, 400, 800):
        log = real_logs / "servo_passive_drop" / f"drop_kp{gain}.csv"
        releases += find_releases(read_roll(log, LogOptions(column="angle_rad")))
    assert len(releases) == 4
    return board, releases


def test_friction_fitted_to_two_drops_predicts_the_other_two(servo):
    board, releases = servo
    records = make_records(releases, noise_floor(releases).std, rate=False)
    errors = {}
    for effects in ((), ("coulomb",)):
        fit = fit_joint(releases[1:3], board, effects)
        residuals, _ = own_motion(fit.law, [records[0], records[3]])
        errors[effects] = [
            float(np.sqrt(np.mean(r**2) / np.mean((record.signal - fit.law.rest_angle) ** 2)))
            for r, record in zip(residuals, (records[0], records[3]), strict=True)
        ]
    assert errors["coulomb",][0] < 0.08
    assert errors["coulomb",][1] < 0.05
    assert errors[()][0] > 0.2
    assert dict(fit.law.effects)["coulomb"][0] / INERTIA == pytest.approx(1.91, rel=0.1)
