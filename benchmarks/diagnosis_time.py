"""What a diagnosis costs: logs of the hidden-effect suite at two rates, and ten minutes of two kinds.

    python benchmarks/diagnosis_time.py

Processor time of one process. Two processes share the search; what is learned in the end is work for one.
"""

import platform
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from hidden_truths import TRUTHS, board_of, make
from pages import table, write_result

from sysid.board import Board, load_board
from sysid.diagnosis.diagnose import diagnose
from sysid.logs import read_roll
from sysid.quantity import Quantity
from sysid.releases import find_releases
from sysid.roll import Release
from sysid.synth import SynthOptions, synthesise

CASES = ("coulomb 0.1", "damper on one side")
RATES = (125.0, 1000.0)
MINUTES = 10.0
SEED = 5


def row(what: str, samples: int, releases: Sequence[Release], board: Board, begin: float) -> tuple[str, ...]:
    v = diagnose(releases, board).verdict
    said = " + ".join(v.effects) or v.status
    cells = what, f"{samples}", f"{len(releases)}", f"{time.process_time() - begin:.1f}", said
    print(*cells, sep=" | ", flush=True)
    return cells


def long_log(folder: Path, board: Board, rate: float, releases: int) -> Path:
    """Write ten minutes of a board with dry friction."""
    each = 60 * MINUTES / releases
    angles = tuple(float(a) for a in np.linspace(0.19, 0.06, releases) * (-1.0) ** np.arange(releases))
    options = SynthOptions(angles=angles, rate=rate, duration=each - 2.0, push=1.0, hold=1.0, seed=SEED)
    path = folder / f"long-{rate:.0f}-{releases}.csv"
    synthesise(board, {"coulomb": (0.02,)}, options).save(path)
    return path


def main() -> None:
    np.seterr(all="ignore")
    pink = load_board(Path(__file__).parents[1] / "data/boards/pink.toml")
    free = pink.with_tilt(damping=Quantity(2e-4, 1e-6, "N*m*s/rad"))
    rows: list[tuple[str, ...]] = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        for truth in (t for t in TRUTHS if t.name in CASES):
            for rate in RATES:
                made = make(replace(truth, rates=(rate,), noises=(0.1,)), SEED, folder)
                samples, board = sum(len(r.time) for r in made), board_of(truth)
                rows.append(
                    row(f"{truth.name}, 6 s at {rate:.0f} Hz", samples, made, board, time.process_time())
                )
        for board, rate, count in ((pink, 200.0, 60), (pink, 1000.0, 60), (free, 200.0, 1)):
            log = long_log(folder, board, rate, count)
            begin = time.process_time()  # reading it too
            roll = read_roll(log)
            what = f"friction, {MINUTES:.0f} min at {rate:.0f} Hz"
            rows.append(row(what, len(roll.time), find_releases(roll), board, begin))
    write_result(
        "diagnosis_time.md",
        "# Time of a diagnosis\n\n"
        f"Processor time of one process on a busy machine, Python {platform.python_version()}; made by `benchmarks/diagnosis_time.py`.\n\n"
        + table(("log", "samples", "releases", "s", "verdict"), rows),
    )


if __name__ == "__main__":
    main()
