"""Pushing: strides that push, not taps that hold the speed.

The speed is paid as its mean over a stride, because a push speeds the board up and it slows down until the next.
Contacts are paid too: a foot that stands without slipping while the board passes it, swings, and comes down seldom and
at the ground's speed. Contacts and style count as far as the speed is held, else marching on the spot earns them.
"""

from collections.abc import Iterator
from typing import Any

from sim.skate.arrays import namespace, wrap_angle
from sim.skate.mdp.rewards._base import Reward, Rewards, Task, kernel, number
from sim.skate.mdp.state import SkateState


def board_velocity(state: SkateState, tolerance: float = 0.25) -> Any:
    """The board's mean speed is the commanded one, and it moves neither sideways nor up; `tolerance` [m^2/s^2]."""
    velocity = state.board_velocity
    forward = state.commanded_speed - state.mean_speed
    return kernel(forward**2 + velocity[..., 1] ** 2 + velocity[..., 2] ** 2, tolerance)


def speed_error(state: SkateState, most: float = 2.0) -> Any:
    """Error of the board's mean speed [m/s], up to `most`."""
    xp = namespace(state.tilt)
    return xp.clip(xp.abs(state.mean_speed - state.commanded_speed), None, most)


def facing_forward(state: SkateState, tolerance: float = 0.5) -> Any:
    """The robot faces where the board points; `tolerance` [rad]."""
    return kernel(namespace(state.tilt).abs(wrap_angle(state.robot_heading - state.board_heading)), tolerance)


def holds_speed(state: SkateState, tolerance: float) -> Any:
    """How well the mean speed is the commanded one, from 0 to 1; `tolerance` [m^2/s^2]."""
    return kernel((state.commanded_speed - state.mean_speed) ** 2, tolerance)


def swing(state: SkateState, tolerance: float = 0.25, shortest: float = 0.2, longest: float = 0.6) -> Any:
    """The pushing foot swings as the clips' does, for 0.46 to 0.50 s: its time in the air is in between [s]."""
    swings = (state.left_air_time > shortest) & (state.left_air_time < longest)
    return number(swings) * holds_speed(state, tolerance)


def stance(
    state: SkateState,
    tolerance: float = 0.25,
    shortest: float = 0.1,
    longest: float = 0.6,
    load: float = 0.15,
    sliding: float = 0.2,
    reach: float = 0.4,
) -> Any:
    """The pushing foot stands as the clips' does, for 0.35 to 0.44 s, under load and without slipping.

    It pays in proportion to the way that the foot has gone back along the board, so one long push earns more than two short
    ones.

    Args:
        tolerance: Of the speed [m^2/s^2].
        shortest: Time on the ground from which it pays [s].
        longest: Time on the ground up to which it pays [s].
        load: Share of the robot's weight that pays in full.
        sliding: Tolerance of the slip [m/s].
        reach: Way that pays in full [m]; the clips' is 0.33 to 0.50.
    """
    xp = namespace(state.tilt)
    carried = xp.clip(state.ground_load[..., 0] / load, None, 1.0)
    way = xp.clip(state.left_travel / reach, None, 1.0)
    lasts = (state.left_ground_time > shortest) & (state.left_ground_time < longest)
    return number(lasts) * way * carried * kernel(state.left_slip, sliding) * holds_speed(state, tolerance)


def slip(state: SkateState) -> Any:
    """Speed of the pushing foot over the ground [m/s], weighted by its load."""
    return state.ground_load[..., 0] * state.left_slip


def touchdown(state: SkateState) -> Any:
    """1 in the step in which the pushing foot comes down."""
    return number(state.left_touchdown)


def landing(state: SkateState) -> Any:
    """Speed at which the pushing foot meets the ground [m/s], in the step in which it comes down.

    The slip of a stride is made here. In the first sixth of a stance the sole slips 0.1 to 0.4 m/s under its largest load.
    Later it slips 0.02 to 0.05 m/s.
    """
    return number(state.left_touchdown) * state.left_landing_speed


def flat_push(state: SkateState, tolerance: float = 5e-4) -> Any:
    """The pushing foot meets the ground with its whole sole: variance of four heights below `tolerance` [m^2]."""
    heights = state.left_sole_heights
    mean = heights.mean(axis=-1)[..., None]
    variance = ((heights - mean) ** 2).sum(axis=-1) / (heights.shape[-1] - 1)
    return number((variance < tolerance) & state.foot_on_ground[..., 0])


def left_foot_on_deck(state: SkateState) -> Any:
    """1 while the left foot stands on the deck, which is wrong while pushing."""
    return number(state.foot_on_deck[..., 0])


def _terms(task: Task) -> Iterator[Reward]:
    options = task.options
    yield Reward("push/board_velocity", board_velocity, "push", 3.0, {"tolerance": options.speed_tolerance})
    # The wide kernel leads there from rest, the narrow one pays for the last 0.2 m/s.
    yield Reward("push/exact_velocity", board_velocity, "push", 3.0, {"tolerance": 0.02})
    yield Reward("push/speed_error", speed_error, "push", -12.0, beginner=0.0)
    yield Reward("still/speed_error", speed_error, "still", -8.0, beginner=0.0)
    yield Reward("push/facing_forward", facing_forward, "push", 2.0)
    yield Reward("push/left_foot", left_foot_on_deck, "push", -12.0)
    wide = {"tolerance": options.speed_tolerance}
    yield Reward("push/swing", swing, "push", 4.0, wide)
    yield Reward("push/stance", stance, "push", options.stance, wide)
    # A contact costs the same in every phase: where the transition was free, the left foot left the deck 0.3 s early to land
    # there. Beginners pay less for a bad contact: a foot that never comes down slips least.
    for what, cost in ((slip, options.slip), (touchdown, options.touchdown), (landing, options.landing)):
        yield Reward(f"moving/{what.__name__}", what, "moving", -cost, beginner=-options.beginner * cost)
    yield Reward("push/flat_push", flat_push, "push", 0.5)


REWARDS = Rewards(order=1, terms=_terms)
