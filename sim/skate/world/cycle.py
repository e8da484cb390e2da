"""The robot's pose on the board at each step of the cycle."""

import numpy as np

from sim.skate.cycle.clock import Clock
from sim.skate.robot.poses import load_poses, load_transition
from sysid.roll import Array


def load_cycle(clock: Clock) -> Array:
    """Return the robot's configuration at each step of the cycle, board frame, shape (period, 30).

    It holds the canonical poses, and between them is where the shipped plain clips are by the end of the step.
    """
    step, poses = np.arange(clock.period), load_poses()
    cycle = np.where(clock.pushing(step)[:, None], poses["push"], poses["steer"])
    for name, inside in (("mount", clock.mounting(step)), ("dismount", clock.dismounting(step))):
        clip = load_transition(name)
        frame = clock.transition_fraction(step[inside]) * (len(clip) - 1)
        cycle[inside] = clip[np.rint(frame).astype(int)]
    return cycle
