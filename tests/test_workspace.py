"""Commands that are printed run as they are."""

import shlex
from pathlib import Path

import pytest
from command_line import husky

from sysid.workspace import MOST_NAMED, Workspace, shipped_data


@pytest.mark.parametrize(
    ("root", "logs", "text"),
    [
        (".", ["a.csv"], "fit a.csv --board pink"),
        ("w", ["a.csv", "b c.csv"], "fit a.csv 'b c.csv' --board pink --workspace w"),
        ("my w", [], "fit LOG... --board pink --workspace 'my w'"),
        ("w", ["a.csv"] * (MOST_NAMED + 1), "fit LOG... --board pink --workspace w"),
        ("w", None, "fit --board pink --workspace w"),
    ],
)
def test_a_command_names_its_logs_and_its_workspace(root, logs, text):
    assert Workspace(Path(root)).command("fit", "--board", "pink", logs=logs) == f"husky-sysid {text}"


def test_the_current_folder_is_no_workspace_to_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "--workspace" not in Workspace(tmp_path).command("fit", logs=())
    assert "--workspace .." in Workspace(Path("..")).command("fit", logs=())


@pytest.mark.slow
def test_what_a_diagnosis_prints_runs_where_it_was_run(tmp_path):
    """The board is in the workspace only, and its log has a name that a shell would cut."""
    (tmp_path / "my log.csv").write_bytes((shipped_data() / "decays/pink_hidden.csv").read_bytes())
    made = husky("new", "mine", "--kind", "board", "--inertia", "0.0087", "--workspace", "w", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    asked = husky(
        "diagnose", "my log.csv", "--board", "mine", "--workspace", "w", "--workers", "1", cwd=tmp_path
    )
    assert asked.returncode == 0, asked.stderr
    (line,) = (line for line in asked.stdout.splitlines() if line.startswith("to add it: husky-sysid "))
    fitted = husky(*shlex.split(line.partition("husky-sysid ")[2]), cwd=tmp_path)
    assert fitted.returncode == 0, fitted.stderr
