"""Store anew what the commands give: python tests/golden/regenerate.py [PART_OF_A_CASE'S_NAME...].

`git diff tests/golden` then shows every digit that moved.
"""

import os
import sys
import tempfile
import warnings
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")
sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parents[1] / "support")]

from golden_cases import STORE, cases, machine, make_films, make_logs, run, selected, write  # noqa: E402


def main() -> None:
    """Run the cases that are asked for and store them; without any name, all, and drop what is no case."""
    warnings.simplefilter("error")
    chosen = selected(sys.argv[1:])
    here = machine()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        make_logs(folder)
        if any(case.needs == "film" for case in chosen):
            make_films(folder)
        for case in chosen:
            write(case.name, run(case, folder))
    if len(sys.argv) == 1:
        write("machine", here)
        known = {"machine", *(case.name for case in cases())}
        for path in STORE.glob("*.json"):
            if path.stem not in known:
                path.unlink()


if __name__ == "__main__":
    main()
