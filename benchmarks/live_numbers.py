"""What `live` costs while a phone measures: seconds from the end of a release to its numbers, and the share of a core.

Run:  python benchmarks/live_numbers.py

A phone is replayed at its own pace over its remote access (tests/support/recorded_phone.py) from an export that `synth` makes. The
table goes to benchmarks/results/live_numbers.md. How much of the delay is waiting for stillness, tests/live/test_rest.py holds.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import psutil
from pages import table, write_result

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from recorded_phone import recorded_phone  # noqa: E402

TOOL = [sys.executable, "-u", "-m", "sysid.cli"]
ENDS = (2.06, 5.16, 8.26)
"""When the deck is still again [s]: it is let go at 1.7, 4.8 and 7.9 s."""


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        export = str(Path(folder) / "tip.zip")
        made = [
            "synth",
            "-b",
            "pink",
            "--releases",
            "3",
            "--rate",
            "200",
            "--dialect",
            "phyphox",
            "-o",
            export,
        ]
        subprocess.run([*TOOL, *made], cwd=ROOT, check=True, capture_output=True)
        with recorded_phone(export) as (phone, address):
            asked = [
                "live", "-b", "pink", "--phone", address, "--port", "0", "--releases", "3", "--workspace", folder
            ]  # fmt: skip
            process = subprocess.Popen([*TOOL, *asked], cwd=ROOT, stdout=subprocess.PIPE, text=True)
            clock, used, shown, begun = psutil.Process(process.pid), [], [], 0.0
            for line in process.stdout or ():
                if line.startswith(("Hold", "release")):
                    used.append(sum(clock.cpu_times()[:2]))
                    begun = phone.now if line.startswith("Hold") else begun
                    shown += [phone.now] if line.startswith("release") else []
            process.communicate()
    rows = [
        [str(number), f"{seen - end:.2f}"]
        for number, (seen, end) in enumerate(zip(shown, ENDS, strict=True), start=1)
    ]
    share = (used[-1] - used[0]) / (shown[-1] - begun)
    write_result(
        "live_numbers.md",
        f"{table(['release', 'its numbers after [s]'], rows)}\n\n{100 * share:.0f} % of a core while it measured.",
    )


if __name__ == "__main__":
    main()
