"""A board as an MJCF file: its comments state the source of the numbers, and their error."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from sim.board.bodies import Coupling, substituted
from sim.board.scene import board_spec, rig_spec
from sim.compensation.scene import Export, compensate
from sim.compensation.step import Compensation
from sysid.board import Board
from sysid.effects import effect
from sysid.errors import SysidError

Kind = Literal["bench", "scene"]
"""The clamped free-decay rig, or the free board with trucks and wheels on the ground."""

FINE_STEP = 0.001
"""Largest step for which a bench is written with its physical parameters [s]. Its decay is off by 0.7 % (pink) and 1.1 % (black);
at twice the step black exceeds the gate's 2 %."""


@dataclass(frozen=True, slots=True)
class Mjcf:
    """The file, and notes for the user."""

    xml: str
    compensation: Compensation
    """The written parameters and both errors."""
    export: Export
    substitutes: tuple[str, ...] = ()
    """The substitute of each effect that MuJoCo lacks."""

    def to_json(self) -> dict[str, Any]:
        """Return the written numbers and what the step costs, for JSON."""
        done = self.compensation
        return {
            "export": self.export,
            "substitutes": self.substitutes,
            "written": {
                "stiffness_nm_rad": done.board.stiffness,
                "damping_nms_rad": done.board.damping,
                "inertia_kgm2": done.board.inertia.value,
            },
            "decay_nrmse": done.decay_error,
            "decay_nrmse_uncompensated": done.decay_error_before,
            "static_stiffness_error": done.static_error,
        }


def board_mjcf(
    board: Board, kind: Kind, *, timestep: float = 0.005, integrator: str = "implicitfast",
    export: Export | None = None, coupling: Coupling = "equality",
) -> Mjcf:  # fmt: skip
    """Write a board as MJCF, for MuJoCo 3.11 and newer.

    Args:
        timestep: [s].
        export: Which parameters are written. By default in-scene for a scene; for a bench physical up to `FINE_STEP`,
            step-compensated above.

    Raises:
        SysidError: The board cannot be built so, or `export` does not go with `kind`.
    """
    if board.slides:
        raise SysidError(
            f"'{board.name}' slides, and a {kind} is made with a hinge. `husky-sysid fit` writes the joint into a copy of its model "
            "(-o FILE)."
        )
    if export is None:
        fine = timestep <= FINE_STEP
        export = "in-scene" if kind == "scene" else "physical" if fine else "step-compensated"
    if export == "in-scene" and kind == "bench":
        raise SysidError(
            "--export in-scene compensates for wheels and coupling, which a bench has not. Leave --bench out."
        )
    step: dict[str, Any] = {"timestep": timestep, "integrator": integrator}
    done = compensate(board, export, coupling=coupling, **step)
    written = done.board
    spec = board_spec(written, coupling=coupling, **step) if kind == "scene" else rig_spec(written, **step)
    spec.compile()
    # XML forbids two hyphens in a row in a comment.
    comments = (re.sub("-(?=-)", "- ", line) for line in _comments(board, done, kind, export, coupling))
    xml = "".join(f"<!-- {line} -->\n" for line in comments) + spec.to_xml()
    return Mjcf(xml, done, export, substituted(board))


def _comments(
    board: Board, done: Compensation, kind: Kind, export: Export, coupling: Coupling
) -> Iterator[str]:
    """Yield the comments of a file: source, measured and written numbers, effects."""
    written, tilt = done.board, board.tilt
    yield f"Board '{board.name}': {board.description}. Source: {board.source}."
    yield f"Made by husky-sysid mjcf: {kind}, {export}. Units: m, kg, s, rad. Positive roll: right edge down."
    for line in done.lines():
        yield f"{line[0].upper()}{line[1:]}."
    if kind == "scene" and coupling == "direct":
        yield "The truck angles are set from outside after each step: tan(truck) = tan(rake) sin(roll)."
    yield f"Measured: roll inertia {board.inertia} ({board.inertia.method}), stiffness {tilt['stiffness']}, damping {tilt['damping']}."
    yield f"Written: roll inertia {written.inertia.value:.6g}, trucks included, damping {written.damping:.6g}."
    if fitted := board.fit.get("logs"):
        logs = ", ".join(str(log["path"]) for log in fitted)
        yield f"Fitted to {logs}, {board.fit.get('date', 'date unknown')}."
    for part in board.effects:
        values = ", ".join(f"{key} {quantity}" for key, quantity in part.parameters.items())
        yield f"Effect {part.name}: {values}; {effect(part.name).mujoco.written}."
