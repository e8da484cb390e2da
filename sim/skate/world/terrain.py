# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""The ground of the skating scene: flat, long slopes, or ledges to roll down.

Slopes lie along +x, where a robot starts to skate; sideways the lane is wide enough for any turn. Ledges lie in
squares about the start. Lanes would be walls to a rider who turned back.
"""

import math
from collections.abc import Sequence
from typing import Literal

import mujoco

from sim.board.bodies import colour

Terrain = Literal["flat", "slopes", "steps"]

SLOPES_DEG = (5.0, 6.0, 8.0, 10.0)
"""Gradients of successive descents [deg], 3 m long each, with 6 m of level ground before each."""
STEPS = (0.03, 0.04, 0.05, 0.06)
"""Heights of successive ledges [m]. A wheel of 3 cm radius cannot climb them: every way from the start goes down."""
STEP_LENGTH = 5.0
"""Level ground before each of them [m]."""

LEDGE = "ledge"
"""Name of the slab that is laid under riders in training."""
LEDGE_SIZE = (10.0, 10.0, 0.5)
"""Half its length, width and height [m]: more than a rider rolls before he is over its edge."""
_LEDGE_BIT = 2
"""Contact bit of the slab and of its partners."""

_HALF_WIDTH = 60.0
"""Half the width of the lane [m]: straight to the side at the largest speed, 1.5 m/s, for twice the paper's episode of 20 s."""
_COLOUR = colour("525c66")
"""Of the ground."""


def add_terrain(spec: mujoco.MjSpec, terrain: Terrain) -> None:
    """Add the body `terrain` with the chosen ground to a scene; it is level at z = 0 about the origin."""
    body = spec.body("terrain") or spec.worldbody.add_body(name="terrain")
    if terrain == "flat":
        if spec.geom("terrain") is None:
            body.add_geom(
                name="terrain", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.05], rgba=_COLOUR
            )
        return
    plane = spec.geom("terrain")
    if plane is not None:  # mjlab's own plane, which is replaced
        spec.delete(plane)
    if terrain == "slopes":
        profile = _descents([math.radians(angle) for angle in SLOPES_DEG], run=3.0, level=6.0)
        for i, (start, end, top, drop) in enumerate(profile):
            _slab(body, f"terrain_{i}", start, end, top, drop)
        return
    top = 0.0
    for i, height in enumerate((*STEPS, 0.0)):
        half = (i + 1) * STEP_LENGTH if height else _HALF_WIDTH
        _slab(body, f"terrain_{i}", -half, half, top, 0.0, half_width=half)
        top -= height


def add_ledge(spec: mujoco.MjSpec) -> None:
    """Add a slab, out of reach until `sim.skate.mdp.ledges` lays it; it bears soles and wheels only, which is fast."""
    spec.body("terrain").add_geom(
        name=LEDGE,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=list(LEDGE_SIZE),
        contype=0,
        conaffinity=_LEDGE_BIT,
        rgba=_COLOUR,
    )
    for geom in spec.geoms:
        if geom.name.endswith("_collision") and ("_foot" in geom.name or "_wheel" in geom.name):
            geom.contype |= _LEDGE_BIT


def _descents(angles: Sequence[float], run: float, level: float) -> list[tuple[float, float, float, float]]:
    """Return pieces (start, end, height at start, drop) [m] of level ground and slopes in turn."""
    pieces = [(-20.0, level, 0.0, 0.0)]
    x, z = level, 0.0
    for angle in angles:
        drop = run * math.tan(angle)
        pieces += [(x, x + run, z, drop), (x + run, x + run + level, z - drop, 0.0)]
        x, z = x + run + level, z - drop
    return [*pieces, (x, x + 80.0, z, 0.0)]


def _slab(
    body: mujoco.MjsBody,
    name: str,
    start: float,
    end: float,
    top: float,
    drop: float,
    half_width: float = _HALF_WIDTH,
) -> None:
    """Add a thick box whose upper face runs from (start, top) down to (end, top - drop)."""
    length, thickness = math.hypot(end - start, drop), 1.0
    pitch = math.atan2(drop, end - start)
    middle_x, middle_z = (start + end) / 2, top - drop / 2
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[length / 2, half_width, thickness / 2],
        pos=[middle_x - math.sin(pitch) * thickness / 2, 0.0, middle_z - math.cos(pitch) * thickness / 2],
        quat=[math.cos(pitch / 2), 0.0, math.sin(pitch / 2), 0.0],
        rgba=_COLOUR,
    )
