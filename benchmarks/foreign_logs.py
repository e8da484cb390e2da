"""Logs that nobody here made: does `diagnose` name the family, and at what confidence?

    python benchmarks/foreign_logs.py ../shared/foreign_logs --board pink

A folder with a truth.json holds logs of one board with what is hidden in each. It may be absent: then nothing is run.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from suite import command_line

from sysid.board import load_board
from sysid.diagnosis.diagnose import Diagnosis, diagnose
from sysid.effects import catalogue
from sysid.recording import Recording

ROOT = Path(__file__).parents[1]


def kinds(effects: Iterable[str]) -> frozenset[str]:
    """Return the families of effects; what is none of the catalogue ('unknown') stands for itself."""
    known = catalogue()
    return frozenset(known[name].family if name in known else name for name in effects)


def verdicts(result: Diagnosis) -> list[frozenset[str]]:
    """Return the set of families that is named, and those said to look the same."""
    verdict = result.verdict
    if verdict.status == "unexplained":
        return [frozenset({"unknown"})]
    if verdict.status == "none-missing":
        return [frozenset()]
    return [kinds(verdict.effects), *map(kinds, verdict.indistinguishable_from)]


def line(name: str, result: Diagnosis, right: bool, expected: str, cpu: float) -> str:
    v = result.verdict
    said = ", ".join(v.effects) or v.status
    alike = (
        " ~ " + "; ".join(",".join(g) for g in v.indistinguishable_from) if v.indistinguishable_from else ""
    )
    return (
        f"{'ok ' if right else 'BAD'} {name:34s} {expected:24s} {said}{alike} | confidence {v.confidence:.2f} | error/noise "
        f"{result.baseline.rmse / result.noise.std:.2f} -> {result.best.rmse / result.noise.std:.3f} | explained {result.explained:.2f} | {cpu:.1f} s CPU"
    )


def foreign(folder: Path, board_name: str, only: str, part: slice) -> None:
    board = load_board(ROOT / f"data/boards/{board_name}.toml")
    truths = json.loads((folder / "truth.json").read_text())
    hits, times = 0, list[float]()
    for name, truth in list(truths.items())[part]:
        if only not in name:
            continue
        begin = time.process_time()
        result = diagnose(Recording.read(folder / f"{name}.csv"), board)
        wanted = {kinds(group) for group in (truth["effects"], *truth["also"])}
        right = bool(wanted & set(verdicts(result)))
        hits += right
        times.append(time.process_time() - begin)
        print(line(name, result, right, ",".join(truth["effects"]) or "-", times[-1]), flush=True)
    if times:
        print(
            f"{hits} of {len(times)} right; s CPU: {np.median(times):.1f} in the median, {max(times):.1f} at most"
        )


def options_of(description: str | None, option: str = "", **more: Any) -> argparse.Namespace:
    """Read the command line of a benchmark on a folder of logs, with one option more if named; end where there is no such folder."""
    parser = command_line(description)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--board", default="pink")
    parser.add_argument("--only", default="", help="part of the name")
    if option:
        parser.add_argument(option, **more)
    options = parser.parse_args()
    if not options.folder.exists():
        print(f"{options.folder}: absent, nothing to run")
        sys.exit(0)
    np.seterr(all="ignore")
    return options


def main() -> None:
    options = options_of(__doc__, "--part", default="0/1", help="i/n: every n-th log from the i-th on")
    first, step = map(int, options.part.split("/"))
    foreign(options.folder, options.board, options.only, slice(first, None, step))


if __name__ == "__main__":
    main()
