"""Commands that are printed run as they are."""

import math
import shlex
from pathlib import Path

import pytest
from command_line import husky

from sysid.cli.console import Common
from sysid.cli.log_options import LogArguments, VideoArguments
from sysid.cli.measurement import Measurement
from sysid.shown import MOST_SHOWN
from sysid.workspace import Workspace, shipped_data


@pytest.mark.parametrize(
    ("root", "logs", "text"),
    [
        (".", ["a.csv"], "fit a.csv --board pink"),
        ("w", ["a.csv", "b c.csv"], "fit a.csv 'b c.csv' --board pink --workspace w"),
        ("my w", [], "fit LOG... --board pink --workspace 'my w'"),
        ("w", ["a.csv"] * (MOST_SHOWN + 1), "fit LOG... --board pink --workspace w"),
        ("w", None, "fit --board pink --workspace w"),
    ],
)
def test_a_command_names_its_logs_and_its_workspace(root, logs, text):
    assert Workspace(Path(root)).command("fit", "--board", "pink", logs=logs) == f"husky-sysid {text}"


def test_a_command_reads_logs_as_they_were_read():
    given = LogArguments(
        column="tilt 2", unit="deg", start=1.5, release=(2.0, 4.5), lever_arm=(0.1, -0.2, 0.0),
        video=VideoArguments(roi=(1, 2, 3, 4), no_shake=True, overlay=Path("seen.mp4")),
    )  # fmt: skip
    space = Measurement(reading=given, common=Common(workspace=Path("w"))).space
    assert space.command("fit", logs=["a.csv"]) == (
        "husky-sysid fit a.csv --column 'tilt 2' --unit deg --lever-arm 0.1 -0.2 0.0 --from 1.5 --roi 1 2 3 4 --no-shake "
        "--release 2.0 --release 4.5 --workspace w"
    )
    assert space.command("mjcf", "--board", "pink") == "husky-sysid mjcf --board pink --workspace w"


def test_what_decay_and_compare_print_runs(tmp_path):
    lines = (shipped_data() / "decays/pink_hidden.csv").read_text().splitlines()
    angles = [
        f"{time},{math.degrees(float(roll))}" for time, roll, *_ in (line.split(",") for line in lines[1:])
    ]
    (tmp_path / "a log.csv").write_text("\n".join(["time_s,x", *angles]))
    for name in ("decay", "compare"):
        done = husky(
            name, "a log.csv", "--board", "pink", "--column", "x", "--unit", "deg", "--workspace", "w", cwd=tmp_path,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        (line,) = (line for line in done.stdout.splitlines() if "find the missing effect: " in line)
        assert line.endswith("diagnose 'a log.csv' --board pink --column x --unit deg --workspace w")


@pytest.mark.slow
def test_what_a_diagnosis_prints_runs_where_it_was_run(tmp_path):
    """The board is in the workspace only, and its log has a name that a shell would cut."""
    (tmp_path / "my log.csv").write_bytes((shipped_data() / "decays/pink_hidden.csv").read_bytes())
    made = husky("new", "mine", "--kind", "board", "--inertia", "0.0087", "--workspace", "w", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    asked = husky("diagnose", "my log.csv", "--board", "mine", "--workspace", "w", cwd=tmp_path)
    assert asked.returncode == 0, asked.stderr
    (line,) = (line for line in asked.stdout.splitlines() if line.startswith("to add it: husky-sysid "))
    fitted = husky(*shlex.split(line.partition("husky-sysid ")[2]), cwd=tmp_path)
    assert fitted.returncode == 0, fitted.stderr
