"""No command writes over a file that it reads, by whatever name either is given."""

import os

import pytest
from command_line import called

from sysid.errors import SysidError
from sysid.workspace import shipped_data

PINK = shipped_data() / "decays" / "pink.csv"
COMMANDS = {
    "roll --output": ("roll", "LOG", "--output", "SAME"),
    "roll --align": ("roll", "LOG", "--align", "OTHER", "--output", "OTHER"),
    "decay --json": ("decay", "LOG", "--board", "pink", "--json", "SAME"),
    "decay --rerun": ("decay", "LOG", "--board", "pink", "--rerun", "SAME"),
    "fit, the second log": ("fit", "LOG", "OTHER", "--board", "pink", "--json", "OTHER"),
    "compare --rerun": ("compare", "LOG", "--board", "pink", "--rerun", "SAME"),
    "report --output": ("report", "LOG", "--board", "pink", "--output", "SAME"),
    "view --output": ("view", "LOG", "--board", "pink", "--output", "SAME"),
}


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_a_measurement_is_never_written_over(tmp_path, command):
    log, other = tmp_path / "log.csv", tmp_path / "other.csv"
    for path in (log, other):
        path.write_bytes(PINK.read_bytes())
    names = {"LOG": log, "SAME": log.parent / "." / "log.csv", "OTHER": other}
    arguments = [str(names.get(word, word)) for word in command]
    with pytest.raises(SysidError, match="would be overwritten"):
        called(*arguments, "--workspace", str(tmp_path))
    assert {path.name for path in tmp_path.iterdir()} == {"log.csv", "other.csv"}
    assert log.read_bytes() == other.read_bytes() == PINK.read_bytes()


@pytest.mark.parametrize("link", [os.link, os.symlink])
def test_another_name_of_the_measurement_is_the_measurement(tmp_path, link):
    log, name = tmp_path / "log.csv", tmp_path / "name.csv"
    log.write_bytes(PINK.read_bytes())
    link(log, name)
    with pytest.raises(SysidError, match=r"--output .*name\.csv: is an input"):
        called("roll", str(log), "--output", str(name))


def test_files_in_a_folder_of_a_log_are_kept(tmp_path):
    folder = tmp_path / "export"
    folder.mkdir()
    inside = folder / "Gyroscope.csv"
    inside.write_bytes(PINK.read_bytes())
    with pytest.raises(SysidError, match=r"is in the input folder .*export"):
        called("roll", str(folder), "--output", str(inside))


def test_the_result_of_a_decay_is_kept_by_what_is_made_of_it(tmp_path):
    bare = tmp_path / "bare.json"
    bare.write_text('{"omega_n": {"value": 41.0, "std": 0.1, "unit": "rad/s"}}')
    text = bare.read_text()
    with pytest.raises(SysidError, match="would be overwritten"):
        called(
            "inertia", "added-mass", "--bare", str(bare), "--loaded", "30", "--mass", "0.5", "--offset", "0.09",
            "--json", str(bare),
        )  # fmt: skip
    assert bare.read_text() == text


def test_an_older_output_is_replaced(tmp_path):
    output = tmp_path / "roll.csv"
    output.write_text("old\n")
    called("roll", str(PINK), "--output", str(output))
    assert output.read_text().startswith("time_s,roll_rad,roll_std_rad\n")


@pytest.mark.parametrize(
    "command",
    [
        ("mjcf", "--board", "pink", "--output", "LOG"),
        ("fit", "OTHER", "--board", "pink", "--output", "LOG"),
        ("report", "OTHER", "--board", "pink", "--output", "LOG"),
        ("synth", "--board", "pink", "--output", "LOG"),
    ],
)
def test_a_measurement_is_not_lost_under_another_kind_of_file(tmp_path, command):
    """A log whose name is typed for that of a model, a page, or a synthetic log; a synthetic one may be made again."""
    log, other = tmp_path / "log.csv", tmp_path / "other.csv"
    for path in (log, other):
        path.write_bytes(PINK.read_bytes())
    arguments = [str({"LOG": log, "OTHER": other}.get(word, word)) for word in command]
    with pytest.raises(SysidError, match=r"exists, and is not a|has no model to patch"):
        called(*arguments, "--workspace", str(tmp_path))
    assert log.read_bytes() == PINK.read_bytes()
    for _ in range(2):
        called("synth", "--board", "pink", "--output", str(tmp_path / "made.csv"), "--rate", "100")
