"""The robustness suite: the conditions under which a policy is evaluated."""

import math

from policy_runtime.evaluation.protocol import Protocol

SUITE: tuple[tuple[str, Protocol], ...] = (
    ("as it is", Protocol()),
    ("120 s", Protocol(duration=120.0)),
    ("straight on, 60 s", Protocol(duration=60.0, turn=0.0)),
    ("straight on, 60 s, heading held", Protocol(duration=60.0, turn=0.0, hold_heading=True)),
    ("delay 20 ms", Protocol(delay=0.02)),
    ("delay 40 ms", Protocol(delay=0.04)),
    ("noise of the training", Protocol(noise=1.0)),
    ("mass + 10 %", Protocol(mass=1.1)),
    ("speed and turn jump every 3 s", Protocol(duration=30.0, jump=3.0)),
    ("told to stand on the way", Protocol(duration=30.0, speed=(0.3, 1.5), stop=True)),
    ("soles 0.4 on ground and deck", Protocol(friction=0.4)),
    ("rolling friction × 3", Protocol(rolling=3.0)),
    ("3° uphill", Protocol(slope=math.radians(3))),
    ("3° uphill, 0.1 to 0.5 m/s", Protocol(speed=(0.1, 0.5), slope=math.radians(3))),
    ("3° downhill", Protocol(slope=-math.radians(3))),
    ("pushes of 100 N", Protocol(push=100.0)),
    ("slopes", Protocol(terrain="slopes")),
    ("ledges", Protocol(terrain="steps")),
    ("board: k × 4", Protocol(board_scale={"k": 4.0})),
    ("board: k / 4", Protocol(board_scale={"k": 0.25})),
    ("board: rake × 0.9", Protocol(board_scale={"rake": 0.9})),
    ("board: rake × 1.1", Protocol(board_scale={"rake": 1.1})),
    ("trucks set directly", Protocol(coupling="direct")),
    ("trucks held straight", Protocol(coupling="none")),
)
"""Name and conditions."""
