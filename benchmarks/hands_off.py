"""What the simulated board does by itself under a load: how it turns, coasts, decays and what energy it has left.

Run `python benchmarks/hands_off.py`; it takes seconds and writes `results/hands_off.md`.
"""

# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from pages import table, write_result

from sim.board.scene import TILT_JOINT, WHEELS, board_spec
from sim.skate.world.scene import SceneOptions, as_written
from sysid.board import Board, load_board
from sysid.roll import Array
from sysid.workspace import shipped_data

LOAD = 40.0
"""[kg]."""
TILTS_DEG, SPEEDS = (2.0, 4.0, 8.0), (0.5, 1.0, 2.0)
HOLDING = 5e3
"""Stiffness of the spring that holds the tilt in place of a rider [N*m/rad]."""


@dataclass(frozen=True, slots=True)
class Rolling:
    """A board that was let go, one row a step of the simulation."""

    time: Array
    """[s], (t,)."""
    position: Array
    """On the ground [m], (t, 2)."""
    speed: Array
    """[m/s], (t,)."""
    roll: Array
    """[rad], (t,)."""
    energy: Array
    """Kinetic, of height, and of springs [J], (t,)."""

    def radius(self, settled: float = 0.5) -> float:
        """Return the radius of the circle through the path after `settled` s [m]."""
        x, y = self.position[self.time >= settled].T
        (a, b, c), *_ = np.linalg.lstsq(
            np.column_stack([2 * x, 2 * y, np.ones_like(x)]), x**2 + y**2, rcond=None
        )
        return math.sqrt(c + a**2 + b**2)

    def deceleration(self) -> float:
        """Return the mean loss of speed [m/s^2]."""
        return float((self.speed[0] - self.speed[-1]) / (self.time[-1] - self.time[0]))

    def largest_rise(self) -> float:
        """Return how far the energy ever rises above what it has been before [J]."""
        return float((self.energy - np.minimum.accumulate(self.energy)).max())


def let_go(
    board: Board,
    *,
    load: float = LOAD,
    speed: float = 0.0,
    tilt: float = 0.0,
    held: bool = False,
    time: float,
) -> Rolling:
    """Let a loaded board roll along x on level ground.

    Args:
        board: What the scene holds.
        load: Mass on the level part of the board [kg].
        speed: At the start [m/s].
        tilt: Roll at the start [rad].
        held: Hold it there by a stiff spring.
        time: How long [s].
    """
    spec = board_spec(board)
    if load > 0:  # a body of its own: what has an explicit inertia takes no mass from its geoms
        spec.body("board").add_body().add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.2, 0.1, 0.05], mass=load, contype=0, conaffinity=0
        )
    joint = spec.joint(TILT_JOINT)
    if held:
        joint.stiffness[0], joint.damping[0], joint.springref = HOLDING, HOLDING / 100, tilt
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[model.joint(TILT_JOINT).qposadr[0]] = tilt
    data.qvel[0] = speed
    for wheel in WHEELS:
        data.joint(f"{wheel}_wheel_joint").qvel[0] = speed / board.geometry["wheel_radius"].value
    rows: list[tuple[float, ...]] = []
    for _ in range(round(time / model.opt.timestep)):
        mujoco.mj_step(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        velocity = float(np.hypot(*data.qvel[:2]))
        roll = float(data.joint(TILT_JOINT).qpos[0])
        rows.append((data.time, *data.qpos[:2], velocity, roll, float(data.energy.sum())))
    t, x, y, v, roll, energy = np.array(rows).T
    return Rolling(t, np.column_stack([x, y]), v, roll, energy)


def theoretical_radius(board: Board, roll: float) -> float:
    """Return the radius of the turn of two trucks steered by tan σ = tan λ sin roll [m]."""
    rake, wheelbase = board.geometry["rake"].value, board.geometry["wheelbase"].value
    return wheelbase / (2 * math.tan(rake) * math.sin(roll))


def main() -> None:
    """Write the table."""
    turns: list[tuple[str, ...]] = []
    records = (load_board(shipped_data() / "boards" / f"{name}.toml") for name in ("pink", "black"))
    boards = [as_written(record, SceneOptions()) for record in records]  # as training has them
    for board in boards:
        for tilt in TILTS_DEG:
            for speed in SPEEDS:
                run = let_go(board, speed=speed, tilt=math.radians(tilt), held=True, time=2.5)
                radius, theory = run.radius(), theoretical_radius(board, float(run.roll[-1]))
                off, rise = radius / theory - 1, run.largest_rise() / run.energy[0]
                turns.append(
                    (board.name, f"{tilt:g}", f"{speed:g}", f"{radius:.3f}", f"{theory:.3f}", f"{100 * off:+.2f} %", f"{100 * rise:.3f} %")
                )  # fmt: skip
    coasts: list[tuple[str, ...]] = []
    for load in (0.0, LOAD):
        losses = [let_go(boards[0], load=load, speed=speed, time=1.0).deceleration() for speed in SPEEDS]
        coasts.append((f"{load:g}", *(f"{loss:.3f} m/s²" for loss in losses)))
    head = ("board", "tilt [°]", "speed [m/s]", "radius [m]", "theory [m]", "off by", "energy rises by")
    write_result(
        "hands_off.md",
        f"""# The board by itself

A load of {LOAD:g} kg on it, nobody steering; `benchmarks/hands_off.py` writes this file.

Turning: radius of the path against L / (2 tan λ sin tilt), the tilt held by a spring; and how far the
energy ever rises, as a share of what there is.

{table(head, turns)}

Coasting straight: mean loss of speed in the first second.

{table(("load [kg]", *(f"from {speed:g} m/s" for speed in SPEEDS)), coasts)}""",
    )


if __name__ == "__main__":
    main()
