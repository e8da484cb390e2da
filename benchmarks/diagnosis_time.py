"""How the time of a diagnosis grows with samples and with the catalogue.

    python benchmarks/diagnosis_time.py

Processor time of one process; quote the ratios. One log of the hidden-effect suite per row: dry friction (found at
once, so the search ends early) and a damper on one side (which nothing explains, so all is tried).
"""

import platform
import time
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from hidden_truths import TRUTHS, board_of, make

from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.search import Searcher
from sysid.fitting.records import make_records
from sysid.fitting.search import scales_of
from sysid.noise.floor import noise_floor

RESULT = Path(__file__).parent / "results" / "diagnosis_time.md"
CASES = ("coulomb 0.1", "damper on one side")
RATES = (125.0, 250.0, 500.0, 1000.0)
SIZES = (3, 6, 9, 13)
SEED = 5


def log_of(name: str, rate: float):
    truth = replace(next(t for t in TRUTHS if t.name == name), rates=(rate,), noises=(0.1,))
    with TemporaryDirectory() as folder:
        return make(truth, SEED, Path(folder)), board_of(truth)


@dataclass(frozen=True, kw_only=True)
class Few(Searcher):
    """A search of the first effects of the catalogue only."""

    count: int

    def names(self) -> list[str]:
        return super().names()[: self.count]


def main() -> None:
    lines = [
        "# Time of a diagnosis", "",
        f"Processor time of one process on a busy machine, Python {platform.python_version()}; made by `benchmarks/diagnosis_time.py`. "
        "Three releases of 2 s.", "", "| hidden | samples | s | verdict |", "|---|---|---|---|",
    ]  # fmt: skip
    diagnose(*log_of("none, heavy", 200.0))  # imports, and functions that all share
    for name in CASES:
        for rate in RATES:
            releases, board = log_of(name, rate)
            begin = time.process_time()
            verdict = diagnose(releases, board).verdict
            took = time.process_time() - begin
            said = " + ".join(verdict.effects) or verdict.status
            lines.append(f"| {name} | {sum(len(r.time) for r in releases)} | {took:.1f} | {said} |")
            print(lines[-1], flush=True)
    lines += [
        "",
        "Singles and all pairs, screened (nothing settled early), 'damper on one side' at 500 Hz:",
        "",
    ]
    lines += ["| effects | models | s |", "|---|---|---|"]
    releases, board = log_of(CASES[1], 500.0)
    records = make_records(releases, noise_floor(releases).std, rate=False)
    scales = scales_of(records, board)
    for count in SIZES:
        searcher = Few(records=records, scales=scales, bias="shared", count=count)
        begin = time.process_time()
        singles = searcher.singles()
        pairs = searcher.pairs(singles)
        lines.append(f"| {count} | {len(singles) + len(pairs)} | {time.process_time() - begin:.1f} |")
        print(lines[-1], flush=True)
    RESULT.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
