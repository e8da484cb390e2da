"""From when on a run rides: rides_while_learning.csv to a table, one row a run.

    python data/policies/first_rides.py

That is the first measured iteration from which on 98 % of all rides lasted 20 s, with the wrong feet down in less than 10 %
of the steps: a beginner lasts on one leg.
"""

import csv
import sys
from itertools import groupby
from pathlib import Path

SHARE, WRONG_FEET = 0.98, 0.1


def main() -> None:
    """Print the table."""
    with Path(__file__).with_name("rides_while_learning.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    lines = [
        "| run | from iteration | minutes | patience, strength | lasted since | measured until |",
        "|---" * 6 + "|",
    ]
    for run, group in groupby(rows, key=lambda row: row["policy"]):
        measured = list(group)
        last = measured[-1]
        first = next((i for i in range(len(measured)) if _rides(measured[i:])), None)
        cells = ["not yet", "", "", ""]
        if first is not None:
            since, begins = measured[first:], measured[first]
            lasted, rides = (sum(int(row[name]) for row in since) for name in ("lasted", "rides"))
            level = f"{float(begins['patience']):.0f}, {float(begins['strength']):.2f}"
            cells = [begins["iteration"], f"{float(begins['minutes']):.1f}", level, f"{lasted} of {rides}"]
        lines.append(
            f"| {run} | {' | '.join(cells)} | {last['iteration']}, {float(last['minutes']):.1f} min |"
        )
    sys.stdout.write("\n".join(lines) + "\n")


def _rides(rows: list[dict[str, str]]) -> bool:
    lasted, rides = (sum(int(row[name]) for row in rows) for name in ("lasted", "rides"))
    return lasted >= SHARE * rides and all(float(row["E_contact"]) < WRONG_FEET for row in rows)


if __name__ == "__main__":
    main()
