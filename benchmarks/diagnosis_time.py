"""What a diagnosis costs: logs of the hidden-effect suite at several rates, ten minutes of two kinds, and any logs that are given.

    python benchmarks/diagnosis_time.py [LOG.csv...]

Processor time of one process, from the file to the verdict: wall time on two idle cores is 0.6 of it, if nothing has to be
learned in the end, which takes a process of its own.
"""

import platform
import sys
import time
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
from hidden_truths import TRUTHS, board_of, make

from sysid.board import Board, load_board
from sysid.diagnosis.diagnose import diagnose
from sysid.logs import read_roll
from sysid.quantity import Quantity
from sysid.releases import find_releases
from sysid.synth import SynthOptions, synthesise

RESULT = Path(__file__).parent / "results" / "diagnosis_time.md"
CASES = ("coulomb 0.1", "damper on one side")
RATES = (125.0, 1000.0)
MINUTES = 10.0
SLOWEST = 5
SEED = 5


def row(what: str, log: Path, board: Board) -> tuple[float, str]:
    begin = time.process_time()
    roll = read_roll(log)
    releases = find_releases(roll)
    result = diagnose(releases, board)
    took = time.process_time() - begin
    v = result.verdict
    line = (
        f"| {what} | {len(roll.time)} | {len(releases)} | {took:.1f} | {' + '.join(v.effects) or v.status} |"
    )
    print(line, flush=True)
    return took, line


def long_log(folder: Path, board: Board, rate: float, releases: int) -> Path:
    """Write ten minutes of a board with dry friction."""
    each = 60 * MINUTES / releases
    angles = tuple(float(a) for a in np.linspace(0.19, 0.06, releases) * (-1.0) ** np.arange(releases))
    options = SynthOptions(angles=angles, rate=rate, duration=each - 2.0, push=1.0, hold=1.0, seed=SEED)
    path = folder / f"long-{rate:.0f}-{releases}.csv"
    synthesise(board, {"coulomb": (0.02 / releases**0.5,)}, options).save(path)
    return path


def main() -> None:
    np.seterr(all="ignore")
    pink = load_board(Path(__file__).parents[1] / "data/boards/pink.toml")
    free = pink.with_tilt(damping=Quantity(2e-4, 1e-6, "N*m*s/rad"))
    rows: list[str] = []
    given: list[tuple[float, str]] = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        truths = [next(t for t in TRUTHS if t.name == case) for case in CASES]
        for truth in truths:
            for rate in RATES:
                made = make(replace(truth, rates=(rate,), noises=(0.1,)), SEED, folder)
                begin = time.process_time()
                v = diagnose(made, board_of(truth)).verdict
                took, said = time.process_time() - begin, " + ".join(v.effects) or v.status
                rows.append(
                    f"| {truth.name}, 6 s at {rate:.0f} Hz | {sum(len(r.time) for r in made)} | 3 | {took:.1f} | {said} |"
                )
                print(rows[-1], flush=True)
        for board, rate, releases in ((pink, 200.0, 60), (pink, 1000.0, 60), (free, 200.0, 1)):
            what = f"friction, {MINUTES:.0f} min at {rate:.0f} Hz"
            rows.append(row(what, long_log(folder, board, rate, releases), board)[1])
    for log in map(Path, sys.argv[1:]):
        given.append(row(f"{log.parent.name}/{log.stem}", log, pink))
    head = ["| log | samples | releases | s | verdict |", "|---|---|---|---|---|"]
    lines = [
        "# Time of a diagnosis", "",
        f"Processor time of one process on a busy machine, Python {platform.python_version()}; made by `benchmarks/diagnosis_time.py`. ",
        "", *head, *rows,
    ]  # fmt: skip
    if given:
        times = [took for took, _ in given]
        lines += [
            "", f"{len(given)} logs of other hands: median {median(times):.1f} s, at most {max(times):.1f} s. The slowest:", "",
            *head, *(line for _, line in sorted(given, reverse=True)[:SLOWEST]),
        ]  # fmt: skip
    RESULT.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
