"""What the rows of the random suite say: how often the verdict is right, and whether its confidence is deserved.

    python benchmarks/random_suite.py --seeds 0:2000 --processes 14 --out rows.jsonl
    python benchmarks/reliability.py rows.jsonl --write docs/diagnosis.md --picture docs/pictures/reliability.png

Of every twenty seeds the first ten may shape `CALIBRATION` in `sysid/diagnosis/judgement.py`, whose figures it prints; diagram and
table of the confidence are of the others only.
"""

import json
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from hidden_truths import VISIBLE
from pages import table, write_between
from suite import Row, command_line
from sysid.diagnosis.importance import ENERGY, SIGNAL, TORQUE
from sysid.diagnosis.judgement import CALIBRATION, calibrated, log_odds

OTHERWISE = {"rest", "drift", "lowpass", "clock", "inertia"}
"""Families that are no torque: their strength is what they change."""
EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)
"""Of the diagram's bins of confidence."""


def right(row: Row) -> bool:
    """Return whether the verdict names the hidden families, or a set of look-alikes that does."""
    if row["kind"] == "outside" or row["status"] == "unexplained":
        return row["kind"] == "outside" and row["status"] == "unexplained"
    said = [row["said"], *row["alike"]] if row["status"] == "missing" else [[]]
    return any(set(group) == set(row["families"]) for group in said)


def shows(row: Row) -> bool:
    """Return whether what is hidden matters and the log holds all of it."""
    if row["visible"] < VISIBLE or row.get("missed", np.inf) < VISIBLE:
        return False
    if set(row["families"]) & OTHERWISE:
        return row["signal_share"] >= SIGNAL
    return row["torque_share"] >= TORQUE or row["energy_share"] >= ENERGY


def answered(row: Row) -> bool:
    """Return whether the verdict is right, or silent about what is too weak, or what is too weak beside what it names."""
    silent = row["status"] == "none-missing" or row.get("missed", np.inf) < VISIBLE
    return right(row) or (row["kind"] != "clean" and not shows(row) and silent)


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson 1927)."""
    if not count:
        return 0.0, 1.0
    z, share = 1.96, hits / count
    middle, half = (
        share + z * z / (2 * count),
        z * np.sqrt(share * (1 - share) / count + z * z / (4 * count**2)),
    )
    return float(max(middle - half, 0.0) / (1 + z * z / count)), float((middle + half) / (1 + z * z / count))


def rate(rows: Sequence[Row], hit: Any) -> tuple[str, str, str]:
    """Return 'hits of count', the share, and its interval."""
    hits = sum(map(hit, rows))
    low, high = wilson(hits, len(rows))
    return f"{hits} of {len(rows)}", f"{hits / max(len(rows), 1):.1%}", f"{low:.1%} to {high:.1%}"


def evidence(rows: Sequence[Row]) -> Any:
    """Return the confidence of verdicts before the calibration that the rows were made with."""
    slope, offset = np.array([row["calibration"] for row in rows]).reshape(-1, 2).T
    return 1 / (1 + np.exp((offset - log_odds(np.array([row["confidence"] for row in rows]))) / slope))


def calibration(rows: Sequence[Row]) -> tuple[float, float]:
    """Return slope and offset by which the log odds of the evidence must be changed to be deserved (Platt 1999)."""
    from scipy.optimize import minimize

    odds, hits = log_odds(evidence(rows)), np.array([answered(row) for row in rows])

    def cost(point: Any) -> float:
        value = point[0] * odds + point[1]
        return float(np.sum(np.logaddexp(0, value) - hits * value) + 0.05 * np.sum((point - (1.0, 0.0)) ** 2))

    slope, offset = minimize(cost, (1.0, 0.0)).x
    return float(slope), float(offset)


def bins(confidence: Any, hits: Any) -> list[tuple[float, int, int]]:
    """Return mean confidence, hits and count of each bin that is not empty."""
    found: list[tuple[float, int, int]] = []
    for low, high in pairwise(EDGES):
        inside = (confidence >= low) & ((confidence < high) | (high == 1.0))
        if inside.any():
            found.append((float(confidence[inside].mean()), int(hits[inside].sum()), int(inside.sum())))
    return found


def report(rows: Sequence[Row]) -> str:
    """Return the tables as Markdown; of clean logs and those of one kind all are counted, for confidence every second."""
    made = [row for row in rows if row["status"] != "void"]
    read = [row for row in made if row["status"] != "error"]
    groups: dict[str, tuple[list[Row], Any]] = {}
    for name, hand in HANDS.items():
        mine = [row for row in read if hand(row)]
        inside = [row for row in mine if row["kind"] == "inside"]
        groups |= {
            f"families right, {name}": ([row for row in inside if shows(row)], right),
            f"too weak: nothing or the family said, {name}": ([r for r in inside if not shows(r)], answered),
            f"false alarms, {name}": ([r for r in mine if r["kind"] == "clean"], lambda row: not right(row)),
            f"unexplained outside, {name}": ([r for r in mine if r["kind"] == "outside" and shows(r)], right),
        }
    seconds = [row["seconds"] for row in read]
    shares = [(name, *rate(group, hit)) for name, (group, hit) in groups.items() if group]
    kinds: list[tuple[str, ...]] = []
    for truth in sorted({row["truth"] for row in read}):
        mine = [row for row in read if row["truth"] == truth and (row["kind"] == "clean" or shows(row))]
        wrong = Counter(
            " + ".join(row["said"]) if row["status"] == "missing" else row["status"]
            for row in mine
            if not right(row)
        )
        most = "; ".join(f"{n} x {said}" for said, n in wrong.most_common(3))
        kinds.append((truth, f"{sum(map(right, mine))} of {len(mine)}", most))
    return "\n\n".join(
        (
            f"{len(made)} logs, {len(made) - len(read)} of them refused; {np.median(seconds):.0f} s in the median.",
            table(("", "logs", "share", "95 %"), shares),
            table(("hidden", "families right (those that show)", "where they are not"), kinds),
            *(reliability([row for row in read if HANDS[name](row)], name) for name in SHOWN),
        )
    )


def shaping(row: Row) -> bool:
    """Return whether a seed is of the half that may shape the calibration."""
    return row["seed"] // 10 % 2 == 0


def reliability(rows: Sequence[Row], name: str) -> str:
    """Return the table of confidence and what it deserves, of the seeds that did not shape the calibration."""
    before, after, hits = judged(rows)
    cells = [
        [cell for c in pair for cell in ((f"{c[0]:.2f}", f"{c[1]} of {c[2]}") if c else ("", ""))]
        for pair in zip_longest(bins(after, hits), bins(before, hits))
    ]
    head = (f"confidence, {name}", "right", "before calibration", "right")
    scores = f"Brier score {brier(after, hits):.3f}, before calibration {brier(before, hits):.3f}."
    return f"{table(head, cells)}\n\n{balance(after, hits)}. {scores}"


def balance(confidence: Any, hits: Any) -> str:
    """Return how many verdicts are right, and how many their confidences promise, with the standard deviation of that if they are deserved."""
    spread = np.sqrt(np.sum(confidence * (1 - confidence)))
    return f"{np.sum(hits)} of {len(hits)} right, {np.sum(confidence):.0f} ± {spread:.0f} promised"


def judged(rows: Sequence[Row]) -> tuple[Any, Any, Any]:
    """Return confidence before and after the calibration of today, and hits, of the seeds that did not shape it."""
    shown = [row for row in rows if not shaping(row)]
    slope, offset = np.array([CALIBRATION[row["status"]] for row in shown]).reshape(-1, 2).T
    before = evidence(shown)
    return before, calibrated(before, slope, offset), np.array([answered(row) for row in shown])


HANDS = {
    "all": lambda row: True,
    "held still and left alone": lambda row: not row["caught"] and not row["pushed"],
    "caught": lambda row: row["caught"] and not row["pushed"],
    "pushed": lambda row: row["pushed"],
}
SHOWN = ("all", "held still and left alone")


def brier(confidence: Any, hits: Any) -> float:
    return float(np.mean((confidence - hits) ** 2))


def picture(rows: Sequence[Row], path: Path) -> None:
    """Draw the share of verdicts that is right against their confidence."""
    from reports.figures.palette import REAL, SIM
    from reports.figures.style import styled

    read = [row for row in rows if row["status"] not in ("void", "error")]
    with styled(4.6, 4.2) as figure:
        axes = figure.add_subplot()
        axes.plot([0, 1], [0, 1], color="0.6", linewidth=1, label="deserved")
        for name, colour in zip(SHOWN, (SIM, REAL), strict=True):
            _, confidence, hits = judged([row for row in read if HANDS[name](row)])
            each = bins(confidence, hits)
            x, share = [b[0] for b in each], np.array([b[1] / b[2] for b in each])
            error = np.abs(np.array([wilson(b[1], b[2]) for b in each]).T - share)
            label = f"{name}: {balance(confidence, hits)}"
            axes.errorbar(x, share, error, color=colour, marker="o", capsize=3, linewidth=1.5, label=label)
        axes.set_xlabel("confidence of the verdict")
        axes.set_ylabel("share of these verdicts that is right")
        axes.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0)
        )  # above: verdicts may be anywhere in the diagram
    figure.savefig(path, dpi=90, metadata={"Software": None})


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("rows", type=Path, nargs="+")
    parser.add_argument("--write", type=Path, help="a document with the marks of this table")
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    rows = [json.loads(line) for path in options.rows for line in path.read_text().splitlines()]
    text = report(rows)
    print(text)
    for status in CALIBRATION:
        kind = [row for row in rows if row["status"] == status and shaping(row)]
        print(f"deserved by {len(kind)} seeds that may shape it: {status} {calibration(kind)}")
    if options.picture:
        picture(rows, options.picture)
    if options.write:
        write_between(options.write, "random suite", text)


if __name__ == "__main__":
    main()
