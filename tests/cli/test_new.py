"""`new` writes the smallest record, and what it lacks is said where it is needed."""

import builtins
import sys

import pytest
from command_line import called, husky

from sysid.board import Board
from sysid.workspace import shipped_data


def made(folder, name) -> Board:
    return Board.load(folder / "data" / "boards" / f"{name}.toml")


def test_a_pendulum_is_its_mass_and_arm(tmp_path):
    called("new", "arm", "--mass", "0.49±0.002", "--arm", "0.1±0.001", "--workspace", tmp_path)
    board = made(tmp_path, "arm")
    assert board.inertia.value == pytest.approx(0.49 * 0.1**2)
    share = board.inertia.ci95[1] / board.inertia.value - 1
    assert share == pytest.approx(((0.002 / 0.49) ** 2 + 0.02**2) ** 0.5, rel=1e-3)
    (pull,) = (part.parameters for part in board.effects)
    assert pull["sine"].value == pytest.approx(-0.49 * 9.80665 * 0.1)
    assert board.stiffness == 0.0
    assert not board.geometry


def test_a_terminal_is_asked(tmp_path, monkeypatch):
    answers = iter(["board", "0.0087±0.0001"])
    monkeypatch.setattr(sys, "stdin", type("Terminal", (), {"isatty": lambda self: True})())
    monkeypatch.setattr(builtins, "input", lambda question: next(answers))
    from sysid.cli.console import Common
    from sysid.cli.new import new

    new("mine", common=Common(workspace=tmp_path))
    assert made(tmp_path, "mine").inertia.value == 0.0087


@pytest.mark.parametrize(
    ("arguments", "says", "code"),
    [
        (("new", "mine"), "--kind is missing, and there is no terminal", 2),
        (("new", "mine", "--kind", "pendulum", "--mass", "1"), "--arm is missing", 2),
        (("new", "pink", "--inertia", "0.01"), "there is a record 'pink' already", 1),
        (("new", "a/b", "--inertia", "0.01"), "no name for a record", 1),
        (("new", "mine", "--inertia", "-1"), "positive number", 1),
    ],
)
def test_what_is_missing_is_said(tmp_path, arguments, says, code):
    done = husky(*arguments, "--workspace", tmp_path)
    assert (done.returncode, says in done.stderr) == (code, True), done.stderr


def test_a_rig_is_its_inertia_and_is_fitted_and_checked_on_its_bench(tmp_path, capsys):
    """A rig without geometry: released logs of the pink board, whose inertia it is given."""
    log, rig = shipped_data() / "decays" / "pink.csv", ("--board", "rig", "--workspace", tmp_path)
    called("new", "rig", "--inertia", "0.0087±0.0001", "--workspace", tmp_path)
    assert f"husky-sysid fit LOG... --board rig --workspace {tmp_path}" in capsys.readouterr().out
    assert made(tmp_path, "rig").inertia.ci95 == pytest.approx((0.0086, 0.0088))
    called("fit", log, *rig)
    assert made(tmp_path, "rig").stiffness == pytest.approx(14.68, rel=0.02)
    called("check", log, *rig)
    assert "clamped bench" in capsys.readouterr().out
    called("mjcf", *rig, "--bench", "-o", tmp_path / "rig.xml")
