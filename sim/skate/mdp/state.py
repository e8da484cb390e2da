"""The state that rewards and terminations read: one control step of many environments as plain arrays."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class SkateState:
    """The measured state, arrays of NumPy or torch, first axis the environments (n).

    The frame of the board is its level body's: origin on the tilt axis, x forward, y left, z up.
    """

    pushing: Any
    """In the pushing phase and told to move, bool (n,)."""
    transition: Any
    """Mounting or dismounting, bool (n,)."""
    steering: Any
    """In the steering phase, bool (n,)."""
    still: Any
    """Told to stand, and the cycle waits, bool (n,)."""

    time_in_push: Any
    """Time since the pushing phase began [s], (n,)."""

    commanded_speed: Any
    """[m/s], (n,)."""
    target_heading: Any
    """Absolute heading to reach [rad], (n,)."""
    heading_reference: Any
    """Absolute heading of this moment on the way there [rad], (n,)."""
    tilt_reference: Any
    """γ_ref [rad], left edge down positive, (n,)."""

    board_velocity: Any
    """In the board's frame [m/s], (n, 3)."""
    mean_speed: Any
    """Speed of the board [m/s], averaged over a stride while pushing, (n,)."""
    board_heading: Any
    """[rad], (n,)."""
    robot_heading: Any
    """Of the pelvis [rad], (n,)."""
    tilt: Any
    """γ = -roll [rad], left edge down positive, (n,)."""
    tilt_rate: Any
    """[rad/s], (n,)."""
    upright: Any
    """Cosine of the pelvis' inclination [1], (n,)."""

    foot_on_ground: Any
    """Left, right: loaded by the ground, bool (n, 2)."""
    foot_on_deck: Any
    """Left, right: loaded by the deck, bool (n, 2)."""
    ground_load: Any
    """Vertical force of the ground on left and right foot over the robot's weight [1], (n, 2)."""
    deck_load: Any
    """Vertical force of the deck on left and right foot over the robot's weight [1], (n, 2)."""
    foot_in_zone: Any
    """Left over the rear zone, right over the front zone of the deck, bool (n, 2)."""
    foot_marker_distance: Any
    """Distance of left and right sole to the rear and front marker [m], (n, 2)."""
    foot_place_error: Any
    """How far the ball of the right foot is from where it stood at the start, along the deck [m], (n,)."""
    left_air_time: Any
    """Time since the left foot last touched the ground [s], 0 while it does, (n,)."""
    left_ground_time: Any
    """Time since the left foot came down [s], 0 while it is in the air, (n,)."""
    left_touchdown: Any
    """The left foot has just come down, bool (n,)."""
    left_landing_speed: Any
    """Speed of the left sole over the ground one step earlier [m/s], (n,); read at touchdowns."""
    left_travel: Any
    """Way of the left foot along the board since it last came down [m], (n,); read at touchdowns."""
    left_place: Any
    """Place of the left sole along the board, from the rear marker [m], (n,)."""
    left_slip: Any
    """Speed of the left sole over the ground [m/s], (n,)."""
    left_sole_heights: Any
    """Heights of four points of the left sole, from a common level [m], (n, 4)."""
    wheel_on_ground: Any
    """Front left, front right, rear left, rear right, bool (n, 4)."""
    other_contacts: Any
    """Contacts of ground or board with anything of the robot but its feet [1], (n,)."""
    self_contacts: Any
    """Contacts of the robot with itself [1], (n,)."""

    joint_position: Any
    """[rad], (n, 23)."""
    joint_velocity: Any
    """[rad/s], (n, 23)."""
    joint_acceleration: Any
    """[rad/s^2], (n, 23)."""
    joint_torque: Any
    """[N*m], (n, 23)."""
    joint_excess: Any
    """How far joints are beyond nine tenths of their range [rad], (n, 23), not negative."""
    action: Any
    """(n, 23)."""
    action_1: Any
    """One step earlier, (n, 23)."""
    action_2: Any
    """Two steps earlier, (n, 23)."""

    key_position_error: Any
    """Distance of each key body to its place on the transition's path [m], (n, 14)."""
    key_orientation_error: Any
    """Angle of each key body to its orientation on the path [rad], (n, 14)."""
