"""A column beside the motion that says when nothing drives the joint."""

import json

import numpy as np
import pytest
from rocking import rocking, write_csv

from sysid.logs import read_roll

TIME = np.arange(0, 6, 1 / 100)
ROLL = np.where(TIME < 2, 0.3 * np.sin(0.4 * np.pi * TIME) ** 2 + 0.02, rocking(TIME, release=2.0)[0])
ROLL = ROLL + np.random.default_rng(0).normal(0, 1e-3, len(TIME))
ON = TIME < 2.0


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("torque_enable", [str(on) for on in ON.tolist()]),
        ("motor_on", ON.astype(float)),
        ("current_A", np.where(ON, 0.4 * np.cos(9 * TIME), 0.0)),
        ("goal_position", np.where(ON, 0.3 * np.sin(0.4 * np.pi * np.minimum(TIME, 2)) ** 2 + 0.02, 0.9)),
        ("goal_position", [f"{v:.5f}" if on else "" for v, on in zip(ROLL, ON, strict=True)]),
    ],
)
def test_what_drives_the_joint_says_when_it_is_free(tmp_path, name, values):
    path = write_csv(tmp_path / "log.csv", ("t_s", "position_rad", name), TIME, ROLL, values)
    roll = read_roll(path)
    assert roll.free is not None
    assert np.mean(roll.free == (roll.time >= 2.0)) > 0.98
    assert any(f"'{name}' reports a free joint from" in text for text in roll.notes)
    assert roll[:50].free is not None
    assert len(roll[:50].free) == 50


def test_each_joint_has_its_own_switch(tmp_path):
    entries = [
        {
            "t": float(t),
            "elbow": {"pos_rad": float(r), "torque_enable": bool(on)},
            "wrist": {"torque_enable": True},
        }
        for t, r, on in zip(TIME, ROLL, ON, strict=True)
    ]
    path = tmp_path / "log.json"
    path.write_text(json.dumps({"mass": 0.5, "entries": entries}))
    free = read_roll(path).free
    assert free is not None
    assert free[-1]
    assert not free[0]


def test_a_torque_that_is_never_switched_off_is_a_warning(tmp_path):
    path = write_csv(tmp_path / "log.csv", ("t_s", "position_rad", "torque_enable"), TIME, ROLL, 0 * TIME + 1)
    roll = read_roll(path)
    assert roll.free is not None
    assert not roll.free.any()
    assert any("driven all the time" in text for text in roll.warnings)


def test_columns_that_do_not_tell_leave_it_open(tmp_path):
    others = {"torque_enable": 0 * TIME, "temperature": 0 * TIME + 30, "current_A": 0 * TIME}
    path = write_csv(tmp_path / "log.csv", ("t_s", "position_rad", *others), TIME, ROLL, *others.values())
    assert read_roll(path).free is None
