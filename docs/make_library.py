"""Run the cells of docs/library.md, and write their output below them.

Run:  python docs/make_library.py

A cell is a ```python block; a ```text block right below it is its output.
"""

import contextlib
import io
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
TARGET = ROOT / "docs" / "library.md"
CELL = re.compile(r"```python\n(?P<code>.*?)```\n(?:\n```text\n(?P<output>.*?)```\n)?", re.S)
LOGS = {"tip.csv": "pink_hidden.csv", "imu.csv": "pink_imu.csv", "clean.csv": "pink.csv"}
"""Logs beside the page, and their synthetic originals in data/decays."""


def page(text: str) -> str:
    """Return the page with what its cells print now, run in order in one namespace and an empty folder."""
    names: dict[str, object] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, log in LOGS.items():
            shutil.copy(ROOT / "data" / "decays" / log, Path(folder) / name)
        with contextlib.chdir(folder):
            return CELL.sub(lambda cell: _cell(cell["code"], names), text)


def _cell(code: str, names: dict[str, object]) -> str:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, str(TARGET), "exec"), names)
    lines = [line.rstrip() for line in printed.getvalue().splitlines()]
    output = "\n```text\n" + "\n".join(lines) + "\n```\n" if lines else ""
    return f"```python\n{code}```\n{output}"


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    TARGET.write_text(page(TARGET.read_text(encoding="utf-8")), encoding="utf-8")
    sys.stderr.write(f"written: {TARGET}\n")
