"""Make the pictures of docs/tutorial.md by its own commands, in a separate workspace.

python docs/make_tutorial_pictures.py
"""

import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
LOG = ROOT / "data" / "decays" / "pink_hidden.csv"


def run(folder: Path, *arguments: str) -> None:
    """Run one command of the tool in a workspace."""
    log = shutil.copy(LOG, folder / LOG.name)
    command, *options = arguments
    subprocess.run(
        [sys.executable, "-m", "sysid.cli", command, Path(log).name, "--board", "pink", *options],
        cwd=folder, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def main() -> None:
    """Compare, diagnose, fit, compare again, and keep the pictures."""
    pictures = ROOT / "docs" / "pictures"
    pictures.mkdir(exist_ok=True)
    with TemporaryDirectory() as name:
        folder = Path(name)
        reports = folder / "reports" / "pink"
        run(folder, "compare")
        shutil.copy(reports / "compare.png", pictures / "tutorial_before.png")
        run(folder, "diagnose")
        shutil.copy(reports / "diagnose.png", pictures / "tutorial_story.png")
        run(folder, "fit", "--effect", "coulomb")
        shutil.copy(reports / "ladder.png", pictures / "tutorial_ladder.png")
        run(folder, "compare")
        shutil.copy(reports / "compare.png", pictures / "tutorial_after.png")


if __name__ == "__main__":
    main()
