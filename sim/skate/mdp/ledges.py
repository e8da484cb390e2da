# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""Ledges to roll down, one after the other: a slab that is laid under a rider and ends ahead of him.

Its top is level with the ground, which sinks at the same moment. Beyond the edge the rider is on the ground
again, and the slab can be laid anew. Both are static in MuJoCo Warp, which computes their places
when the worlds are made and never again: they are moved by writing there.
"""

import math
from typing import TYPE_CHECKING

import torch
import warp as wp

from sim.skate.world.terrain import LEDGE, LEDGE_SIZE

if TYPE_CHECKING:
    from mjlab.envs import ManagerBasedRlEnv

OBLIQUE = math.radians(70)
"""Largest angle between the way down and where the board points [rad], large ones more often: one wheel goes first then. At
60° and evenly spread, 7 of 31 crossings by more than 35° ended the ride, and 2 of 153 others."""
EDGE_DISTANCE = (0.6, 1.0)
"""How far from the middle of the board an edge is laid [m]: beyond nose and pushing foot."""
PASSED_DISTANCE = EDGE_DISTANCE[1]
"""How far behind an edge is out of reach [m]."""
PARKED_HEIGHT = -1000.0
"""Height at which a slab is out of reach [m]."""


class Ledges:
    """The slab and the ground of every world."""

    def __init__(self, env: "ManagerBasedRlEnv") -> None:
        """Find both."""
        n, device, model, data = env.num_envs, env.device, env.sim.mj_model, env.sim.wp_data
        slab, ground = (int(model.geom(name).id) for name in (LEDGE, "terrain"))
        places = wp.to_torch(data.geom_xpos)
        self.slab, self.axes = places[:, slab], wp.to_torch(data.geom_xmat)[:, slab]
        """Middle of the slab [m], (n, 3), and its axes as columns, (n, 3, 3)."""
        self.height = places[:, ground, 2]
        """Of the ground beyond the edge [m], (n,)."""
        self.normal = torch.zeros(n, 2, device=device)
        """The way down, a unit vector in the plane, (n, 2)."""
        self.edge = torch.zeros(n, device=device)
        """Place of the edge along it [m], (n,)."""
        self.clear(slice(None))

    def clear(self, ids: torch.Tensor | slice) -> None:
        """Put some worlds on level ground at a height of 0."""
        self.height[ids] = 0.0
        self.slab[ids, 2] = PARKED_HEIGHT

    def roll_on(
        self,
        position: torch.Tensor,
        heading: torch.Tensor,
        wanted: torch.Tensor,
        highest: "torch.Tensor | float",
    ) -> None:
        """Take away the slabs of those who are over the edge, and lay an edge ahead of those who want one and have none.

        Args:
            position: Of the board in the plane [m], (n, 2).
            heading: Of the board [rad], (n,).
            wanted: By whom, bool (n,).
            highest: Largest height to draw [m]; 0 for no ledge.
        """
        behind = (position * self.normal).sum(-1) - self.edge > PASSED_DISTANCE
        self.slab[:, 2] = torch.where(behind, PARKED_HEIGHT, self.slab[:, 2])
        wanted = wanted & (self.slab[:, 2] < PARKED_HEIGHT / 2) & (highest > 0)
        chance = torch.rand(3, len(heading), device=heading.device)
        aside = 2 * chance[0] - 1
        towards = heading + OBLIQUE * aside.sign() * aside.abs().sqrt()
        cosine, sine = towards.cos(), towards.sin()
        normal = torch.stack((cosine, sine), dim=-1)
        ahead = EDGE_DISTANCE[0] + (EDGE_DISTANCE[1] - EDGE_DISTANCE[0]) * chance[1]
        middle = position + (ahead - LEDGE_SIZE[0])[:, None] * normal
        nothing, one = torch.zeros_like(sine), torch.ones_like(sine)
        axes = torch.stack((cosine, -sine, nothing, sine, cosine, nothing, nothing, nothing, one), dim=-1)
        for kept, new in (
            (self.normal, normal),
            (self.edge, (position * normal).sum(-1) + ahead),
            (self.slab, torch.cat((middle, (self.height - LEDGE_SIZE[2])[:, None]), dim=-1)),
            (self.axes, axes.view(-1, 3, 3)),
            (self.height, self.height - highest * chance[2].sqrt()),  # the higher, the more often
        ):
            kept.copy_(torch.where(wanted.view(-1, *[1] * (kept.ndim - 1)), new, kept))
