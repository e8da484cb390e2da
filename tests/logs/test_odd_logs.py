"""Logs that must not pass for what they are not: one given twice, one in another unit of time."""

import os
import shutil

import pytest
from command_line import called

from sysid.errors import SysidError
from sysid.workspace import shipped_data

LOG = shipped_data() / "decays" / "pink.csv"


@pytest.mark.parametrize("name", ["log.csv", "film.mp4"])
def test_a_pipe_is_refused_instead_of_waited_for(name, tmp_path):
    os.mkfifo(tmp_path / name)
    with pytest.raises(SysidError, match="is a pipe or a device"):
        called("decay", tmp_path / name)


@pytest.mark.parametrize("command", ["fit", "check", "report"])
def test_a_log_given_twice_is_refused_by_name(command, tmp_path):
    with pytest.raises(SysidError, match=r"pink\.csv was given twice"):
        called(command, LOG, LOG, "--board", "pink", "--workspace", tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_copy_under_another_name_is_the_same_log(tmp_path):
    copy = tmp_path / "copy.csv"
    shutil.copy(LOG, copy)
    with pytest.raises(SysidError, match=r"pink\.csv and .*copy\.csv hold the same bytes"):
        called("fit", LOG, copy, "--board", "pink", "--workspace", tmp_path / "w")
    assert not (tmp_path / "w").exists()


@pytest.fixture
def milliseconds(tmp_path):
    """The log's first two releases with their times in ms, in a column that says s."""
    lines = LOG.read_text().splitlines()
    rows = [line.split(",") for line in lines[1:3500]]
    log = tmp_path / "ms.csv"
    log.write_text("\n".join([lines[0], *(f"{1000 * float(t)},{roll}" for t, roll in rows)]))
    return log


@pytest.mark.slow
def test_fit_saves_no_period_that_nothing_has(milliseconds, tmp_path, capsys):
    with pytest.raises(SysidError, match=r"natural period is 15\d(\.\d)? s.*--rate.*record is unchanged"):
        called("fit", milliseconds, "--board", "pink", "--workspace", tmp_path)
    assert not (tmp_path / "data").exists()
    assert called("fit", milliseconds, "--board", "pink", "--workspace", tmp_path, "--any-period") == 0
    assert (tmp_path / "data" / "boards" / "pink.toml").exists()
    assert "natural period is 15" in capsys.readouterr().err


def test_decay_doubts_a_period_and_names_the_time(milliseconds, tmp_path, capsys):
    assert called("decay", milliseconds, "--board", "pink", "--workspace", tmp_path, "--no-picture") == 0
    err = " ".join(capsys.readouterr().err.split())
    assert "natural period is 15" in err
    assert "the damping ratio agrees, and only the period is" in err
