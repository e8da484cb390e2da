"""What `diagnose` says of logs in files, one line each, several processes.

python benchmarks/named_logs.py LOG... --processes 8
"""

import argparse
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.board import load_board
from sysid.diagnosis.diagnose import diagnose
from sysid.quantity import Quantity
from sysid.recording import Recording

ROOT = Path(__file__).parents[1]


def run(path: Path) -> str:
    """Return the verdict on one log as a line; the record knows an inertia only."""
    np.seterr(all="ignore")
    board = load_board(ROOT / "data/boards/pink.toml")
    board = replace(
        board,
        tilt={name: replace(q, std=0.0) for name, q in board.tilt.items()},
        inertia=Quantity(1.0, 0.01, "kg*m^2"),
    )
    begin = time.process_time()
    try:
        found = diagnose(Recording.read(path), board)
    except Exception as error:  # noqa: BLE001 - said in the line
        return f"{path.parent.name}/{path.stem}: {error!r}"[:300]
    verdict, posterior = found.verdict, found.posterior
    alike = "; ".join(",".join(group) for group in verdict.indistinguishable_from)
    sizes = {f: (round(s.torque_share, 3), round(s.energy_share, 3)) for f, s in posterior.sizes.items()}
    return (
        f"{path.parent.name}/{path.stem}: {verdict.status} {', '.join(verdict.effects)} ({verdict.confidence:.2f}) ~ {alike} | "
        f"{found.baseline.rmse / found.noise.std:.2f} -> {found.best.rmse / found.noise.std:.2f} | eps {posterior.share} g "
        f"{posterior.nameless:.3f} {'cycles ' if posterior.by_cycles else ''}{sizes} n {len(found.releases)} {time.process_time() - begin:.1f} s"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", nargs="+", type=Path)
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    with ProcessPoolExecutor(options.processes) as pool:
        for job in as_completed([pool.submit(run, log) for log in options.logs]):
            print(job.result(), flush=True)


if __name__ == "__main__":
    main()
