"""Real logs of other people's joints: what `diagnose` says of each, with nothing told but the log, and what a learned torque wins.

    python benchmarks/real_logs.py ../shared/real_logs [--only servo]

The folder is no part of the project; where it is absent nothing is run. What each log holds is known from its source or from an
independent fit. Every command that `diagnose` prints as the next step is run, and must end well. A torque is learned beside what is
named wherever that leaves more than the noise. Seconds are of one processor.
"""

import re
import shlex
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from foreign_logs import options_of, verdicts

from sysid.board import Board, load_board
from sysid.diagnosis.diagnose import Diagnosis, diagnose, fittable
from sysid.diagnosis.learned_torque import learn
from sysid.errors import SysidError
from sysid.fitting.joint import FitOptions
from sysid.logs import read_roll
from sysid.releases import find_releases
from sysid.roll import Release

ROOT = Path(__file__).parents[1]
NEAR = 1.15
"""Noise floors up to which nothing is left to learn."""
FRICTION = ({"friction"}, {"friction", "hardening", "rest"})
LOGS: dict[str, tuple[set[str], set[str]]] = {
    "servo_passive_drop/drop_kp100.csv": FRICTION,
    "servo_passive_drop/drop_kp200.csv": FRICTION,
    "servo_passive_drop/drop_kp400.csv": FRICTION,
    "servo_passive_drop/drop_kp800.csv": FRICTION,
    # What a geared servo does beside friction is written nowhere; something that yields takes two thirds of the error away.
    "sts3250_servo_drop/drop.csv": ({"friction"}, {"friction", "hardening", "rest", "relaxation"}),
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


def ends_well(result: Diagnosis) -> bool:
    """Run every command that a diagnosis prints, each in a folder of its own; return whether none fails, and print those that do."""
    well = True
    for line in re.findall(r"husky-sysid (.*)", result.report()):
        run = [sys.executable, "-c", "from sysid.cli import main; main()", *shlex.split(line)]
        with TemporaryDirectory() as folder:
            done = subprocess.run(run, capture_output=True, text=True, check=False, cwd=folder)
        if done.returncode:
            print(f"BAD exit {done.returncode}: husky-sysid {line}: {done.stderr.strip()}", flush=True)
        well &= done.returncode == 0
    return well


def learned(
    releases: Sequence[Release], board: Board, beside: Sequence[str], noise: float
) -> tuple[str, str, str]:
    """Learn a torque beside effects; return error and held-out error over the noise, and the torque in words."""
    try:
        fit, words = learn(releases, board, [*beside, "learned"], FitOptions())
    except SysidError as error:
        return "", "", str(error)
    text = "nothing" if words is None else words.text.replace("|", "\\|")
    return f"{fit.rmse / noise:.2f}", f"{fit.heldout_rmse() / noise:.2f}", text


def main() -> None:
    options = options_of(__doc__)
    np.seterr(all="ignore")
    board = load_board(ROOT / f"data/boards/{options.board}.toml")
    for name, (needed, known) in LOGS.items():
        if options.only not in name:
            continue
        begin = time.process_time()
        releases = find_releases(read_roll(options.folder.resolve() / name))
        try:
            result = diagnose(releases, board)
        except SysidError as error:
            print(f"BAD {name}: {error}", flush=True)
            continue
        seconds = time.process_time() - begin
        v, noise = result.verdict, result.noise.std
        right = any(needed <= said <= known for said in map(set, verdicts(result)))
        right &= ends_well(result)
        alike = "; ".join(", ".join(group) for group in v.indistinguishable_from)
        told = ("", "", "nothing")
        if result.best.rmse > NEAR * noise:
            told = learned(releases, board, fittable(v.effects), noise)
        before = (f"{error / noise:.2f}" for error in (result.baseline.rmse, result.best.rmse))
        named = ", ".join(v.effects) or v.status
        said = (
            "ok " if right else "BAD",
            name,
            named,
            *before,
            *told,
            alike,
            f"{v.confidence:.2f}",
            f"{seconds:.0f} s",
        )
        print(*said, sep=" | ", flush=True)


if __name__ == "__main__":
    main()
