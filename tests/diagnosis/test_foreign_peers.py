"""The table of peers on foreign logs: what each says, or why it says nothing."""

from pathlib import Path

import foreign_peers
import numpy as np
import pytest

from sysid.board import Board
from sysid.synth import SynthOptions, synthesise


def test_our_verdicts_are_read_as_they_were_printed() -> None:
    name, hidden, said = "stop_z04", "end-stop", "end-stop ~ stribeck; dahl"
    text = f"ok  {name:34s} {hidden:24s} {said} | confidence 0.27 | error/noise 2.00 -> 1.000\nBAD broken: SysidError\n"
    assert foreign_peers.our_verdicts(text) == {name: ("end-stop ~ stribeck; dahl (27%)", True)}


def test_a_peer_that_is_not_installed_or_fails_says_so() -> None:
    def missing(releases: object, board: object) -> str:
        raise ModuleNotFoundError("No module named 'pysindy'", name="pysindy")

    assert foreign_peers.asked(missing, [], None) == "(not installed: pysindy)"
    assert foreign_peers.asked(lambda r, b: 1 / 0, [], None) == "(fails: ZeroDivisionError: division by zero)"
    assert foreign_peers.asked(lambda r, b: {"b", "a"}, [], None) == "a + b"
    assert foreign_peers.asked(lambda r, b: set(), [], None) == "nothing"


def test_peers_get_the_same_releases_on_even_steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = SynthOptions(angles=(0.15, -0.12), rate=500.0, jitter=0.1)
    synthesise(Board.load("pink"), {}, options).save(tmp_path / "log.csv")
    seen = []
    monkeypatch.setattr(
        foreign_peers, "ask_mujoco_sysid", lambda releases, board: seen.extend(releases) or "fine"
    )
    monkeypatch.setattr(foreign_peers, "ask_pysindy", lambda releases, board: {"coulomb", "x times its size"})
    truth = {"effects": ["coulomb"], "also": []}
    line, right, among = foreign_peers.row(tmp_path, "log", truth, "ours")
    assert line == "| log | coulomb | ours | fine | coulomb + x times its size |"
    assert (right, among) == (False, True)
    assert np.ptp(np.diff(seen[0].time)) < 1e-9
