"""Fit servos and a pendulum that others recorded and published, and write the table of benchmarks/results/real_joints.md.

python docs/make_real_joints.py FOLDER   (with servo_passive_drop, sts3250_servo_drop and rotary_pendulum_freeswing in it)
"""

import re
import sys
import tempfile
from pathlib import Path

from sim.model.setup import Setup
from sim.model.subject import board_of
from sysid.board import Board
from sysid.fit_mjcf import Fit, fit
from sysid.recording import Recording

PAGE = Path(__file__).parents[1] / "benchmarks" / "results" / "real_joints.md"
MARKS = "<!-- real joints: docs/make_real_joints.py -->\n", "<!-- end of real joints -->\n"
PENDULUM = """<mujoco><worldbody><body name="arm"><joint name="servo" axis="0 1 0"/>
  <inertial pos="0 0 -{arm}" mass="{mass}" diaginertia="{own} {own} 1e-9"/></body></worldbody></mujoco>"""


def with_weight(mass: float, arm: float, own: float = 1e-9) -> Board:
    """Return the record of a mass [kg] on an arm [m], of some inertia about its own centre [kg*m^2], from a model of it."""
    path = Path(tempfile.mkdtemp()) / "pendulum.xml"
    path.write_text(PENDULUM.format(mass=mass, arm=arm, own=own))
    return board_of(Setup(file=path, joint="servo"))[0]


def row(name: str, found: Fit, stated: str) -> str:
    """Return a row of the table."""
    cells = (found.quantities[key].number for key in ("damping", "coulomb.torque", "armature.inertia"))
    return f"| {name} | {' | '.join(cells)} | {100 * found.joint.nrmse:.1f} % | {stated} |"


def table(folder: Path) -> str:
    """Return the table."""
    drops = [
        Recording.read(path, column="angle_rad")
        for path in sorted((folder / "servo_passive_drop").glob("*.csv"))
    ]
    drop = Recording.read(
        folder / "sts3250_servo_drop" / "drop.csv", column="position", unit="rad", start=2.0
    )
    begins = (0.73, 0.63, 0.45)
    swings = [
        Recording.read(path, column="angle_rad", start=begin, release=(begin,))
        for path, begin in zip(
            sorted((folder / "rotary_pendulum_freeswing").glob("*.csv")), begins, strict=True
        )
    ]
    rod = with_weight(0.01225, 0.062, 0.01225 * 0.124**2 / 12)
    rows = (
        (
            "Dynamixel XL330, 0.49 kg at 0.10 m, four drops", drops, with_weight(0.49, 0.10),
            "0.0037, 0.0128, 0.00181; in another fit there 0.0040, 0.0189, 0.00195",
        ),
        (
            "Feetech STS3250, 1.13 kg at 0.12 m, one drop", drop, with_weight(1.13, 0.12),
            "0.035, 0.20 and 0.20 of the load's torque, 0.0010",
        ),
        (
            "rotary pendulum, a rod of 12.25 g and 124 mm, three swings", swings, rod,
            "damping alone, 0.00067, beside 80 g added by trial and error",
        ),
    )  # fmt: skip
    lines = [
        "| log | damping [N·m·s/rad] | friction [N·m] | armature [kg·m²] | error / motion | stated by its authors |",
        "|---|---|---|---|---|---|",
        *(row(name, fit(data, board, ["coulomb", "armature"]), stated) for name, data, board, stated in rows),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Put the table into the page."""
    begin, end = MARKS
    text = PAGE.read_text(encoding="utf-8")
    made = re.sub(
        f"{re.escape(begin)}.*?{re.escape(end)}",
        lambda _: begin + table(Path(sys.argv[1])) + end,
        text,
        flags=re.S,
    )
    PAGE.write_text(made, encoding="utf-8")


if __name__ == "__main__":
    main()
