"""Make the pictures of the README: run the commands it shows and keep what they draw.

python docs/make_pictures.py
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs" / "pictures"
DECAYS = ROOT / "data" / "decays"


def husky(workspace: Path, *arguments: str | Path) -> None:
    """Run one command in a workspace of its own."""
    subprocess.run(
        [sys.executable, "-m", "sysid.cli", *map(str, arguments), "--workspace", str(workspace)], check=True
    )


def main() -> None:
    """Draw every picture from the synthetic decays that ship with the project."""
    PICTURES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        workspace = Path(folder)
        husky(workspace, "decay", DECAYS / "pink.csv", "--board", "pink")
        shutil.copy(workspace / "reports" / "pink" / "decay.png", PICTURES / "decay.png")


if __name__ == "__main__":
    main()
