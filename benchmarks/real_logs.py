"""Real logs of other people's joints: what `diagnose` says of each, with nothing told but the log.

    python benchmarks/real_logs.py ../shared/real_logs [--only servo] [--write table.md]

The folder is no part of the project; where it is absent nothing is run. What each log holds is known from its source or from an
independent fit. Seconds are of one processor.
"""

import time
from pathlib import Path

from foreign_logs import options_of, verdicts

from sysid.board import load_board
from sysid.diagnosis.diagnose import diagnose
from sysid.errors import SysidError
from sysid.logs import read_roll
from sysid.releases import find_releases

ROOT = Path(__file__).parents[1]
FRICTION = ({"friction"}, {"friction", "hardening", "rest"})
LOGS: dict[str, tuple[set[str], set[str]]] = {
    "servo_passive_drop/drop_kp100.csv": FRICTION,
    "servo_passive_drop/drop_kp200.csv": FRICTION,
    "servo_passive_drop/drop_kp400.csv": FRICTION,
    "servo_passive_drop/drop_kp800.csv": FRICTION,
    "sts3250_servo_drop/drop.csv": FRICTION,
    "bicycle_fork_gyro/compound.csv": ({"friction"}, {"friction", "hardening", "hysteresis"}),
    "bicycle_wheel_gyro/radial.csv": (set(), set()),
    "bicycle_wheel_gyro/axial.csv": (set(), set()),
    "rotary_pendulum_freeswing/swing_01.csv": ({"friction", "hardening"}, {"friction", "hardening"}),
    "rotary_pendulum_freeswing/swing_02.csv": ({"friction", "hardening"}, {"friction", "hardening"}),
    "rotary_pendulum_freeswing/swing_03.csv": ({"friction", "hardening"}, {"friction", "hardening"}),
    "kvlcc2_roll_decay/run_21337.csv": ({"drag", "hardening"}, {"drag", "hardening"}),
    "kvlcc2_roll_decay/run_21338.csv": ({"drag", "hardening"}, {"drag", "hardening"}),
}
"""Families that must be named, or be among what looks the same, and those that may."""


def main() -> None:
    options = options_of(__doc__, "--write", type=Path, help="file for the table")
    board = load_board(ROOT / f"data/boards/{options.board}.toml")
    rows = [
        "| log | | named | looks the same | confidence | error / noise | explained | s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, (needed, known) in LOGS.items():
        if options.only not in name:
            continue
        begin = time.process_time()
        try:
            result = diagnose(find_releases(read_roll(options.folder / name)), board)
        except SysidError as error:
            rows.append(f"| {name} | BAD | {error} | | | | | |")
            continue
        v, noise = result.verdict, result.noise.std
        right = any(needed <= said <= known for said in map(set, verdicts(result)))
        rows.append(
            f"| {name} | {'ok' if right else 'BAD'} | {', '.join(v.effects) or v.status} | "
            f"{'; '.join(', '.join(group) for group in v.indistinguishable_from)} | {v.confidence:.2f} | "
            f"{v.error_before / noise:.2f} to {v.error_after / noise:.2f} | {v.explained:.2f} | {time.process_time() - begin:.0f} |"
        )
        print(rows[-1], flush=True)
    if options.write:
        options.write.write_text("\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
