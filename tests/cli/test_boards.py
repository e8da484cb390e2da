"""Board records: validation, atomic writing, round trip, the shipped two, and `husky-sysid boards`."""

import json
import runpy
import tempfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import husky
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid.board import (
    PHYSICAL,
    TOLD_NUMBERS,
    Board,
    BoardEffect,
    board_to_toml,
    load_board,
    save_board,
)
from sysid.effects import catalogue
from sysid.errors import SysidError
from sysid.free_decay import decay_from_peaks
from sysid.quantity import Quantity
from sysid.workspace import Workspace, shipped_data

SHIPPED = shipped_data() / "boards"
EFFECT = '[[effect]]\nname = "coulomb"\n[effect.parameters]\n'


@pytest.mark.parametrize("name", ["pink", "black"])
def test_shipped_record_is_what_its_script_writes(name: str) -> None:
    board = runpy.run_path(str(SHIPPED / "make_boards.py"))[name]()
    shipped = load_board(SHIPPED / f"{name}.toml")
    assert shipped.passed  # else run `husky-sysid check data/decays/NAME.csv --board NAME` again
    assert board_to_toml(replace(shipped, last_check={})) == board_to_toml(board)


@pytest.mark.parametrize(
    ("name", "k", "d", "printed_k", "printed_d"),
    [("black", "34.850", "0.5400", 34.835, 0.540), ("pink", "14.684", "0.4022", 14.677, 0.402)],
)
def test_paper_to_its_last_digit(name: str, k: str, d: str, printed_k: float, printed_d: float) -> None:
    """k and d from T and two peaks; what the paper prints lies within the rounding of its own inputs."""
    board = load_board(SHIPPED / f"{name}.toml")
    measured = (board.decay[key] for key in ("period", "first_peak", "second_peak"))
    numbers = decay_from_peaks(*measured, board.inertia)
    assert f"{numbers.stiffness.value:.3f}" == k
    assert f"{numbers.damping.value:.4f}" == d
    assert board.stiffness == pytest.approx(numbers.stiffness.value, rel=1e-5)
    assert board.damping == pytest.approx(numbers.damping.value, rel=1e-5)
    assert board.tilt["stiffness"].std == pytest.approx(numbers.stiffness.std, rel=1e-2)
    assert board.published["stiffness"].value == printed_k
    assert f"{numbers.damping.value:.3f}" == f"{printed_d:.3f}"
    assert numbers.stiffness.ci95[0] < printed_k < numbers.stiffness.ci95[1]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("schema = 1", "schema = 2", "schema is 2, expected 1"),
        ("[mass]", "[masses]", "unknown field 'masses'. Did you mean 'mass'?"),
        ("width = {value = 0.2, std = 0.002, unit = \"m\"}", "", "field 'geometry.width' is missing"),
        ('std = 0.002, unit = "m"', 'std = 0.002, unit = "mm"', "unit' is 'mm'; expected 'm'"),
        ("{value = 0.2, std = 0.002", "{value = -0.2, std = 0.002", "expected a positive number"),
        ("{value = 0.2, std = 0.002", "{value = nan, std = 0.002", "expected a positive number"),
        ("{value = 0.2, std = 0.002", "{value = 0.2, std = -1", "expected 0 or more"),
        ('width = {value = 0.2, std = 0.002, unit = "m"}', "width = 0.2", "'geometry.width' is 0.2; expected {"),
        ("[inertia]", "[inertia", "not a TOML file"),
        ("[tilt]", '[[effect]]\nname = "coulomb"\n[tilt]', "section '[effect[0].parameters]' is missing"),
        ("[tilt]", "[fit]\nlogs = 'x'\n[tilt]", "'fit.logs' is 'x'; expected an array of tables"),
        ("[tilt]", "[[history]]\neffects = 3\n[tilt]", "'history[0].effects' is 3; expected an array of names"),
        ("[tilt]", f"[fit]\nrmse = 1{'0' * 400}\n[tilt]", "expected a number"),
        ("[tilt]", "[model]\nfile = 'a.xml'\n[tilt]", "'model.joint' is missing"),
        ("value = 0.0087", "value = 1e300", "'inertia.value' is 1e+300"),
        ("wheel_radius = {value = 0.03", "wheel_radius = {value = 1e-9", "'geometry.wheel_radius"),
        ("value = 0.0087", f"value = {'9' * 400}", "'inertia"),
        ("stiffness = {value = 14.684", "stiffness = {value = 1e8", "stiffness"),
        ("[tilt]", f"{EFFECT}torque = {{value = 0.1, std = 0.0, unit = 'N*mm'}}\n[tilt]", "expected 'N*m'"),
        ("[tilt]", f"{EFFECT}torque = {{value = 0.1, std = 0.0, unit = 'N*m'}}\ntorqe = {{value = 0.1}}\n[tilt]", "Did you mean 'torque'"),
        ("[tilt]", f"{EFFECT}[tilt]", "parameters.torque' is missing"),
    ],
)  # fmt: skip
def test_faulty_record_names_file_field_and_expectation(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    text = (SHIPPED / "pink.toml").read_text().split("\n[check]")[0]
    assert old in text
    path = tmp_path / "pink.toml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(SysidError) as raised:
        load_board(path)
    assert str(path) in str(raised.value)
    assert message in str(raised.value)


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"\x00" * 100, b"", b"[[[", b"schema = 1"])
def test_any_other_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.toml"
    path.write_bytes(content)
    with pytest.raises(SysidError, match=r"x\.toml"):
        load_board(path)


@settings(max_examples=80, deadline=None)
@given(st.data())
def test_mutated_record_is_read_or_refused_in_one_line(data: st.DataObject) -> None:
    """Cut, doubled or altered bytes: a board or one SysidError, never another exception."""
    text = bytearray((SHIPPED / "pink.toml").read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text) - 1))
        match data.draw(st.sampled_from(["cut", "byte", "double"])):
            case "cut":
                del text[at : at + data.draw(st.integers(1, 30))]
            case "byte":
                text[at] = data.draw(st.integers(0, 255))
            case _:
                text[at:at] = text[at : at + 20]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pink.toml"
        path.write_bytes(text)
        with suppress(SysidError):
            assert load_board(path).stiffness > 0


texts = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), max_size=20)
plain = st.recursive(
    st.booleans() | st.integers(-(10**9), 10**9) | st.floats(allow_nan=False) | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts.filter(bool), inner, max_size=3),
    max_leaves=8,
)
sections = st.dictionaries(
    texts.filter(lambda name: name and name not in {*TOLD_NUMBERS, "effects", "logs"}), plain, max_size=4
)
numbers = st.builds(Quantity, st.floats(-1e9, 1e9), st.floats(0, 1e6), st.sampled_from(["N*m", "1"]))
unknown = st.builds(
    BoardEffect,
    texts.filter(lambda name: name not in catalogue()),  # whose parameters are checked
    st.dictionaries(texts.filter(bool), numbers, max_size=3),
)
boards = st.builds(
    replace,
    st.just(Board.load("pink")),
    name=texts,
    description=texts,
    source=texts,
    inertia=st.builds(Quantity, st.floats(*PHYSICAL), st.floats(0, 1e6), st.just("kg*m^2"), texts),
    effects=st.lists(unknown, max_size=3).map(tuple),
    fit=sections,
    last_check=sections,
    history=st.lists(sections, max_size=3).map(tuple),
)


@settings(max_examples=30, deadline=None)
@given(board=boards)
def test_round_trip(board: Board) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "board.toml"
        save_board(board, path)
        assert load_board(path) == board


@pytest.mark.parametrize("failing", ["write_bytes", "replace"])
def test_failure_while_writing_leaves_the_old_record_whole(
    tmp_path: Path, pink: Board, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    path = tmp_path / "pink.toml"
    save_board(pink, path)
    before = path.read_bytes()
    with pytest.raises(SysidError, match="expected a positive number"):  # could not be read back
        save_board(pink.with_tilt(stiffness=Quantity(-3.0, 0.1, "N*m/rad")), path)

    def fail(self: Path, *_: object) -> None:
        if failing == "write_bytes":
            with self.open("wb") as file:
                file.write(b"half of")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, failing, fail)
    with pytest.raises(SysidError, match="No space left"):
        save_board(replace(pink, description="new"), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_workspace_record_comes_before_the_shipped_one(tmp_path: Path, pink: Board) -> None:
    space = Workspace(tmp_path)
    assert space.load_board("pink") == pink
    mine = pink.with_tilt(stiffness=Quantity(20.0, 0.1, "N*m/rad"))
    assert space.save_board(mine) == tmp_path / "data" / "boards" / "pink.toml"
    assert space.load_board("pink").stiffness == 20.0
    assert load_board(SHIPPED / "pink.toml") == pink  # the package is never written to
    with pytest.raises(SysidError, match=r"Did you mean 'pink'\? Known boards: black, pink"):
        space.load_board("pnk")
    save_board(pink, tmp_path / "data" / "boards" / "red.toml")
    with pytest.raises(SysidError, match="field 'name' is 'pink'; expected 'red'"):
        space.load_board("red")


def test_boards_lists_their_numbers(tmp_path: Path) -> None:
    result = husky("boards", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "I [kg·m²]" in result.stdout
    content = json.loads(husky("boards", "--json", "-", cwd=tmp_path).stdout)
    assert [board["board"] for board in content["boards"]] == ["black", "pink"]
    assert content["boards"][1]["damping_ratio"] == pytest.approx(0.5627, abs=1e-4)
    assert content["boards"][1]["natural_frequency_hz"] == pytest.approx(6.539, abs=1e-3)
    assert content["boards"][1]["shipped"] is True


def test_one_broken_record_does_not_hide_the_others(tmp_path: Path) -> None:
    folder = tmp_path / "data" / "boards"
    folder.mkdir(parents=True)
    (folder / "mine.toml").write_text("schema = 1\n")
    result = husky("boards", "--json", "out.json", cwd=tmp_path)
    assert result.returncode == 0
    assert "mine.toml" in result.stderr
    assert "pink" in result.stdout
    assert len(json.loads((tmp_path / "out.json").read_text())["errors"]) == 1
    assert husky("boards", "mine", cwd=tmp_path).returncode == 1


def test_a_check_does_not_survive_an_edit_by_hand(tmp_path: Path, pink: Board) -> None:
    space = Workspace(tmp_path)
    path = space.save_board(pink.checked({"passed": True, "nrmse": 0.012}))
    assert space.load_board("pink").passed
    path.write_text(path.read_text().replace("14.684", "24.684"))
    edited = space.load_board("pink")
    assert edited.stiffness == 24.684
    assert not edited.passed
    assert edited.check_is_stale
    assert "out of date" in husky("boards", cwd=tmp_path).stdout


def test_commands_beside_each_other_lose_nothing(tmp_path: Path, pink: Board) -> None:
    space = Workspace(tmp_path)
    space.save_board(pink)
    fits = [
        replace(pink.with_tilt(stiffness=Quantity(k, 0.1, "N*m/rad")), history=({"stiffness": k},))
        for k in (15.0, 16.0)
    ]
    for fit in fits:  # both read the record before either wrote it
        space.save_board(fit, since=pink)
    with pytest.raises(SysidError, match="another command changed"):
        space.save_board(pink.checked({"passed": True}), since=pink)
    now = space.load_board("pink")
    assert [line["stiffness"] for line in now.history] == [15.0, 16.0]
    assert now.stiffness == 16.0
    assert not now.passed
