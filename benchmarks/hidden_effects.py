"""The hidden-effect suite: logs whose truth nobody told the tool, and what it says of them.

    python benchmarks/hidden_effects.py --seeds 1 --write docs/diagnosis.md

Rows are appended to `--rows` as they come, so that a run may be stopped (or given a `--budget`) and go on
later: cases whose row is there already are not run again.
"""

import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from hidden_truths import AGAINST_RECORD, TRUTHS, VISIBLE, Truth, board_of, make, visibility
from pages import table, write_between
from suite import Row, command_line, run_suite

from sysid.diagnosis.diagnose import Diagnosis, diagnose
from sysid.effects import effect


def right(truth: Truth, result: Diagnosis) -> bool:
    """Whether the verdict is right: the effects, or a set of look-alikes that contains them."""
    verdict = result.verdict
    if truth.outside is not None:
        kin = {effect(name).family for name in truth.kin}
        return verdict.status == "unexplained" or (bool(kin) and kin == set(verdict.families))
    if not truth.effects:
        return verdict.status == "none-missing"
    return set(truth.effects) in _said(result)


def _said(result: Diagnosis) -> list[set[str]]:
    verdict = result.verdict
    return [set(verdict.effects), *map(set, verdict.indistinguishable_from)] if verdict.effects else []


def beyond_sight(truth: Truth, seed: int, result: Diagnosis) -> float:
    """Return how far what was said is from the truth, as χ² without noise; inf where it is simply wrong.

    Below `VISIBLE` the log does not hold the difference: part of what is hidden is too weak to show, or an
    effect of the catalogue mimics what is outside it.
    """
    if result.verdict.status == "unexplained" or (not truth.effects and truth.outside is None):
        return float("inf")
    groups = _said(result) or [set[str]()]
    if truth.outside is None:
        groups = [group for group in groups if group < set(truth.effects)]
    return min(
        (visibility(truth, seed, result.noise.std, sorted(g - AGAINST_RECORD)) for g in groups),
        default=float("inf"),
    )


def run(name: str, seed: int) -> Row:
    """Diagnose one log and return one row of the result."""
    truth = next(t for t in TRUTHS if t.name == name)
    row: Row = {
        "truth": truth.name, "seed": seed, "inside": truth.outside is None and bool(truth.effects),
        "none": not truth.effects and truth.outside is None,
    }  # fmt: skip
    begin = cpu = 0.0
    try:
        with TemporaryDirectory() as folder:
            releases = make(truth, seed, Path(folder))
        begin, cpu = time.perf_counter(), time.process_time()
        result = diagnose(releases, board_of(truth))
    except Exception as error:  # noqa: BLE001 - one broken case must not end the suite: it counts as wrong, with its reason
        return {**row, "right": False, "status": f"{type(error).__name__}: {error}", "effects": [], "alike": [],
                "confidence": 0.0, "before": 0.0, "after": 0.0, "hidden": False, "seconds": 0.0, "cpu": 0.0}  # fmt: skip
    seconds, used, hit = time.perf_counter() - begin, time.process_time() - cpu, right(truth, result)
    verdict = result.verdict
    return {
        **row, "right": hit, "hidden": bool(not hit and beyond_sight(truth, seed, result) < VISIBLE), "status": verdict.status,
        "effects": list(verdict.effects), "alike": [list(g) for g in verdict.indistinguishable_from],
        "confidence": verdict.confidence, "before": verdict.error_before / result.noise.std,
        "after": verdict.error_after / result.noise.std, "families": list(verdict.families), "explained": verdict.explained, "seconds": seconds, "noise": result.noise.std, "cpu": used,
        "samples": sum(len(r.time) for r in releases),
        "top": [[list(c.effects), round(c.score, 1), round(c.rmse / result.noise.std, 4),
                 None if c.heldout_rmse is None else round(c.heldout_rmse / result.noise.std, 4)]
                for c in result.candidates[:10]],
    }  # fmt: skip


def said_in(row: Row) -> str:
    """Return what was said of a log: the effects, and those that look alike."""
    if row["status"] != "missing":
        return str(row["status"])
    return " / ".join(" + ".join(group) for group in [row["effects"], *row["alike"]])


def report(rows: Sequence[Row]) -> str:
    """Return the confusion matrix and the targets as Markdown."""
    cells: list[tuple[str, ...]] = []
    for name in dict.fromkeys(t.name for t in TRUTHS if any(r["truth"] == t.name for r in rows)):
        mine = [row for row in rows if row["truth"] == name]
        said = "; ".join(f"{count} x {answer}" for answer, count in Counter(map(said_in, mine)).most_common())
        hits = sum(bool(row["right"]) for row in mine)
        before, after = (np.mean([row[key] for row in mine]) for key in ("before", "after"))
        cells.append((name, said, f"{hits} of {len(mine)}", f"{before:.2f}", f"{after:.3f}"))
    head = ("hidden", "verdicts", "right", "error / noise before", "after")
    return "\n".join((*summary(rows), "", table(head, cells)))


def summary(rows: Sequence[Row]) -> list[str]:
    """Return the targets and what was reached."""
    inside = [r for r in rows if r["inside"]]
    groups = {
        "right effect, or a set of look-alikes with it": inside,
        "no alarm where nothing is hidden": [r for r in rows if r["none"]],
        "'unexplained' outside the catalogue": [r for r in rows if not r["inside"] and not r["none"]],
    }
    lines = [f"- {name}: {_rate(group)}" for name, group in groups.items() if group]
    fell = [r["after"] <= 1.15 for r in inside]
    if fell:
        lines.append(f"- error after at most 1.15 times the noise floor: {sum(fell)} of {len(fell)}")
    return lines


def _rate(rows: Sequence[Row]) -> str:
    """Return how many are right; those in which the log does not hold the difference stand apart."""
    clear = [r for r in rows if not r["hidden"]]
    hits = sum(bool(r["right"]) for r in clear)
    apart = len(rows) - len(clear)
    return f"{hits} of {len(clear)} ({hits / max(len(clear), 1):.1%})" + (
        f", {apart} beyond sight apart" if apart else ""
    )


def say(row: Row) -> None:
    mark = "ok " if row["right"] else "?  " if row["hidden"] else "BAD"
    print(mark, row["truth"], row["seed"], row["status"], row["effects"], "~", row["alike"], f"{row['before']:.2f} -> {row['after']:.3f}", f"{row['cpu']:.1f} s", flush=True)  # fmt: skip


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", default="", help="part of the name of the truths")
    parser.add_argument("--rows", type=Path, help="JSON lines: read what is there, append what is new")
    parser.add_argument("--write", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--budget", type=float, default=float("inf"), help="seconds after which no more is run"
    )
    options = parser.parse_args()
    cases = [
        (truth.name, seed)
        for seed in range(options.first, options.first + options.seeds)
        for truth in TRUTHS
        if options.only in truth.name
    ]
    np.random.default_rng(0).shuffle(cases)  # a run that is stopped has then seen all kinds
    rows = run_suite(
        run, cases, ("truth", "seed"), options.rows, workers=options.workers, seconds=options.budget, say=say
    )
    print("\n".join(summary(rows)))
    if options.write:
        write_between(options.write, "suite", report(rows))


if __name__ == "__main__":
    main()
