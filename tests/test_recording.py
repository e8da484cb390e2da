"""Where roll is counted from: the log's zero, unless that is the sensor's alone."""

from dataclasses import replace

import numpy as np
import pytest
from command_line import husky
from decay_truth import Recipe, make_roll

from sysid.diagnosis.diagnose import diagnose
from sysid.fitting.joint import fit_joint
from sysid.recording import FOREIGN_ZERO_RATIO, Recording

WIDEST = 0.2


@pytest.fixture(scope="module")
def roll():
    return make_roll(Recipe(amplitudes=(WIDEST, -0.15, 0.1), sampling=200, noise=3e-4))


def raised(roll, angle):
    return replace(roll, roll=roll.roll + angle)


@pytest.mark.parametrize("angle", [np.pi, -np.pi / 2, 1.1 * FOREIGN_ZERO_RATIO * WIDEST])
def test_an_encoders_own_zero_changes_nothing(roll, pink, angle):
    plain, moved = Recording.of(roll), Recording.of(raised(roll, angle))
    assert moved.roll.zero == "constant"
    assert abs(np.median([release.rest for release in moved.releases])) < 1e-9
    assert "--keep-zero" in moved.warnings[-1]
    assert f"{np.degrees(angle):+.4g}°"[:4] in moved.warnings[-1]
    one, other = (fit_joint(list(found.releases), pink).quantities for found in (plain, moved))
    assert other["stiffness"].value == pytest.approx(one["stiffness"].value, rel=1e-4)
    assert other["damping"].value == pytest.approx(one["damping"].value, rel=1e-3)


def test_a_deck_that_rests_askew_is_left_there(roll):
    for found in (Recording.of(raised(roll, 0.9 * FOREIGN_ZERO_RATIO * WIDEST)), Recording.of(roll)):
        assert found.roll.zero == "known"
        assert not found.warnings
    assert Recording.of(replace(raised(roll, 3.0), zero="drifting")).roll.zero == "drifting"


def test_a_zero_that_is_kept_is_the_fits_rest_angle(roll, pink):
    found = Recording.of(raised(roll, np.pi), keep_zero=True)
    assert not found.warnings
    rest = fit_joint(list(found.releases), pink).quantities["rest_angle"]
    assert rest.value == pytest.approx(np.pi, abs=1e-3)


def test_a_linear_joint_on_a_distant_zero_lacks_nothing(roll, pink):
    verdict = diagnose(Recording.of(raised(roll, np.pi)), pink).verdict
    assert verdict.status == "none-missing"


def test_a_command_says_where_roll_is_counted_from(roll, tmp_path):
    table = np.column_stack([roll.time, roll.roll + np.pi])
    np.savetxt(tmp_path / "log.csv", table, "%.6f", ",", header="time_s,roll_rad", comments="")
    for more, said in (((), True), (("--keep-zero",), False)):
        done = husky("decay", tmp_path / "log.csv", "-b", "pink", "--workspace", tmp_path, *more)
        assert done.returncode == 0
        assert ("counted from the rest" in done.stderr) is said
