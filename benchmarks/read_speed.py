"""Time and memory for reading a long log, against what pandas needs for the same file.

    python benchmarks/read_speed.py [--rows 10000000]

Each reader runs in a process of its own, in turn, several times; the table holds medians of one run, because
on a shared machine only ratios measured together mean anything. Memory is the peak resident size less what the
same process has after its imports.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from pages import table, write_result

PANDAS = "import pandas\nread = lambda path: pandas.read_csv(path)"
OURS = (
    "import pathlib, numpy, pandas, scipy.ndimage\nfrom sysid.logs import read_roll\n"
    "read = lambda path: read_roll(pathlib.Path(path))"
)
WORKER = """
import json, resource, sys, time
{imports}
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
before, start = peak(), time.perf_counter()
result = read(sys.argv[1])
print(json.dumps(dict(seconds=time.perf_counter() - start, bytes=peak() - before)))
"""
COLD_PANDAS = "import sys, numpy, pandas, scipy.optimize; pandas.read_csv(sys.argv[1])"
COLD_OURS = "import sys, pathlib; from sysid.logs import read_roll; read_roll(pathlib.Path(sys.argv[1]))"


def write_log(path: Path, rows: int) -> None:
    """Write a rocking board at 1 kHz: time in s, angle in rad, with noise."""
    generator = np.random.default_rng(0)
    chunk = 100_000
    with path.open("w", encoding="utf-8") as file:
        file.write("t_s,roll_rad\n")
        for first in range(0, rows, chunk):
            t = np.arange(first, min(first + chunk, rows)) / 1000
            since = np.mod(t, 10.0)
            angle = 0.3 * np.exp(-0.5 * since) * np.cos(30 * since) + generator.normal(0, 1e-3, t.size)
            file.writelines(f"{a:.3f},{b:.6f}\n" for a, b in zip(t, angle, strict=True))


def measure(imports: str, path: Path) -> tuple[float, float]:
    """Return seconds and bytes of one read in a process of its own."""
    command = [sys.executable, "-c", WORKER.format(imports=imports), str(path)]
    done = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return done["seconds"], done["bytes"]


def cold(code: str, path: Path) -> float:
    """Return seconds from starting Python to the end of the read."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, check=True)
    return time.perf_counter() - start


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=10_000_000)
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        long, short = Path(folder) / "long.csv", Path(folder) / "short.csv"
        write_log(long, arguments.rows)
        write_log(short, 60_000)
        runs = [(measure(PANDAS, long), measure(OURS, long)) for _ in range(arguments.repeats)]
        starts = [(cold(COLD_PANDAS, short), cold(COLD_OURS, short)) for _ in range(3 * arguments.repeats)]
        size = long.stat().st_size
    pandas_s, pandas_b, ours_s, ours_b = (
        statistics.median(run[who][what] for run in runs) for who in (0, 1) for what in (0, 1)
    )
    cold_pandas, cold_ours = (statistics.median(start[who] for start in starts) for who in (0, 1))
    rows = [
        (f"{arguments.rows:,} rows ({size / 1e6:.0f} MB), warm", pandas_s, ours_s, ".2f", "s"),
        ("peak memory of the same", pandas_b / 1e6, ours_b / 1e6, ".0f", "MB"),
        ("60 s at 1 kHz from a cold start (pandas with numpy and scipy.optimize)", cold_pandas, cold_ours, ".2f", "s"),
    ]  # fmt: skip
    cells = [(n, f"{a:{form}} {unit}", f"{b:{form}} {unit}", f"{b / a:.2f}") for n, a, b, form, unit in rows]
    write_result(
        "read_speed.md",
        "# Reading speed\n\n"
        f"`benchmarks/read_speed.py`, medians of {arguments.repeats} runs in turn on {processor()}.\n\n"
        + table(("what", "pandas", "read_roll", "ratio"), cells),
    )


def processor() -> str:
    """Return the processor's name, where the system says it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return "an unnamed processor"
    return next(
        (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "one core"
    )


if __name__ == "__main__":
    main()
