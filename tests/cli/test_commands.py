"""The command line as a whole: every command is there, usage errors exit with 2, failures with 1."""

import contextlib
import importlib
import io
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import husky

from sysid.cli import ALIASES, COMMANDS, EXIT_CODES, build_app, overview
from sysid.cli.console import Common, Printer

HEAVY = {
    "numpy",
    "pandas",
    "scipy",
    "matplotlib",
    "casadi",
    "mujoco",
    "av",
    "cv2",
    "rerun",
    "torch",
    "control",
}

ROOT = Path(__file__).parents[2]


def heavy_modules_after(statement):
    code = f"{statement}; import sys; print(*sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return HEAVY & set(result.stdout.split())


def test_the_first_screen_is_the_loop_and_then_at_most_twenty_commands():
    for words in ([], ["--help"], ["-h"]):
        done = subprocess.run([sys.executable, "-m", "sysid.cli", *words], capture_output=True, text=True)
        assert done.returncode == 0
        assert done.stdout == overview(everything=False) + "\n"
    lines = overview(everything=False).splitlines()
    commands = [line.split()[0] for line in lines if line.startswith("  ")]
    assert commands[:5] == ["decay", "compare", "diagnose", "fit", "check"]
    assert len(commands) <= 20
    assert lines.index("Joints") < lines.index("Policies")
    assert max(map(len, lines)) <= 100
    assert EXIT_CODES in lines


def test_help_all_names_every_command():
    done = subprocess.run([sys.executable, "-m", "sysid.cli", "--help-all"], capture_output=True, text=True)
    assert set(COMMANDS) <= set(done.stdout.split())
    assert not set(ALIASES) & set(done.stdout.split())


def test_the_overview_needs_no_package():
    """It answers at once: what formats a command's help takes longer to import than the rest."""
    code = (
        "import sysid.cli, sys; sys.argv = ['husky-sysid', '--help']\nsysid.cli.main()\nprint(*sys.modules)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert not {"cyclopts", "rich", "numpy"} & set(result.stdout.split())


def options(text):
    """Return the options that a help lists."""
    return set(re.findall(r"^│ +[* ]*(?:[A-Z]+ +)?(--[a-z-]+)", text, re.M))


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_shows_fifteen_options_and_all_on_demand(name):
    first = options(husky(name, "--help").stdout)
    assert len(first) <= 15
    if not COMMANDS[name].has_parts:
        assert "--json" in first
    every = options(help_all(name))
    assert first <= every
    assert first >= set(COMMANDS[name].first) & every


def help_all(name):
    app = build_app(everything=True)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        app([name, "--help"], result_action="return_value", exit_on_error=False)
    return printed.getvalue()


def test_names_of_before_still_work():
    for old, new in ALIASES.items():
        assert options(husky(old, "--help").stdout) == options(husky(new, "--help").stdout) != set()


def test_help_imports_nothing_heavy():
    assert heavy_modules_after("import sysid.cli; sysid.cli.build_app()") == set()


def test_an_interruption_is_caught_before_anything_slow_is_imported():
    code = "import sysid.cli, sys; print(*sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "sysid.cli" in result.stdout
    assert not {"cyclopts", "rich", "importlib.metadata"} & set(result.stdout.split())


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(name):
    result = husky(name, "--help")
    assert result.returncode == 0, result.stderr
    assert "--json" in result.stdout
    assert "--workspace" in result.stdout
    assert "--empty" not in result.stdout  # what cyclopts makes of a list of options; no command means it


def test_command_modules_import_nothing_heavy():
    """All in one process, one after the other: whichever is the first to import something heavy is named."""
    code = "import importlib, sys\nfor name in sys.argv[1:]:\n before = set(sys.modules)\n"
    code += " importlib.import_module(f'sysid.cli.{name}')\n print(name, *set(sys.modules) - before)"
    modules = {(command.module or name).split(":")[0] for name, command in COMMANDS.items()}
    names = [*sorted(modules - {"train"}), "train"]
    done = subprocess.run([sys.executable, "-c", code, *names], capture_output=True, text=True, check=True)
    heavy = {
        name: HEAVY & set(modules) - {"numpy"} for name, *modules in map(str.split, done.stdout.splitlines())
    }
    assert list(heavy) == names
    # The options of `train` are the task's own, and name MuJoCo's types.
    assert heavy.pop("train") <= {"mujoco"}
    assert not {name: modules for name, modules in heavy.items() if modules}


def test_every_command_file_is_listed():
    package = importlib.import_module("sysid.cli")
    files = {path.stem for path in Path(package.__path__[0]).glob("*.py")}
    shared = {
        "__init__",
        "__main__",
        "bars",
        "console",
        "drive_options",
        "driven",
        "first_screen",
        "fit_intervals",
        "log_options",
        "parameter_options",
        "ride_options",
        "streams",
        "subject",
    }
    assert files - shared == {(command.module or name).split(":")[0] for name, command in COMMANDS.items()}


def test_the_shell_completes_commands_and_options(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "sysid.cli", "--install-completion", "--shell", "bash"],
        capture_output=True,
        text=True,
        env={**os.environ, "HOME": str(tmp_path)},
    )
    assert done.returncode == 0, done.stderr
    script = next(path for path in tmp_path.rglob("*") if path.is_file() and "decay" in path.read_text())
    assert "--time-column" in script.read_text()
    assert subprocess.run(["bash", "-n", script]).returncode == 0


def test_unknown_command_is_a_usage_error_with_a_suggestion():
    result = husky("dcay")
    assert result.returncode == 2
    assert 'Did you mean "decay"?' in result.stderr


def test_unknown_board_is_an_error_with_a_suggestion(tmp_path):
    result = husky("boards", "pnk", "--workspace", str(tmp_path))
    assert result.returncode == 1
    assert "Did you mean 'pink'?" in result.stderr
    assert "Traceback" not in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_of_the_help_are_commands(name):
    app = build_app()
    assert COMMANDS[name].examples
    for example in COMMANDS[name].examples:
        app.parse_args(shlex.split(example), exit_on_error=False, print_error=False)
    assert (ROOT / "docs" / COMMANDS[name].page).is_file()


def test_options_stand_in_their_groups():
    help_text = help_all("fit")
    titles = ("─ Joint ─", "─ Log ─", "─ Film ─", "─ Fit ─", "─ Output ─")
    places = [help_text.index(title) for title in titles]
    assert places == sorted(places)
    panels = re.split(r"╭─ (\w+) ─+╮", help_text[: help_text.index("Examples:")])
    text = dict(zip(panels[1::2], panels[2::2], strict=True))
    for option, group in (
        ("--model", "Joint"),
        ("--column", "Log"),
        ("--roi", "Film"),
        ("--effect", "Fit"),
        ("--json", "Output"),
    ):
        assert [title for title in text if f"{option} " in text[title]] == [group]
    assert "husky-sysid fit monday.csv tuesday.csv --board pink" in help_text


def test_a_terminal_breaks_lines_between_words_and_a_pipe_gets_whole_ones(monkeypatch, capsys):
    words = [f"word{number}" for number in range(40)]
    for is_terminal in (True, False):
        monkeypatch.setenv("COLUMNS", "80")
        monkeypatch.setattr("sys.stdout.isatty", lambda is_terminal=is_terminal: is_terminal, raising=False)
        Printer(Common()).say(" ".join(words))
        lines = capsys.readouterr().out.splitlines()
        assert [word for line in lines for word in line.split()] == words
        assert all(len(line) <= 80 for line in lines) == is_terminal
