"""Effects of the record that MuJoCo cannot hold stand in the scene as their substitutes."""

from sim.board.bodies import substituted
from sim.check.rules._base import Rule

RULE = Rule(order=3, asked=("failed", "passed"), says=lambda case: substituted(case.board))
