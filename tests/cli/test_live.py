"""`live` shows numbers after each release of a replayed phone, and keeps the log."""

import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import husky
from recorded_phone import recorded_phone

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def export(tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "tip.zip"
    husky("synth", "-b", "pink", "--releases", "2", "--rate", "200", "--dialect", "phyphox", "-o", path)
    return path


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


def test_files_that_appear_are_taken(tmp_path):
    (tmp_path / "in").mkdir()
    words = ("live", "--board", "pink", "--watch", tmp_path / "in", "--workspace", tmp_path)
    command, pipes = [sys.executable, "-u", "-m", "sysid.cli", *map(str, words)], subprocess.PIPE
    process = subprocess.Popen(command, stdout=pipes, stderr=subprocess.STDOUT, text=True, cwd=ROOT)
    try:
        shown = [process.stdout.readline()]
        assert "Hold the deck still" in shown[0]
        (tmp_path / "in" / "readme.txt").write_text("no log")
        shutil.copy(ROOT / "data" / "decays" / "pink.csv", tmp_path / "in")
        while "k = " not in shown[-1]:
            shown.append(process.stdout.readline())
        numbers = [line.split(":")[0] for line in shown if re.match(r"release \d", line)]
        assert numbers == [f"release {n}" for n in range(1, 5)]  # of one file, each with a line of its own
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate(timeout=20)
        assert process.returncode == 0
        assert "kept: " in rest
        assert ("".join(shown) + rest).count("readme.txt") == 1  # what cannot be read is named, and once
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("given", [(), ("--phone", "a", "--watch", "b"), ("--watch", "nowhere")])
def test_what_is_not_clear_is_refused(given, tmp_path):
    done = husky("live", "-b", "pink", *given, "--workspace", tmp_path)
    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1
