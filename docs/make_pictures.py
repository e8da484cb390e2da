"""Make the pictures of README.md, docs/tutorial.md and docs/intervals.md by the commands that they show.

python docs/make_pictures.py
"""

import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from reports.figures.intervals import interval_figure
from sysid.board import load_board
from sysid.fitting.bootstrap import bootstrap
from sysid.fitting.joint import fit_joint
from sysid.fitting.profile import profiles
from sysid.recording import Recording

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs" / "pictures"
CLEAN, HIDDEN = (ROOT / "data" / "decays" / f"{name}.csv" for name in ("pink", "pink_hidden"))
STEPS = (
    ("decay", CLEAN, (), "decay", "decay"),
    ("compare", HIDDEN, (), "compare", "tutorial_before"),
    ("diagnose", HIDDEN, (), "diagnose", "tutorial_story"),
    ("fit", HIDDEN, ("--effect", "coulomb"), "ladder", "tutorial_ladder"),
    ("compare", HIDDEN, (), "compare", "tutorial_after"),
)
"""Command, log and options, the picture that it draws, and its name in the docs; in one workspace, in this order."""


def by_commands() -> None:
    """Run the commands and keep their pictures."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        for command, log, options, drawn, kept in STEPS:
            shutil.copy(log, folder)
            words = [sys.executable, "-m", "sysid.cli", command, log.name, "--board", "pink", *options]
            subprocess.run(words, cwd=folder, check=True, capture_output=True)
            shutil.copy(folder / "reports" / "pink" / f"{drawn}.png", PICTURES / f"{kept}.png")


def of_intervals() -> None:
    """Draw three intervals of each parameter of the hidden friction."""
    board = load_board(ROOT / "data" / "boards" / "pink.toml")
    fit = fit_joint(Recording.read(HIDDEN).releases, board, ["coulomb"])
    title = "pink, with dry friction: how far each parameter can move while the others follow"
    figure = interval_figure(fit.quantities, list(profiles(fit, board)), bootstrap(fit, board, 1000), title)
    figure.savefig(PICTURES / "intervals.png", dpi=110)


if __name__ == "__main__":
    by_commands()
    of_intervals()
