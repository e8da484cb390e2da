"""A board as a readable MJCF file: comments state the source of each number and its error."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import mujoco

from sim.board.bench import rig_spec
from sim.board.bodies import STEERED_SHARE, Coupling, reflected_inertia, substituted
from sim.board.scene import board_spec, coupling_polynomial
from sim.compensation.scene import Export, compensate
from sim.compensation.step import Compensation
from sysid.board import Board
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.quantity import Quantity

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


def default_export(kind: Kind, timestep: float) -> Export:
    """Return the default export."""
    if kind == "scene":
        return "in-scene"
    return "physical" if timestep <= FINE_STEP else "step-compensated"


def board_mjcf(
    board: Board, kind: Kind, *, timestep: float = 0.005, integrator: str = "implicitfast",
    export: Export | None = None, coupling: Coupling = "equality",
) -> Mjcf:  # fmt: skip
    """Write a board as MJCF, for MuJoCo 3.11 and newer.

    Args:
        timestep: [s].
        export: Which parameters are written; `default_export` if None.

    Raises:
        SysidError: The board cannot be built so, or `export` does not go with `kind`.
    """
    if board.slides:
        raise SysidError(
            f"'{board.name}' slides, and a {kind} is made with a hinge. `husky-sysid fit` writes the joint into a copy of its model "
            "(-o FILE)."
        )
    export = export or default_export(kind, timestep)
    if export == "in-scene" and kind == "bench":
        raise SysidError(
            "--export in-scene compensates for wheels and coupling, which a bench has not. Add --scene."
        )
    step: dict[str, Any] = {"timestep": timestep, "integrator": integrator}
    done = compensate(board, export, coupling=coupling, **step)
    written = done.board
    spec = board_spec(written, coupling=coupling, **step) if kind == "scene" else rig_spec(written, **step)
    comments = _comments(board, done, kind, export, coupling)
    return Mjcf(_commented(spec, comments), done, export, substituted(board))


def _commented(spec: mujoco.MjSpec, comments: Sequence[tuple[str, Sequence[str]]]) -> str:
    """Write the spec, each comment above its element."""
    spec.compile()
    xml = spec.to_xml()
    for pattern, lines in comments:
        found = re.search(pattern, xml, re.M)
        if found is None:
            continue
        # XML forbids two hyphens in a row in a comment.
        text = "".join(f"{found[1]}<!-- {re.sub('-(?=-)', '- ', line)} -->\n" for line in lines)
        xml = xml[: found.start()] + text + xml[found.start() :]
    return xml


def _comments(
    board: Board, done: Compensation, kind: Kind, export: Export, coupling: Coupling
) -> list[tuple[str, list[str]]]:
    """Return a pattern of each commented line, and the comment above it."""
    written = done.board
    head = [
        f"Board '{board.name}': {board.description}. Source: {board.source}.",
        f"Made by husky-sysid mjcf: {kind}, {export}. Units: m, kg, s, rad. Positive roll: right edge down.",
        *(f"{line[0].upper()}{line[1:]}." for line in done.lines()),
    ]
    if kind == "scene" and coupling == "direct":
        head.append(
            "The truck angles are set from outside after each step: tan(truck) = tan(rake) sin(roll)."
        )
    inertia = [f"Measured: roll inertia {_text(board.inertia)} ({board.inertia.method})."]
    if kind == "scene" and coupling == "equality":
        inertia.append(
            f"{reflected_inertia(board):.3g} kg·m² of it belong to trucks and wheels, which steer as the deck tilts; the rest is "
            "the deck's own."
        )
    tilt = [
        f"Measured: stiffness {_text(board.tilt['stiffness'])}, damping {_text(board.tilt['damping'])}, "
        f"rest angle {_text(board.tilt['rest_angle'])}.",
        f"Written: damping {written.damping:.6g}, roll inertia {written.inertia.value:.6g}; stiffness as measured.",
    ]
    fitted = board.fit.get("logs")
    if fitted:
        tilt.append(
            f"Fitted to {', '.join(str(log['path']) for log in fitted)}, {board.fit.get('date', 'date unknown')}."
        )
    tilt += [
        f"Effect {part.name}: "
        + ", ".join(f"{key} {_text(q)}" for key, q in part.parameters.items())
        + f"; {effect(part.name).mujoco.written}."
        for part in board.effects
    ]
    comments = [
        (r"^([ \t]*)<joint name=\"board_tilt_joint\"", tilt),
        (r"^([ \t]*)<body name=\"deck\"", inertia),
        (r"^()<mujoco", head),
    ]
    if kind == "bench":
        return comments
    _, error = coupling_polynomial(board.geometry["rake"].value, board.tilt["range"].value)
    return [
        (r"^([ \t]*)<equality>", [
            f"tan(truck) = tan(rake) sin(roll), rake {_text(board.geometry['rake'])}; the polynomial is off by at most "
            f"{error:.1e} rad within the tilt range."
        ]),
        (r"^([ \t]*)<body name=\"front_truck\"", [
            f"Trucks and wheels: {100 * STEERED_SHARE:g} % of their mass steers, the rest is in the body 'board'. The measured roll "
            "inertia holds their share already."
        ]),
        *comments,
    ]  # fmt: skip


def _text(quantity: Quantity) -> str:
    return str(quantity)
