"""Cold starts: the library, `husky-sysid --help`, and `husky-sysid decay` against the least that such a tool must do.

Run:  python benchmarks/decay_cold_start.py [ROUNDS]

Importing `sysid` and printing the help are held against an interpreter that does nothing and one that imports numpy.
`decay` gets a log of 60 s at 1 kHz with twenty releases; its yardstick imports numpy, pandas and scipy.optimize and
reads the same file with pandas. All run as fresh processes, by turns, and processor time is taken, which a busy machine
lengthens least; the medians and their ratios are recorded in benchmarks/results/decay_cold_start.md.
"""

import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from pages import table, write_result

LIMIT = 2.5
"""Of `decay` with its picture, against its yardstick."""
IMPORT_LIMIT = 0.06
"""Of `import sysid`, beyond the empty interpreter [s]."""
YARDSTICK = "import sys, numpy, pandas, scipy.optimize; pandas.read_csv(sys.argv[1])"


def write_log(path: Path) -> None:
    """Write 60 s at 1 kHz: held, let go, swings to rest; by turns to both sides."""
    rng = np.random.default_rng(0)
    time_s = np.arange(60_000) / 1000.0
    omega, zeta = 41.08, 0.5626
    since = time_s % 3.0 - 1.5
    amplitude = 0.18 * np.where(time_s // 3.0 % 2 == 0, 1, -1)
    damped = omega * np.sqrt(1 - zeta**2)
    swing = np.exp(-zeta * omega * since) * (
        np.cos(damped * since) + zeta / np.sqrt(1 - zeta**2) * np.sin(damped * since)
    )
    s = np.clip((since + 1.5) / 0.6, 0, 1)
    roll = amplitude * np.where(since < 0, s**3 * (10 - 15 * s + 6 * s**2), swing)
    roll += rng.normal(0, np.deg2rad(0.1), len(roll))
    np.savetxt(path, np.column_stack([time_s, roll]), "%.6f", ",", header="time_s,roll_rad", comments="")


def seconds(command: list[str], folder: str) -> float:
    """Return the processor time of a process [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        command, check=True, capture_output=True, cwd=folder, env=os.environ | {"OMP_NUM_THREADS": "1"}
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.csv"
        write_log(log)
        decay = [sys.executable, "-m", "sysid.cli", "decay", str(log), "--board", "pink"]
        commands = {
            "nothing": [sys.executable, "-c", ""],
            "import numpy": [sys.executable, "-c", "import numpy"],
            "import sysid": [sys.executable, "-c", "import sysid"],
            "--help": [sys.executable, "-m", "sysid.cli", "--help"],
            "yardstick": [sys.executable, "-c", YARDSTICK, str(log)],
            "decay": decay,
            "decay --no-picture": [*decay, "--no-picture"],
        }
        for command in commands.values():  # warm the disk cache
            seconds(command, folder)
        taken: dict[str, list[float]] = {name: [] for name in commands}
        for _ in range(rounds):
            for name, command in commands.items():
                taken[name].append(seconds(command, folder))
    medians = {name: statistics.median(times) for name, times in taken.items()}
    names = list(commands)
    write_result(
        "decay_cold_start.md",
        f"""# Cold starts

Processor time, Python {platform.python_version()}, medians of {rounds} rounds, by turns; made by
`benchmarks/decay_cold_start.py`.

{ratios(medians, names[:4], "import numpy")}

Limit for `import sysid`: {1e3 * IMPORT_LIMIT:.0f} ms more than nothing.

## `husky-sysid decay`

60 s at 1 kHz (60 000 rows), twenty releases.

{ratios(medians, names[4:], "yardstick")}

Limit for `decay` with its picture: {LIMIT}.""",
    )
    slow_import = medians["import sysid"] > medians["nothing"] + IMPORT_LIMIT
    if slow_import or medians["decay"] > LIMIT * medians["yardstick"]:
        sys.exit(1)


def ratios(medians: dict[str, float], names: list[str], unit: str) -> str:
    """Return a table: seconds, and the ratio to the row `unit`."""
    rows = ((name, f"{medians[name]:.3f}", f"{medians[name] / medians[unit]:.2f}") for name in names)
    return table(("command", "seconds", "ratio"), rows)


if __name__ == "__main__":
    main()
