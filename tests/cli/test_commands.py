"""The command line as a whole: every command is there, usage errors exit with 2, failures with 1."""

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import husky

from sysid.cli import COMMANDS, EXIT_CODES, build_app, overview

HEAVY = set(["numpy", "pandas", "scipy", "matplotlib", "casadi", "mujoco", "av", "cv2", "rerun", "torch"])
ROOT = Path(__file__).parents[2]


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
def test_a_command_explains_itself_by_fifteen_options_and_examples_that_parse(name):
    said = husky(name, "--help")
    assert said.returncode == 0, said.stderr
    assert {"--json", "--workspace"} <= set(re.findall(r"--[a-z-]+", said.stdout))
    assert "--empty" not in said.stdout  # what cyclopts makes of a list of options; no command means it
    first, printed = options(said.stdout), io.StringIO()
    with contextlib.redirect_stdout(printed):
        build_app(everything=True)([name, "--help"], result_action="return_value", exit_on_error=False)
    every = options(printed.getvalue())
    assert set(COMMANDS[name].first.split()) & every <= first <= every
    assert len(first) <= 15
    assert COMMANDS[name].examples
    for example in COMMANDS[name].examples:
        build_app().parse_args(shlex.split(example), exit_on_error=False, print_error=False)
    assert (ROOT / "docs" / COMMANDS[name].page).is_file()


def test_command_modules_import_nothing_heavy():
    """All in one process, one after the other: whichever is the first to import something heavy is named."""
    code = "import importlib, sys\nfor name in sys.argv[1:]:\n before = set(sys.modules)\n"
    code += " importlib.import_module(f'sysid.cli.{name}')\n print(name, *set(sys.modules) - before)"
    modules = {name.replace("-", "_") for name in COMMANDS}
    names = [*sorted(modules - {"train"}), "train"]
    done = subprocess.run([sys.executable, "-c", code, *names], capture_output=True, text=True, check=True)
    lines = map(str.split, done.stdout.splitlines())
    heavy = {name: HEAVY & set(modules) - {"numpy"} for name, *modules in lines}
    assert list(heavy) == names
    # The options of `train` are the task's own, and name MuJoCo's types.
    assert heavy.pop("train") <= {"mujoco"}
    assert not {name: modules for name, modules in heavy.items() if modules}


def test_the_shell_completes_commands_and_options(tmp_path):
    command = [sys.executable, "-m", "sysid.cli", "--install-completion", "--shell", "bash"]
    home = {**os.environ, "HOME": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, env=home)
    assert done.returncode == 0, done.stderr
    script = next(path for path in tmp_path.rglob("*") if path.is_file() and "decay" in path.read_text())
    assert "--time-column" in script.read_text()
    assert subprocess.run(["bash", "-n", script]).returncode == 0


def test_unknown_command_is_a_usage_error_with_a_suggestion():
    result = husky("dcay")
    assert result.returncode == 2
    assert 'Did you mean "decay"?' in result.stderr
