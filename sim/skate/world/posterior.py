# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""Boards drawn from the uncertainty of one board's identification.

Every draw is a whole record, built and compiled like the original, so that whatever effect the record
carries reaches the simulator the same way; what differs between the draws are numbers of the tilt joint
and of the deck.
"""

from dataclasses import dataclass, replace

import numpy as np

from sim.board.learned import left_out
from sim.board.scene import TILT_JOINT, board_spec
from sysid.board import Board, BoardEffect
from sysid.effects import effect
from sysid.quantity import Quantity
from sysid.roll import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """How widely to draw: the record's standard deviations, but not less than these."""

    relative: float = 0.05
    """Least standard deviation of stiffness, damping and effect parameters, relative to their value: a
    board ages, warms up and is tightened by hand."""
    inertia: float = 0.02
    """Least relative standard deviation of the roll inertia."""
    rest_angle: float = 0.005
    """Least standard deviation of the rest angle [rad]."""
    rake: float = 0.02
    """Least standard deviation of the rake [rad]: the trucks' pivots are set by hand."""
    truncate: float = 2.5
    """Draws lie within so many standard deviations."""


@dataclass(frozen=True, slots=True)
class TiltDraws:
    """MuJoCo's numbers of tilt joint, deck and coupling for m boards."""

    stiffness: Array
    """(m,) [N*m/rad]."""
    stiffness_polynomial: Array
    """(m, 2)."""
    damping: Array
    """(m,) [N*m*s/rad]."""
    damping_polynomial: Array
    """(m, 2)."""
    friction: Array
    """(m,) [N*m]."""
    rest_angle: Array
    """(m,) [rad], as roll."""
    deck_inertia: Array
    """(m, 3) [kg*m^2], principal."""
    coupling: Array
    """(m, 5), polynomial of the trucks' angle in the roll."""
    learned_dampers: Array
    """(m, torques, 3), polynomials of the rate that stand for learned torques [N*m and rad/s]."""


def draw_boards(board: Board, count: int, spread: Spread, rng: np.random.Generator) -> list[Board]:
    """Return boards whose tilt joint, inertia and rake are normal draws about the record."""

    def draw(quantity: Quantity, least: float) -> Quantity:
        std = max(quantity.std if np.isfinite(quantity.std) else 0.0, least)
        step = np.clip(rng.standard_normal(), -spread.truncate, spread.truncate)
        return replace(quantity, value=quantity.value + std * step)

    def draw_effect(part: BoardEffect) -> BoardEffect:
        role = effect(part.name).role
        if role == "learned":  # a table stays as it is: its tendons are the same in all worlds
            return part
        drawn = {
            name: draw(quantity, spread.relative * abs(quantity.value))
            for name, quantity in part.parameters.items()
        }
        return BoardEffect(part.name, drawn)

    boards: list[Board] = []
    for _ in range(count):
        tilt = {
            name: draw(board.tilt[name], spread.relative * board.tilt[name].value)
            for name in ("stiffness", "damping")
        }
        tilt["rest_angle"] = draw(board.tilt["rest_angle"], spread.rest_angle)
        effects = tuple(map(draw_effect, board.effects))
        inertia = draw(board.inertia, spread.inertia * board.inertia.value)
        geometry = {**board.geometry, "rake": draw(board.geometry["rake"], spread.rake)}
        drawn = replace(board.with_tilt(**tilt), effects=effects, inertia=inertia, geometry=geometry)
        boards.append(drawn)
    return boards


def tilt_draws(boards: list[Board], timestep: float) -> TiltDraws:
    """Compile each board and read the numbers of its tilt joint, deck and coupling.

    Args:
        timestep: Step of the scene they are for [s].
    """
    columns: dict[str, list[Array]] = {name: [] for name in TiltDraws.__dataclass_fields__}
    for board in boards:
        model = board_spec(board, ground=False, timestep=timestep).compile()
        joint = model.joint(TILT_JOINT)
        dof, deck = joint.dofadr[0], model.body("deck").id
        columns["stiffness"].append(model.jnt_stiffness[joint.id])
        columns["stiffness_polynomial"].append(model.jnt_stiffnesspoly[joint.id].copy())
        columns["damping"].append(model.dof_damping[dof])
        columns["damping_polynomial"].append(model.dof_dampingpoly[dof].copy())
        columns["friction"].append(model.dof_frictionloss[dof])
        columns["rest_angle"].append(model.qpos_spring[joint.qposadr[0]])
        columns["deck_inertia"].append(model.body_inertia[deck].copy())
        columns["coupling"].append(model.eq_data[0, :5].copy())
        columns["learned_dampers"].append(np.array([left.damper for *_, left in left_out(model)]))
    return TiltDraws(**{name: np.asarray(values, dtype=np.float64) for name, values in columns.items()})
