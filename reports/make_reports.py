"""Make the finished reports beside this file, as a user would: `python -m reports.make_reports`.

The boards are fitted to the synthetic logs of data/decays in a workspace of their own, diagnosed,
checked and reported; nothing was measured.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from sysid.errors import SysidError

HERE = Path(__file__).resolve().parent
DECAYS = HERE.parent / "data" / "decays"
STORIES = {
    "pink": (
        "fit data/decays/pink_hidden.csv --board pink",
        "diagnose data/decays/pink_hidden.csv --board pink",
        "fit data/decays/pink_hidden.csv --board pink --effect coulomb",
        "diagnose data/decays/pink_hidden.csv --board pink",
        "check data/decays/pink_hidden.csv --board pink",
    ),
    "black": (
        "fit data/decays/black.csv --board black",
        "diagnose data/decays/black.csv --board black",
        "check data/decays/black.csv --board black",
    ),
}
"""Commands before each report: one board has an effect to find, the other has none."""


def make_reports() -> None:
    """Write reports/BOARD/report.html for each story."""
    with tempfile.TemporaryDirectory() as folder:
        workspace = Path(folder)
        shutil.copytree(DECAYS, workspace / "data" / "decays")
        for board, commands in STORIES.items():
            for command in (*commands, f"report --board {board}"):
                sys.stderr.write(f"husky-sysid {command}\n")
                words = [sys.executable, "-m", "sysid.cli", *command.split()]
                done = subprocess.run(words, cwd=workspace, stdout=subprocess.DEVNULL, check=False)
                if done.returncode not in (0, 3):  # 3: the gate said no, and the report says why
                    raise SysidError(f"husky-sysid {command} ended with exit code {done.returncode}")
            target = HERE / board
            target.mkdir(exist_ok=True)
            shutil.copy(workspace / "reports" / board / "report.html", target / "report.html")


if __name__ == "__main__":
    make_reports()
