"""Join the learning curves of stages, each begun with `--from` a checkpoint of the one before, to one table.

    python data/policies/join_curves.py STAGE [STAGE ...] OUT.csv [--first N] [--every N]

A stage is a run's folder or a table that this script wrote. Each takes over where its iterations begin, and its steps of
the world are counted on from there. With --first, what was before iteration N is left out; with --every, all but each N-th
iteration. Columns that a stage did not have are nan, and so is a row that stands for iterations of which nothing is kept.
"""

import argparse
import csv
import math
from itertools import pairwise
from pathlib import Path
from statistics import median

from policy_runtime.learning.run_folder import RunFolder

COLUMNS = (
    "iteration", "samples", "survival", "falls_per_minute", "speed_error", "heading_error", "both_feet", "foot_down",
    "stride_period", "stance_time", "foot_travel", "slip", "stops", "reward", "style", "steps_per_s", "collect_s", "learn_s", "action_std", "patience", "strength",
)  # fmt: skip


def main() -> None:
    """Read the stages and write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", type=Path, nargs="+", help="one or more stages, and the table to write")
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--every", type=int, default=1)
    options = parser.parse_args()
    *stages, target = options.files
    rows: list[dict[str, float]] = []
    for stage in stages:
        new = _read(stage)
        rows = [row for row in rows if row["iteration"] < new[0]["iteration"]]
        if rows:  # checkpoints have not always held the count
            an_iteration = (new[1]["samples"] - new[0]["samples"]) / (
                new[1]["iteration"] - new[0]["iteration"]
            )
            gap = new[0]["iteration"] - rows[-1]["iteration"]
            shift = rows[-1]["samples"] + an_iteration * gap - new[0]["samples"]
            new = [row | {"samples": row["samples"] + shift} for row in new]
        rows += new
    with target.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        table.writeheader()
        kept = [
            row for row in rows if row["iteration"] >= options.first and not row["iteration"] % options.every
        ]
        for row in sorted(kept + _gaps(kept), key=lambda row: row["iteration"]):
            whole = {name: f"{row[name]:.0f}" for name in ("iteration", "samples")}
            table.writerow({name: f"{row.get(name, math.nan):.6g}" for name in COLUMNS} | whole)


def _gaps(rows: list[dict[str, float]]) -> list[dict[str, float]]:
    """Return a row for each gap that is far longer than the step between rows: no line is to be drawn over it."""
    places = [{name: row[name] for name in ("iteration", "samples")} for row in rows]
    usual = median(b["iteration"] - a["iteration"] for a, b in pairwise(places))
    return [
        {name: round((a[name] + b[name]) / 2) for name in a}
        for a, b in pairwise(places)
        if b["iteration"] - a["iteration"] > 10 * usual
    ]


def _read(path: Path) -> list[dict[str, float]]:
    if path.is_dir():
        return RunFolder(path).read_curves()
    with path.open(encoding="utf-8") as file:
        rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    return [row for row in rows if not math.isnan(row["survival"])]


if __name__ == "__main__":
    main()
