"""`live` shows numbers after each release of a replayed phone, and keeps the log."""

import re

import pytest
from command_line import husky
from recorded_phone import export_of_two_releases, recorded_phone


@pytest.fixture(scope="module")
def export(tmp_path_factory):
    return export_of_two_releases(tmp_path_factory.mktemp("export"))


def test_a_replayed_phone_gives_numbers_and_a_kept_log(export, tmp_path):
    with recorded_phone(export, pace=2.0) as (_, address):
        live = ("live", "-b", "pink", "--phone", address, "--workspace", tmp_path)
        done = husky(*live, "--releases", "2")
    assert done.returncode == 0, done.stderr
    lines = re.findall(
        r"release (\d): .* from the (\w+)   k = (.*) N·m/rad   d = (.*) N·m·s/rad", done.stdout
    )
    assert [line[:2] for line in lines] == [("1", "right"), ("2", "left")]
    value, half = map(float, lines[1][2].split(" ± "))
    assert abs(value - 14.68) < half
    assert "Three more from the left, from 3°." in done.stdout
    (log,) = (tmp_path / "logs").iterdir()
    assert husky("decay", log, "-b", "pink", "--workspace", tmp_path).returncode == 0


def test_a_phone_that_falls_silent_leaves_its_log(export, tmp_path):
    with recorded_phone(export, pace=5.0, silent_after=3.0) as (_, address):
        done = husky("live", "-b", "pink", "--phone", address, "--workspace", tmp_path)
    assert done.returncode == 1
    assert "kept in" in done.stderr
    (log,) = (tmp_path / "logs").iterdir()
    assert (log / "Gyroscope.csv").stat().st_size > 1000
