"""The logs of a record are found from any folder."""

from pathlib import Path
from shutil import copy

import pytest
from command_line import called, husky

from reports.log_files import find_logs
from sysid.workspace import Workspace, shipped_data


def test_a_workspace_is_looked_at_from_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A name from the folder in which the fit was made would lead nowhere, or to another log of that name."""
    (measured := tmp_path / "measured").mkdir()
    (elsewhere := tmp_path / "elsewhere").mkdir()
    copy(shipped_data() / "decays" / "pink.csv", measured / "log.csv")
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


def test_logs_are_read_again_as_they_were_fitted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Otherwise 180 mrad are 180 degrees, and what `--to` left out is a release more."""
    lines = (shipped_data() / "decays" / "pink.csv").read_text().splitlines()[1:]
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
