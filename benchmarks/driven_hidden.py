"""How often the diagnosis of driven joints is right: random joints, each with nothing or one hidden effect.

    python benchmarks/driven_hidden.py --logs 120 --workers 2

Truths and motions come from `driven_truths.py`, which shares no code with the fit. A log counts as right where the families named
are those hidden; a log with nothing hidden where nothing is named.
"""

import argparse
import time
from pathlib import Path
from typing import Any

from driven_truths import HIDDEN, given, make
from pages import table, write_between
from suite import run_suite

FIRST = 1000
"""First seed: the smaller ones were used to develop it."""


def run(seed: int) -> dict[str, Any]:
    """Return one row: what was hidden, what was named."""
    from sysid.driven.diagnose import diagnose

    hidden = HIDDEN[seed % len(HIDDEN)]
    truth, log = make(seed, (hidden,) if hidden else ())
    begin = time.process_time()
    verdict = diagnose(log, given(truth))
    return {
        "seed": seed, "kind": truth.kind, "hidden": hidden, "named": list(verdict.families), "status": verdict.status,
        "confidence": verdict.confidence, "alike": [list(one) for one in verdict.alike], "error": verdict.best.rmse / log.std,
        "before": verdict.base.rmse / log.std, "seconds": time.process_time() - begin, "effects": list(verdict.effects),
    }  # fmt: skip


def main() -> None:
    """Run the suite, and write its table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--logs", type=int, default=120)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--first", type=int, default=FIRST)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--rows", type=Path, help="JSON lines of an earlier run to go on from")
    options = parser.parse_args()
    cases = [(seed,) for seed in range(options.first, options.first + options.logs)]
    rows = run_suite(run, cases, ("seed",), options.rows, workers=options.workers, seconds=options.seconds)
    lines = []
    for hidden in HIDDEN:
        own = [row for row in rows if row["hidden"] == hidden]
        right = [
            row
            for row in own
            if row["named"] == ([hidden] if hidden else []) and row["status"] != "unexplained"
        ]
        others = [", ".join(row["named"]) or row["status"] for row in own if row not in right]
        seconds = sorted(row["seconds"] for row in own)
        lines.append(
            (
                hidden or "nothing",
                f"{len(right)} of {len(own)}",
                "; ".join(others),
                f"{seconds[len(seconds) // 2]:.1f}" if own else "",
            )
        )
    text = table(("hidden", "right", "named instead", "processor seconds, median"), lines)
    write_between(Path(__file__).with_name("public.md"), "hidden effects of driven joints", text)


if __name__ == "__main__":
    main()
