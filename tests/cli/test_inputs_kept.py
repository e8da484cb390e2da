"""No command writes over a file that it reads, by whatever name either is given."""

import os

import pytest
from command_line import called

from sysid.errors import SysidError
from sysid.workspace import shipped_data

PINK = shipped_data() / "decays" / "pink.csv"
KEPT = {
    "roll --output": "roll LOG --output SAME",
    "roll --output, a hard link": "roll LOG --output HARD",
    "roll --output, a symbolic link": "roll LOG --output SOFT",
    "roll --align": "roll LOG --align OTHER --output OTHER",
    "roll --output in the folder of a log": "roll FOLDER --output SAME",
    "decay --json": "decay LOG --board pink --json SAME",
    "fit, the second log": "fit LOG OTHER --board pink --json OTHER",
    "fit --output": "fit OTHER --board pink --output LOG",
    "compare --rerun": "compare LOG --board pink --rerun SAME",
    "report --output": "report LOG --board pink --output SAME",
    "report --output, another log": "report OTHER --board pink --output LOG",
    "view --output": "view LOG --board pink --output SAME",
    "mjcf --output": "mjcf --board pink --output LOG",
    "synth --output": "synth --board pink --output LOG",
    "inertia --json": "inertia added-mass --bare BARE --loaded 30 --mass 0.5 --offset 0.09 --json BARE",
}
REFUSED = "would be overwritten|is an input|is in the input folder|exists, and is not a|has no model to patch"


@pytest.mark.parametrize("command", KEPT.values(), ids=KEPT)
def test_a_measurement_is_never_written_over(tmp_path, command):
    folder = tmp_path / "logs"
    folder.mkdir()
    log, other, bare = folder / "log.csv", folder / "other.csv", folder / "bare.json"
    for path in (log, other):
        path.write_bytes(PINK.read_bytes())
    bare.write_text('{"omega_n": {"value": 41.0, "std": 0.1, "unit": "rad/s"}}')
    names = {"LOG": log, "SAME": folder / "." / "log.csv", "OTHER": other, "BARE": bare, "FOLDER": folder}
    for name, link in (("HARD", os.link), ("SOFT", os.symlink)):
        names[name] = folder / f"{name}.csv"
        link(log, names[name])
    before = {path: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(SysidError, match=REFUSED):
        called(*(names.get(word, word) for word in command.split()), "--workspace", tmp_path)
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    assert list(tmp_path.iterdir()) == [folder]


def test_what_a_command_made_is_replaced(tmp_path):
    output = tmp_path / "roll.csv"
    output.write_text("old\n")
    called("roll", PINK, "--output", output)
    assert output.read_text().startswith("time_s,roll_rad,roll_std_rad\n")
    for _ in range(2):  # a synthetic log has its truth beside it
        called("synth", "--board", "pink", "--output", tmp_path / "made.csv", "--rate", "100")
