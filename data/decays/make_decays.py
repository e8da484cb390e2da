"""Make the synthetic logs beside this script: each by one `husky-sysid synth` command.

python data/decays/make_decays.py [FOLDER]
"""

import shlex
import subprocess
import sys
from pathlib import Path

RECIPES = {
    # Several releases to both sides, an angle sensor at 500 Hz.
    "pink.csv": "--board pink --releases 4 --rate 500 --noise 0.1 --seed 1",
    # The stiff board rings twice as fast; this logger writes milliseconds and degrees.
    "black.csv": "--board black --releases 4 --rate 500 --noise 0.1 --seed 2 --dialect angle-deg",
    # A phone on the deck, 6 cm above the axis: accelerometer and gyro, no angle anywhere.
    "pink_imu.csv": "--board pink --releases 3 --rate 200 --jitter 0.1 --seed 3 --dialect phyphox "
    "--lever-arm 0.1 0.02 0.06",
    # The bushing rubs: dry friction that spring and damper cannot explain.
    "pink_hidden.csv": "--board pink --effect coulomb=0.15 --releases 3 --rate 500 --noise 0.1 --seed 4",
}
"""File and how it is made; all stay within the ±0.2 rad of the board records."""


def main() -> None:
    """Write every log and its truth."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for name in RECIPES:
        make(name, folder)


def make(name: str, folder: Path) -> None:
    """Write one log and its truth into `folder`."""
    command = ["synth", *shlex.split(RECIPES[name]), "-o", name]
    subprocess.run([sys.executable, "-m", "sysid.cli", *command], cwd=folder, check=True)


if __name__ == "__main__":
    main()
