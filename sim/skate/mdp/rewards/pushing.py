"""Pushing: fast enough, straight, with a foot that swings and lands flat."""

from collections.abc import Iterator
from typing import Any

from sim.skate.arrays import namespace, wrap_angle
from sim.skate.mdp.rewards._base import Reward, Rewards, Task, kernel, number
from sim.skate.mdp.state import SkateState


def board_velocity(state: SkateState, tolerance: float = 0.25) -> Any:
    """The board moves forward as fast as told, neither sideways nor up; `tolerance` [m^2/s^2]."""
    velocity = state.board_velocity
    forward = state.commanded_speed - velocity[..., 0]
    return kernel(forward**2 + velocity[..., 1] ** 2 + velocity[..., 2] ** 2, tolerance)


def speed_error(state: SkateState, most: float = 2.0) -> Any:
    """Error of the board's speed [m/s], up to `most`: braking pays at any speed below that."""
    xp = namespace(state.tilt)
    return xp.clip(xp.abs(state.board_velocity[..., 0] - state.commanded_speed), None, most)


def facing_forward(state: SkateState, tolerance: float = 0.5) -> Any:
    """The robot faces where the board points; `tolerance` [rad]."""
    return kernel(namespace(state.tilt).abs(wrap_angle(state.robot_heading - state.board_heading)), tolerance)


def air_time(state: SkateState, shortest: float = 0.1, longest: float = 0.5) -> Any:
    """The pushing foot swings, neither tapping nor resting: its time in the air is in between [s]."""
    return number((state.left_air_time > shortest) & (state.left_air_time < longest))


def hasty_swing(state: SkateState, too_fast: float = 0.05) -> Any:
    """Reward of a swing while the board is over `too_fast` [m/s] too fast, to be taken back: braking costs nothing.

    Where braking was paid like a swing, policies rode 0.1 m/s too fast to be paid for both; with 0.1 m/s they
    rode 0.08 too fast.
    """
    return air_time(state) * (state.board_velocity[..., 0] > state.commanded_speed + too_fast)


def flat_push(state: SkateState, tolerance: float = 5e-4) -> Any:
    """The pushing foot meets the ground with its whole sole: variance of four heights below `tolerance` [m^2]."""
    heights = state.left_sole_heights
    mean = heights.mean(axis=-1)[..., None]
    variance = ((heights - mean) ** 2).sum(axis=-1) / (heights.shape[-1] - 1)
    return number((variance < tolerance) & state.foot_on_ground[..., 0])


def left_foot_on_deck(state: SkateState) -> Any:
    """1 while the left foot stands on the deck: right while steering, wrong while pushing."""
    return number(state.foot_on_deck[..., 0])


def _terms(task: Task) -> Iterator[Reward]:
    yield Reward(
        "push/board_velocity", board_velocity, "push", 3.0, {"tolerance": task.options.speed_tolerance}
    )
    # The wide kernel leads there from rest, the narrow one pays for the last 0.2 m/s.
    yield Reward("push/exact_velocity", board_velocity, "push", 3.0, {"tolerance": 0.02})
    # Beginners whom a wrong speed costs, and who earn no swing above it, tap along with the foot at the ground.
    yield Reward("push/speed_error", speed_error, "push", -24.0, beginner=0.0)
    yield Reward("still/speed_error", speed_error, "still", -8.0, beginner=0.0)
    yield Reward("push/facing_forward", facing_forward, "push", 2.0)
    yield Reward("push/left_foot", left_foot_on_deck, "push", -12.0)
    yield Reward("push/air_time", air_time, "push", 3.0)
    yield Reward("push/hasty_swing", hasty_swing, "push", -3.0, beginner=0.0)
    yield Reward("push/flat_push", flat_push, "push", 0.5)


REWARDS = Rewards(order=1, terms=_terms)
