"""Fit servos and a pendulum that others recorded and published, and write the table of docs/any_joint.md.

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
from sysid.quantity import Quantity
from sysid.recording import Recording

PAGE = Path(__file__).parent / "any_joint.md"
MARKS = "<!-- real joints: docs/make_real_joints.py -->\n", "<!-- end of real joints -->\n"
PENDULUM = """<mujoco><worldbody><body name="arm"><joint name="servo" axis="0 1 0"/>
  <inertial pos="0 0 -{arm}" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/></body></worldbody></mujoco>"""
UNIT = Quantity(1.0, 0.0, "kg*m^2", "unit: mass and arm are not known")


def with_weight(mass: float, arm: float) -> Board:
    """Return the record of a point mass on an arm, from a model of it."""
    path = Path(tempfile.mkdtemp()) / "pendulum.xml"
    path.write_text(PENDULUM.format(mass=mass, arm=arm))
    return board_of(Setup(file=path, joint="servo"))[0]


def of_unit_inertia() -> Board:
    """Return a record of which only ratios to the inertia come out."""
    zero = {"stiffness": "N*m/rad", "damping": "N*m*s/rad", "rest_angle": "rad"}
    tilt = {name: Quantity(0.0, 0.0, unit) for name, unit in zero.items()}
    tilt["range"] = Quantity(3.14, 0.0, "rad")
    return Board(name="unit", description="", source="", geometry={}, mass={}, inertia=UNIT, tilt=tilt)


def row(name: str, found: Fit, per: str, stated: str) -> str:
    """Return a row of the table."""
    numbers = {key: quantity.number for key, quantity in found.quantities.items()}
    weight = "known" if found.before.effects else numbers["gravity.moment"]
    cells = (weight, numbers["damping"], numbers["coulomb.torque"], numbers.get("armature.inertia", "-"))
    error = f"{100 * found.joint.nrmse:.1f} %"
    return f"| {name} | {per} | {' | '.join(cells)} | {error} | {stated} |"


def table(folder: Path) -> str:
    """Return the table."""
    drops = [
        Recording.read(path, column="angle_rad")
        for path in sorted((folder / "servo_passive_drop").glob("*.csv"))
    ]
    servo = fit(drops, with_weight(0.49, 0.10), ["coulomb", "armature"])
    drop = Recording.read(
        folder / "sts3250_servo_drop" / "drop.csv", column="position", unit="rad", start=2.0
    )
    large = fit(drop, of_unit_inertia(), ["gravity", "coulomb"], fixed={"stiffness": 0.0})
    begins = (0.73, 0.63, 0.45)
    swings = [
        Recording.read(path, column="angle_rad", start=begin, release=(begin,))
        for path, begin in zip(
            sorted((folder / "rotary_pendulum_freeswing").glob("*.csv")), begins, strict=True
        )
    ]
    arm = fit(swings, of_unit_inertia(), ["gravity", "coulomb"], fixed={"stiffness": 0.0})
    lines = [
        "| log | in | weight | damping | friction | armature | error / motion | stated by its authors |",
        "|---|---|---|---|---|---|---|---|",
        row(
            "Dynamixel XL330, 0.49 kg at 0.10 m, four drops",
            servo,
            "SI",
            "0.0037 N·m·s, 0.0128 N·m, 0.00181 kg·m²",
        ),
        row("Feetech STS3250, mass and arm not given", large, "per I", "-"),
        row("arm of a rotary pendulum, mass and arm not given", arm, "per I", "-"),
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
