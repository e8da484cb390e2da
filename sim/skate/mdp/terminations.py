"""When an episode ends early."""

import math
from typing import Any

from sim.skate.arrays import namespace
from sim.skate.mdp.state import SkateState

FALLEN_INCLINATION = math.radians(70)
"""Inclination of the pelvis that ends an episode [rad]."""
SETTLING_STEPS = 5
"""Policy steps after a start in which unloaded feet are no failure: the robot has only just been set down."""


def fallen(state: SkateState) -> Any:
    """The pelvis leans further than `FALLEN_INCLINATION` from upright, bool (n,)."""
    return state.upright < math.cos(FALLEN_INCLINATION)


def off_board(state: SkateState, steps_before: Any) -> Any:
    """Return for how many steps both feet have been off the deck, integers (n,); `steps_before` is the count before this one."""
    return (steps_before + 1) * ~state.foot_on_deck.any(axis=-1)


def runaway(state: SkateState, speed: float) -> Any:
    """The board rolls faster than `speed` [m/s], as down a long slope, bool (n,)."""
    return abs(state.board_velocity[..., 0]) > speed


def body_contact(state: SkateState) -> Any:
    """Something of the robot but its feet touches ground or board, bool (n,)."""
    return state.other_contacts > 0


def idle_foot(state: SkateState, patience: Any) -> Any:
    """The pushing foot has not touched the ground for longer than `patience` [s] of pushing, bool (n,).

    Rolling on one leg is stable and keeps most of the speed of the first pushes: a learner that finds it stops
    pushing.
    """
    idle = namespace(state.left_air_time).where(
        state.left_air_time < state.time_in_push, state.left_air_time, state.time_in_push
    )
    return state.pushing & (idle > patience)


def wrong_stance(state: SkateState, steps_before: Any) -> Any:
    """Return for how many steps the left foot has not been where the cycle wants it, integers (n,).

    While steering it belongs on the deck, while pushing off it. Riding on one leg all the time is stable
    and earns most of the reward; so does staying on the board and wriggling it forward. A learner that
    has found either does not look for more; ending such episodes after a while leaves it no choice.
    Every step in the right stance takes one step off the count, so that hopping does not clear it.

    Args:
        steps_before: The count one step earlier, integers (n,).
    """
    left = state.foot_on_deck[..., 0]
    wrong = (state.steering & ~left) | (state.pushing & left)
    counted = state.steering | state.pushing
    return namespace(steps_before).clip(steps_before + 2 * wrong - 1, 0, None) * counted
