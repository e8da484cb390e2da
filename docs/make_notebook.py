"""Make examples/hidden_effect.ipynb from examples/hidden_effect.py, and run it: its outputs are kept.

python docs/make_notebook.py
"""

import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import nbformat
from nbclient import NotebookClient

EXAMPLES = Path(__file__).parents[1] / "examples"
SOURCE, TARGET = EXAMPLES / "hidden_effect.py", EXAMPLES / "hidden_effect.ipynb"
CELL = re.compile(r"^# %%(?P<kind> \[markdown\])?\n(?P<body>.*?)(?=^# %%|\Z)", re.M | re.S)
PATIENCE = 600
"""Longest time that a cell may take [s]."""


def notebook() -> Any:
    """Return the script as a notebook: `# %%` begins a cell, comments of a markdown cell are its text."""
    made = nbformat.v4.new_notebook(metadata={"kernelspec": {"name": "python3", "display_name": "Python 3"}})
    for number, cell in enumerate(CELL.finditer(SOURCE.read_text(encoding="utf-8"))):
        body = cell["body"].strip()
        if cell["kind"]:
            new = nbformat.v4.new_markdown_cell(re.sub(r"^# ?", "", body, flags=re.M))
        else:
            new = nbformat.v4.new_code_cell(body)
        new["id"] = f"cell-{number}"
        made.cells.append(new)
    return made


def run(made: Any, folder: Path) -> Any:
    """Run a notebook in a folder and return it with its outputs."""
    return NotebookClient(made, timeout=PATIENCE, resources={"metadata": {"path": str(folder)}}).execute()


def main() -> None:
    """Write the notebook."""
    with TemporaryDirectory() as folder:
        made = run(notebook(), Path(folder))
    for cell in made.cells:
        cell.metadata.pop("execution", None)  # when it ran says nothing
    made.metadata["language_info"] = {"name": "python"}
    TARGET.write_text(nbformat.writes(made) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
