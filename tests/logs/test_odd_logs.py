"""Odd logs are refused or doubted: a pipe, one given twice, another unit of time. The logs of a record are found from any folder."""

import os
import shutil
from pathlib import Path

import pytest
from command_line import called, husky

from reports.log_files import find_logs
from sysid.errors import SysidError
from sysid.workspace import Workspace, shipped_data

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


def test_a_workspace_is_looked_at_from_another_folder(tmp_path, monkeypatch):
    """A name from the folder in which the fit was made would lead nowhere, or to another log of that name."""
    (measured := tmp_path / "measured").mkdir()
    (elsewhere := tmp_path / "elsewhere").mkdir()
    shutil.copy(LOG, measured / "log.csv")
    (elsewhere / "log.csv").write_text("another log")
    monkeypatch.chdir(measured)
    assert called("fit", "log.csv", "--board", "pink", "--workspace", "../mine") == 0
    monkeypatch.chdir(elsewhere)
    space = Workspace(Path("../mine"))
    board = space.load_board("pink")
    (found,) = find_logs(board, [], space)
    assert found.found is not None
    assert found.state == "as fitted"
    assert found.found.resolve() == measured / "log.csv"
    assert str(tmp_path) not in str(board.fit["logs"]), "a record speaks of no machine"


def test_logs_are_read_again_as_they_were_fitted(tmp_path, monkeypatch):
    """Otherwise 180 mrad are 180 degrees, and what `--to` left out is a release more."""
    lines = LOG.read_text().splitlines()[1:]
    pairs = [line.split(",")[:2] for line in lines]
    table = [f"{time},{1e3 * float(roll):.3f}" for time, roll in pairs]
    (tmp_path / "log.csv").write_text("\n".join(["time_s,roll", *table]))
    monkeypatch.chdir(tmp_path)
    done = husky("fit", "log.csv", "--board", "pink", "--unit", "mrad", "--to", "6.5")
    assert done.returncode == 0, done.stderr
    done = husky("report", "--board", "pink")
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "reports" / "pink" / "report.html").read_text()
    assert "Yes: error" in page
    assert "release 2" in page
    assert "release 3" not in page
    assert "--unit mrad --to 6.5" in page  # of the command that it names
    record = tmp_path / "data" / "boards" / "pink.toml"
    record.write_text(record.read_text().replace("--unit mrad", "--unt mrad"))
    done = husky("report", "--board", "pink")
    assert done.returncode == 1
    assert "fit.reading" in done.stderr
