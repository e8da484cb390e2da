# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""Boards drawn from the uncertainty of one board's identification.

Every draw is a whole record, built and compiled like the original, so that every effect reaches the simulator the
same way, tendons included. Positive quantities are drawn in their logarithm: a spring, a damper or a friction never
turns negative. The others are normal.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from sim.board.learned import left_out
from sim.board.scene import board_spec
from sysid.board import Board, BoardEffect
from sysid.effects import effect
from sysid.quantity import Quantity
from sysid.roll import Array

FIELDS = {
    "jnt_stiffness": "joint", "jnt_stiffnesspoly": "joint", "dof_damping": "dof", "dof_dampingpoly": "dof",
    "dof_frictionloss": "dof", "qpos_spring": "qpos", "body_inertia": "body", "eq_data": "equality",
    "tendon_stiffness": "tendon", "tendon_lengthspring": "tendon", "tendon_frictionloss": "tendon",
}  # fmt: skip
"""Arrays of a MuJoCo model in which drawn boards differ, and the kind of element that each belongs to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """How widely to draw: the record's standard deviations, but not less than these."""

    relative: float = 0.05
    """Least relative standard deviation of stiffness, damping and effect parameters: a board ages, warms up and is
    tightened by hand."""
    inertia: float = 0.02
    """Least relative standard deviation of the roll inertia."""
    rest_angle: float = 0.005
    """Least standard deviation of the rest angle [rad]."""
    rake: float = 0.02
    """Least standard deviation of the rake [rad]: the trucks' pivots are set by hand."""
    truncate: float = 2.5
    """Draws lie within so many standard deviations."""


@dataclass(frozen=True, slots=True)
class BoardDraws:
    """MuJoCo's numbers of m drawn boards."""

    fields: Mapping[str, Array]
    """Arrays of `FIELDS`, each of shape (m, elements, ...)."""
    elements: Mapping[str, tuple[str, ...]]
    """Names of the elements of each kind, in the order of the second axis."""
    learned_dampers: Array
    """(m, torques, 3), polynomials of the rate that stand for learned torques [N*m and rad/s]."""


def draw_boards(board: Board, count: int, spread: Spread, rng: np.random.Generator) -> list[Board]:
    """Return boards whose tilt joint, inertia and rake are drawn about the record."""

    def draw(quantity: Quantity, least: float, *, positive: bool) -> Quantity:
        std = max(quantity.std if np.isfinite(quantity.std) else 0.0, least)
        step = float(np.clip(rng.standard_normal(), -spread.truncate, spread.truncate))
        if not positive:
            return replace(quantity, value=quantity.value + std * step)
        if quantity.value == 0:
            return quantity
        width = np.sqrt(np.log1p((std / quantity.value) ** 2))
        return replace(quantity, value=quantity.value * float(np.exp(width * step)))

    def draw_effect(part: BoardEffect) -> BoardEffect:
        known = effect(part.name)
        if known.role == "learned":  # a table stays as it is
            return part
        low = {parameter.name: parameter.low for parameter in known.parameters}
        high = {p.name: p.high if p.unit in ("", "1") else np.inf for p in known.parameters}
        drawn = {
            name: draw(quantity, spread.relative * abs(quantity.value), positive=low.get(name, -1.0) >= 0)
            for name, quantity in part.parameters.items()
        }
        within = {
            name: replace(q, value=min(q.value, max(high.get(name, np.inf), part.parameters[name].value)))
            for name, q in drawn.items()
        }
        return replace(part, parameters=within)

    def one() -> Board:
        tilt = {
            name: draw(board.tilt[name], spread.relative * board.tilt[name].value, positive=True)
            for name in ("stiffness", "damping")
        }
        tilt["rest_angle"] = draw(board.tilt["rest_angle"], spread.rest_angle, positive=False)
        effects = tuple(map(draw_effect, board.effects))
        inertia = draw(board.inertia, spread.inertia * board.inertia.value, positive=True)
        geometry = {**board.geometry, "rake": draw(board.geometry["rake"], spread.rake, positive=True)}
        return replace(board.with_tilt(**tilt), effects=effects, inertia=inertia, geometry=geometry)

    return [one() for _ in range(count)]


def board_draws(boards: list[Board], timestep: float) -> BoardDraws:
    """Compile each board and read the numbers in which boards may differ.

    Args:
        timestep: Step of the scene they are for [s].
    """
    models = [board_spec(board, ground=False, timestep=timestep).compile() for board in boards]
    elements = {kind: _names(models[0], kind) for kind in dict.fromkeys(FIELDS.values())}
    fields = {
        name: np.array([read(model, name, elements[kind]) for model in models])
        for name, kind in FIELDS.items()
    }
    dampers = np.array([[left.damper for *_, left in left_out(model)] for model in models])
    return BoardDraws(fields, elements, dampers)


def read(model: mujoco.MjModel, field: str, names: tuple[str, ...]) -> Array:
    """Return the rows of one of `FIELDS` that belong to the named elements."""
    return np.array([getattr(model, field)[index_of(model, FIELDS[field], name)] for name in names])


def index_of(model: mujoco.MjModel, kind: str, name: str) -> int:
    """Return the row of an element: of a joint, its number, its first degree of freedom or its place in qpos."""
    if kind in ("dof", "qpos"):
        joint = model.joint(name)
        return int((joint.dofadr if kind == "dof" else joint.qposadr)[0])
    return int(getattr(model, kind)(name).id)


def _names(model: mujoco.MjModel, kind: str) -> tuple[str, ...]:
    """Return the names of a model's elements of a kind; of joints, those of one degree of freedom."""
    if kind in ("joint", "dof", "qpos"):
        joints = (model.joint(i) for i in range(model.njnt))
        return tuple(joint.name for joint in joints if joint.type[0] != mujoco.mjtJoint.mjJNT_FREE)
    counts: dict[str, Any] = {
        "body": (1, model.nbody),
        "equality": (0, model.neq),
        "tendon": (0, model.ntendon),
    }
    return tuple(getattr(model, kind)(i).name for i in range(*counts[kind]))
