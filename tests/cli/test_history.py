"""`history` tells how a record came about, and `undo` takes the last change back."""

import json
from dataclasses import replace

import pytest
from command_line import called

from sysid.errors import SysidError
from sysid.quantity import Quantity
from sysid.workspace import Workspace, shipped_data

SHIPPED = shipped_data() / "boards" / "pink.toml"


def stiffer(space, value):
    board = space.load_board("pink")
    line = {
        "date": "2026-01-01",
        "effects": ["coulomb"],
        "rmse_before": 0.01,
        "rmse": 0.002,
        "heldout_rmse": 0.003,
    }
    stiff = board.with_tilt(stiffness=Quantity(value, 0.1, "N*m/rad"))
    space.save_board(replace(stiff, history=(*board.history, line)))


def test_undo_goes_back_one_change_after_the_other(tmp_path, capsys):
    space = Workspace(tmp_path)
    stiffer(space, 20.0)
    stiffer(space, 30.0)
    called("undo", "-b", "pink", "--workspace", tmp_path)
    assert space.load_board("pink").stiffness == 20.0
    assert "1 step more to go back" in capsys.readouterr().out
    called("undo", "-b", "pink", "--workspace", tmp_path)
    assert (space.boards / "pink.toml").read_bytes() == SHIPPED.read_bytes()
    for folder in (tmp_path, tmp_path / "new"):  # a record that only ships has nothing to take back
        with pytest.raises(SysidError, match="never changed in this workspace"):
            called("undo", "-b", "pink", "--workspace", folder)
    assert not (tmp_path / "new").exists()


def test_history_shows_a_line_a_fit(tmp_path, capsys):
    stiffer(Workspace(tmp_path), 20.0)
    called("history", "-b", "pink", "--workspace", tmp_path, "--json", tmp_path / "h.json")
    out = capsys.readouterr().out
    assert "pink: 1 fit; `undo` can go back 1 step" in out
    assert "coulomb" in out
    content = json.loads((tmp_path / "h.json").read_text())
    assert content["undo_steps"] == 1
    assert content["history"][0]["rmse"] == 0.002
