"""Every command that the documentation shows is run, in order, and prints what the page says.

What runs: in README.md and docs/*.md, each line of a ```console block that starts with `$ husky-sysid`, or comes to it
after setting up `.venv`. A line that ends with a backslash goes on in the next. The command must exit with 0, or with N
where the line ends with `# exit N`. A block directly under `<!-- not run: reason -->` is skipped; a reason is required.

What is quoted: lines under a command in its console block, block quotes and ```text blocks below that block. The
block's commands must print each of their lines, in that order. Wrapping and the borders of tables do not count. Numbers may
differ by a twentieth: digits behind that are the noise of a processor.

What is left behind: nothing that git would see in a clone but files that a command line names. README and tutorial
leave nothing at all outside `runs/`, which git ignores.
"""

import ast
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import jsonschema
import pytest
from command_line import husky
from quoted import missing

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


PAGES = sorted(
    {ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "SKILL.md", *(ROOT / "docs").glob("**/*.md")}
)
LINK = re.compile(r"\[(?:[^][]|\[[^]]*\])*\]\((?P<to>[^)\s]+)\)")
FENCE = re.compile(r"^```.*?^```", re.M | re.S)


def anchors(text: str) -> set[str]:
    """Return the names of a page's headings, as they are linked to."""
    headings = re.findall(r"^#+ +(.+?) *$", FENCE.sub("", text), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for match in LINK.finditer(FENCE.sub("", text)):
        path, _, anchor = match["to"].partition("#")
        if "://" in path:
            continue
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), match["to"]
        if anchor:
            assert anchor in anchors(target.read_text(encoding="utf-8")), match["to"]


def test_every_page_of_the_site_is_there() -> None:
    listed = set(re.findall(r": ([\w/-]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.M))
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").glob("**/*.md")}
    assert {"index.md", "contributing.md", "record.md"} <= listed
    assert listed <= pages | {"index.md", "contributing.md"}


@pytest.mark.slow
def test_the_site_is_built_by_one_command(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "-q", "-d", str(tmp_path)],
        cwd=ROOT, capture_output=True, text=True, check=False, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "api.html").read_text(encoding="utf-8")
    assert "from_arrays" in page
    assert "Half-width of the 95 % interval" in page
    assert "The loop" in (tmp_path / "index.html").read_text(encoding="utf-8")


def sentences() -> list[str]:
    """Return every text in the product's code; `{}` stands for what is filled in."""
    found: list[str] = []
    for file in (
        file for package in ("sysid", "sim", "policy_runtime") for file in (ROOT / package).rglob("*.py")
    ):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.JoinedStr):
                found.append(
                    "".join(part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)
                )
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    return found


def test_troubleshooting_quotes_real_messages() -> None:
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([^`]+)` \|", page, re.M)
    assert len(rows) > 15
    known = sentences()
    assert [row for row in rows if not any(row in text for text in known)] == []


@pytest.mark.slow
def test_results_are_as_the_schema_says(tmp_path: Path) -> None:
    schema = json.loads((ROOT / "docs" / "schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    log = str(ROOT / "data" / "decays" / "pink_hidden.csv")
    for command, arguments in (
        ("decay", (log,)), ("compare", (log,)), ("diagnose", (log,)), ("fit", (log, "--effect", "coulomb")),
        ("check", ()), ("mjcf", ("-o", str(tmp_path / "board.xml"))),
    ):  # fmt: skip
        result = tmp_path / f"{command}.json"
        done = husky(command, *arguments, "--board", "pink", "--workspace", tmp_path, "--json", result)
        assert done.returncode == 0, done.stderr
        jsonschema.validate(
            json.loads(result.read_text()), {"$ref": f"#/$defs/{command}", "$defs": schema["$defs"]}
        )
        assert f"| `{command}` |" in (ROOT / "docs" / "json.md").read_text()
