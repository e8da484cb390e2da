"""Every command that the documentation shows is run: in order, in one workspace a document.

What runs: in README.md and docs/*.md, each line of a ```console block that starts with `$ husky-sysid`. A line
that ends with a backslash goes on in the next. The command must exit with 0, or with N where the line ends
with `# exit N`. A block directly under `<!-- not run: reason -->` is skipped; a reason is required.
"""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))]
BLOCK = re.compile(
    r"^(?P<skip><!-- not run: (?P<reason>[^\n]*?) *-->\n)?```console\n(?P<body>.*?)^```", re.M | re.S
)
EXIT = re.compile(r"\s+# exit (\d+)\s*$")
TIMEOUT = 300


@dataclass(frozen=True)
class Command:
    line: int
    text: str
    exit_code: int


def commands(text: str) -> list[Command]:
    """Return the commands of a document, in order."""
    found = []
    for block in BLOCK.finditer(text):
        if block["skip"]:
            assert block["reason"].strip(), "'not run' needs a reason"
            continue
        first = text[: block.start("body")].count("\n") + 1
        lines = block["body"].splitlines()
        while lines:
            line, number = lines.pop(0), first
            first += 1
            while line.endswith("\\") and lines:
                line = line[:-1] + lines.pop(0)
                first += 1
            if not line.startswith("$ husky-sysid"):
                continue
            expected = EXIT.search(line)
            found.append(Command(number, EXIT.sub("", line)[2:], int(expected[1]) if expected else 0))
    return found


def workspace(folder: Path) -> Path:
    """What a fresh clone offers, with nothing that a command could spoil: data, but no outputs."""
    (folder / "data").mkdir()
    for part in (ROOT / "data").iterdir():
        if part.name == "decays":
            shutil.copytree(part, folder / "data" / part.name)
        elif part.name != "boards" and part.is_dir():
            (folder / "data" / part.name).symlink_to(part)
    (folder / "docs").mkdir()
    (folder / "docs" / "examples").symlink_to(ROOT / "docs" / "examples")
    return folder


def run(command: Command, folder: Path) -> subprocess.CompletedProcess[str]:
    script = f'husky-sysid() {{ "$HUSKY_PYTHON" -m sysid.cli "$@"; }}\n{command.text}'
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", script],
        capture_output=True, text=True, cwd=folder, timeout=TIMEOUT, check=False,
        env={**os.environ, "HUSKY_PYTHON": sys.executable, "COLUMNS": "160"},
    )  # fmt: skip


def faults(text: str, folder: Path) -> list[str]:
    """Run a document's commands and return what went otherwise than it says."""
    found = []
    for command in commands(text):
        result = run(command, folder)
        if result.returncode != command.exit_code:
            found.append(
                f"line {command.line}: {command.text}\n  exit {result.returncode}, expected {command.exit_code}\n"
                f"{result.stderr}"
            )
    return found


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_of_the_documentation_work(document: Path, tmp_path: Path) -> None:
    found = faults(document.read_text(encoding="utf-8"), workspace(tmp_path))
    assert not found, "\n".join(found)


SAMPLE = """\
Text.
```console
$ husky-sysid boards --json - \\
    | grep -q pink
$ ls
table
$ husky-sysid boards nobody  # exit 1
```
```bash
$ husky-sysid nothing
```
<!-- not run: takes twenty hours -->
```console
$ husky-sysid train
```
"""


def test_which_lines_are_commands() -> None:
    assert commands(SAMPLE) == [
        Command(3, "husky-sysid boards --json -     | grep -q pink", 0),
        Command(7, "husky-sysid boards nobody", 1),
    ]
    with pytest.raises(AssertionError, match="needs a reason"):
        commands("<!-- not run:  -->\n```console\n$ husky-sysid boards\n```\n")


def test_the_runner_can_fail(tmp_path: Path) -> None:
    assert faults(SAMPLE, tmp_path) == []
    assert len(faults(SAMPLE.replace("# exit 1", ""), tmp_path)) == 1
    assert len(faults(SAMPLE.replace("-q pink", "-q purple"), tmp_path)) == 1
