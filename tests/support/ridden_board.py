"""What the board's spring means under a rider: its share of the roll stiffness while the board rolls.

A rider who stands rigidly on the deck, with mass m at height h above its tilt axis, feels three torques for a tilt γ:

* the spring, k γ, which rights the deck;
* gravity, m g h γ, which topples;
* the turn. Both trucks steer by σ with tan σ = tan λ sin γ, the board turns at ψ̇ = 2 v tan λ sin γ / L
  (`sim.skate.cycle.tilt_guidance`), and the rider's mass resists the acceleration v ψ̇ of the deck below it. That rights with
  2 m h v² tan λ / L.

So the deck's stiffness under a rider is k − m g h + 2 m h v² tan λ / L. Steering rights, and with the square of the speed;
from a critical speed on, a rigid rider stands by steering alone.
"""

import math
from dataclasses import dataclass

from sysid.board import Board

GRAVITY = 9.81
"""[m/s^2]"""


@dataclass(frozen=True, slots=True)
class Rider:
    """A rigid rider."""

    mass: float
    """[kg]"""
    height: float
    """Of the centre of mass above the tilt axis [m]."""


def toppling(rider: Rider) -> float:
    """Return by how much gravity lessens the roll stiffness [N*m/rad]."""
    return rider.mass * GRAVITY * rider.height


def steering_stiffness(board: Board, rider: Rider, speed: float) -> float:
    """Return the roll stiffness that steering adds at a speed [m/s], in N*m/rad."""
    rake, wheelbase = board.geometry["rake"].value, board.geometry["wheelbase"].value
    return 2 * rider.mass * rider.height * speed**2 * math.tan(rake) / wheelbase


def ridden_stiffness(board: Board, rider: Rider, speed: float) -> float:
    """Return the whole roll stiffness under a rider at a speed [m/s], in N*m/rad; negative where the rider topples."""
    return board.stiffness - toppling(rider) + steering_stiffness(board, rider, speed)


def critical_speed(board: Board, rider: Rider) -> float:
    """Return the speed from which on a rigid rider does not topple [m/s]; 0 where the spring alone holds."""
    missing = toppling(rider) - board.stiffness
    return math.sqrt(max(missing, 0.0) / steering_stiffness(board, rider, 1.0))


def equivalent_speed_change(board: Board, rider: Rider, speed: float, stiffness: float) -> float:
    """Return the relative change of speed that acts as a change of the spring [N*m/rad] does."""
    return stiffness / (2 * steering_stiffness(board, rider, speed))
