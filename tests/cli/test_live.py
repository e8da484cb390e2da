"""`live` shows numbers after each release of a replayed phone, keeps the log, and serves its page to this machine only."""

import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from urllib.request import ProxyHandler, build_opener

import psutil
import pytest
from command_line import husky
from recorded_phone import recorded_phone

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def export(tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "tip.zip"
    husky("synth", "-b", "pink", "--releases", "2", "--rate", "200", "--dialect", "phyphox", "-o", path)
    return path


def fetch(address):
    with build_opener(ProxyHandler({})).open(address) as answer:
        return answer.read().decode()


def test_a_replayed_phone_gives_numbers_and_a_kept_log(export, tmp_path):
    with recorded_phone(export, pace=2.0) as (_, address):
        live = ("live", "-b", "pink", "--phone", address, "--port", "0", "--workspace", tmp_path)
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
        done = husky("live", "-b", "pink", "--phone", address, "--port", "0", "--workspace", tmp_path)
    assert done.returncode == 1
    assert "kept in" in done.stderr
    (log,) = (tmp_path / "logs").iterdir()
    assert (log / "Gyroscope.csv").stat().st_size > 1000


def test_files_that_appear_are_taken_and_the_page_shows_them(tmp_path):
    (tmp_path / "in").mkdir()
    words = ("live", "--board", "pink", "--port", "0", "--watch", tmp_path / "in", "--workspace", tmp_path)
    command, pipes = [sys.executable, "-u", "-m", "sysid.cli", *map(str, words)], subprocess.PIPE
    process = subprocess.Popen(command, stdout=pipes, stderr=subprocess.STDOUT, text=True, cwd=ROOT)
    try:
        address = re.search(r"http://127\.0\.0\.1:\d+/", process.stdout.readline())[0]
        assert '"version": 1' in fetch(address + "state")
        assert "Hold the deck still" in fetch(address)
        (tmp_path / "in" / "readme.txt").write_text("no log")
        shutil.copy(ROOT / "data" / "decays" / "pink.csv", tmp_path / "in")
        shown = [""]
        while "k = " not in shown[-1]:
            shown.append(process.stdout.readline())
        numbers = [line.split(":")[0] for line in shown if re.match(r"release \d", line)]
        assert numbers == [f"release {n}" for n in range(1, 5)]  # of one file, each with a line of its own
        deadline = time.monotonic() + 10
        while '"version": 2' not in fetch(address + "state"):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        page = fetch(address)
        assert 'id="play-data"' in page
        assert "N·m/rad" in page
        listens = [c for c in psutil.Process(process.pid).net_connections() if c.status == psutil.CONN_LISTEN]
        assert {c.laddr.ip for c in listens} == {"127.0.0.1"}
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
    done = husky("live", "-b", "pink", *given, "--port", "0", "--workspace", tmp_path)
    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1
