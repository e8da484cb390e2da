"""Every command that the documentation shows is run, in order, and prints what the page says.

What runs: in README.md and docs/*.md, each line of a ```console block that starts with `$ husky-sysid`, or comes to it
after setting up `.venv`. A line that ends with a backslash goes on in the next. The command must exit with 0, or with N
where the line ends with `# exit N`. A block directly under `<!-- not run: reason -->` is skipped; a reason is required.

What is quoted: lines under a command in its console block, block quotes and ```text blocks below that block. Each of
their lines must be in what the block's commands printed, in that order; how lines are wrapped and how tables are drawn
does not count.

What is left behind: nothing that git would see in a clone but files that a command line names. README and tutorial
leave nothing at all outside `runs/`, which git ignores.
"""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FIRST = (ROOT / "README.md", ROOT / "docs" / "tutorial.md")
"""What a reader does first, one after the other in one clone."""
OTHERS = sorted({*(ROOT / "docs").glob("**/*.md")} - {*FIRST})
BLOCK = re.compile(
    r"^(?P<skip><!-- not run: (?P<reason>[^\n]*?) *-->\n)?```console\n(?P<body>.*?)^```", re.M | re.S
)
QUOTE = re.compile(r"^```text\n(?P<text>.*?)^```|^(?P<quote>(?:>[^\n]*\n)+)", re.M | re.S)
COMMAND = re.compile(r"^\$ (?:.* && \.venv/bin/)?(?P<command>husky-sysid.*?)(?:\s+# exit (?P<exit>\d+))?\s*$")
TIMEOUT = 300


@dataclass(frozen=True)
class Command:
    line: int
    text: str
    exit_code: int


@dataclass(frozen=True)
class Block:
    """Commands, and what the page quotes of their output."""

    commands: tuple[Command, ...]
    quoted: tuple[str, ...]


def blocks(text: str) -> list[Block]:
    """Return the console blocks of a document with what is quoted up to the next one."""
    found = []
    for match, following in pairwise([*BLOCK.finditer(text), None]):
        if match["skip"]:
            assert match["reason"].strip(), "'not run' needs a reason"
            continue
        commands, printed = _commands(match["body"], text[: match.start("body")].count("\n") + 1)
        below = text[match.end() : following.start() if following else None]
        quotes = (
            quote["text"] or re.sub("^> ?", "", quote["quote"], flags=re.M) for quote in QUOTE.finditer(below)
        )
        under = [line for quote in quotes for line in quote.splitlines()]
        found.append(Block(tuple(commands), (*printed, *under)))
    return found


def _commands(body: str, first: int) -> tuple[list[Command], list[str]]:
    """Return the commands of a block that begins in line `first`, and the lines under them."""
    found: list[Command] = []
    printed: list[str] = []
    ours = False
    lines = body.splitlines()
    while lines:
        line, number = lines.pop(0), first
        first += 1
        while line.endswith("\\") and lines:
            line = line[:-1] + lines.pop(0)
            first += 1
        match = COMMAND.match(line)
        if match:
            found.append(Command(number, match["command"], int(match["exit"] or 0)))
        elif ours and not line.startswith("$ "):
            printed.append(line)
        if line.startswith("$ "):
            ours = match is not None
    return found, printed


def clone(folder: Path) -> Path:
    """What a fresh clone offers, with nothing that a command could spoil."""
    shutil.copytree(ROOT / "data" / "decays", folder / "data" / "decays")
    shutil.copytree(ROOT / "docs" / "examples", folder / "docs" / "examples")
    return folder


def run(command: Command, folder: Path) -> subprocess.CompletedProcess[str]:
    script = f'husky-sysid() {{ "$HUSKY_PYTHON" -m sysid.cli "$@"; }}\n{command.text}'
    return subprocess.run(
        ["bash", "-o", "pipefail", "-c", script],
        capture_output=True, text=True, cwd=folder, timeout=TIMEOUT, check=False,
        env={**os.environ, "HUSKY_PYTHON": sys.executable, "COLUMNS": "160"},
    )  # fmt: skip


def plain(text: str) -> str:
    """Return the words of a text without what draws tables, and without Markdown's rules between their rows."""
    return " ".join(re.sub(r"[│┃|]|-{3,}", " ", text).split())


def missing(quoted: tuple[str, ...], printed: str) -> list[str]:
    """Return the quoted lines that are not in what was printed, each looked for after the one before."""
    printed, lost = plain(printed), []
    for line in filter(None, map(plain, quoted)):
        before, found, after = printed.partition(line)
        printed = after if found else before
        if not found:
            lost.append(line)
    return lost


def files(folder: Path) -> dict[Path, bytes]:
    """Return what git would see in a clone: path and content of every file outside `runs`."""
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {
        path.relative_to(folder): path.read_bytes()
        for path in paths
        if path.relative_to(folder).parts[0] != "runs"
    }


def faults(text: str, folder: Path, *, named: bool = True) -> list[str]:
    """Run a document's commands and return what went otherwise than it says.

    Args:
        text: The document.
        folder: The clone.
        named: Whether files that a command line names may be written.
    """
    found = []
    for block in blocks(text):
        printed = ""
        for command in block.commands:
            before = files(folder)
            result = run(command, folder)
            printed += result.stdout + result.stderr
            if result.returncode != command.exit_code:
                found.append(
                    f"line {command.line}: {command.text}\n  exit {result.returncode}, expected {command.exit_code}\n"
                    f"{result.stderr}"
                )
            for path in sorted(dict(files(folder).items() - before.items())):
                # A log comes with its truth: `log.csv` with `log.truth.json`.
                if path in before or not (named and f" {path.name.split('.')[0]}." in command.text):
                    found.append(f"line {command.line}: {command.text}\n  writes {path}")
        if lost := missing(block.quoted, printed):
            found.append(f"line {block.commands[0].line}: quoted but not printed:\n  " + "\n  ".join(lost))
    return found


@pytest.mark.slow
def test_readme_then_tutorial_in_a_clone(tmp_path: Path) -> None:
    clone(tmp_path)
    for document in FIRST:
        found = faults(document.read_text(encoding="utf-8"), tmp_path, named=False)
        assert not found, f"{document.name}\n" + "\n".join(found)


@pytest.mark.slow
@pytest.mark.parametrize("document", OTHERS, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_of_the_documentation_work(document: Path, tmp_path: Path) -> None:
    found = faults(document.read_text(encoding="utf-8"), clone(tmp_path))
    assert not found, "\n".join(found)


SAMPLE = """\
Text.
```console
$ husky-sysid boards --json - \\
    | grep pink
"board": "pink",
$ ls
table
$ husky-sysid boards nobody  # exit 1
```
> | unknown board |
> |---|
> 'nobody'
```bash
$ husky-sysid nothing
```
<!-- not run: takes twenty hours -->
```console
$ husky-sysid train
```
```console
$ python3 -m venv .venv && .venv/bin/pip install -e . && .venv/bin/husky-sysid boards > runs/boards.txt
```
"""


def test_which_lines_are_commands() -> None:
    assert blocks(SAMPLE) == [
        Block(
            (
                Command(3, "husky-sysid boards --json -     | grep pink", 0),
                Command(8, "husky-sysid boards nobody", 1),
            ),
            ('"board": "pink",', "| unknown board |", "|---|", "'nobody'"),
        ),
        Block((Command(21, "husky-sysid boards > runs/boards.txt", 0),), ()),
    ]
    with pytest.raises(AssertionError, match="needs a reason"):
        blocks("<!-- not run:  -->\n```console\n$ husky-sysid boards\n```\n")


@pytest.mark.slow
def test_the_runner_can_fail(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    assert faults(SAMPLE, tmp_path) == []
    wrong = SAMPLE
    for right, other in (
        ("grep pink", "grep purple"),
        ("# exit 1", ""),
        ("unknown board |\n> |---|\n> 'nobody'", "'nobody' |\n> |---|\n> unknown board"),
        ("runs/boards.txt", "boards.txt"),
    ):
        assert right in wrong
        wrong = wrong.replace(right, other)
    first, second, quotes, file = faults(wrong, tmp_path, named=False)
    assert first.startswith("line 3: ")
    assert "exit 1, expected 0" in first
    assert second.startswith("line 8: ")
    assert quotes == 'line 3: quoted but not printed:\n  "board": "pink",\n  unknown board'
    assert file.startswith("line 21: ")
    assert file.endswith("writes boards.txt")
    (tmp_path / "boards.txt").unlink()
    assert "boards.txt" not in "".join(faults(wrong, tmp_path))
