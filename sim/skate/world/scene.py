# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false, reportMissingImports=false
# (MuJoCo ships no type stubs; mjlab is optional.)
"""The skating scene, robot and board on the ground: for plain MuJoCo and for mjlab, from one source.

Names are the same in both: the robot's are prefixed `robot/`, the board's `board/`, the ground is the
body `terrain`. In plain MuJoCo the robot's 23 servos are the controls, in the order of `g1.JOINTS`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco

from sim.board.scene import Coupling, board_spec, integrator_value
from sim.compensation.scene import compensate
from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.robot import g1
from sim.skate.world.terrain import Terrain, add_ledge, add_terrain
from sysid.board import Board
from sysid.roll import Array

if TYPE_CHECKING:
    from mjlab.scene import SceneCfg
    from mjlab.sim import SimulationCfg

TIMESTEP = 0.005
"""Step of the simulation [s]."""
DECIMATION = round(CONTROL_PERIOD / TIMESTEP)
ITERATIONS = 10
LINE_SEARCH_ITERATIONS = 20
"""Steps of the simulation in one of the policy (50 Hz); iterations of MuJoCo Warp's solver and of its line search: as in mjlab's tasks.

Plain MuJoCo keeps its own limits (100, 50): its line search, cut at 20, moves a deck with dry friction up to 93 % off; Warp's does not.
"""
SENSORS = ("imu_ang_vel", "imu_lin_vel")
"""Sensors of the robot's model that the task reads."""
EXTENT = 2.0
"""Size of a camera's scene [m]; with the lane's own, MuJoCo would clip the robot as too near."""

STANDING_PELVIS = (-0.03, 0.10)
"""Pelvis of a robot that stands with one foot on the deck, from the board's middle, forward and left [m]."""
ROBOT, BOARD = "robot/", "board/"
"""Name prefixes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneOptions:
    """Options of the scene."""

    coupling: Coupling = "equality"
    """How tilt steers the trucks."""
    steered: bool = True
    """Whether tilt steers at all; without it the trucks are held straight."""
    terrain: Terrain = "flat"
    ledge: bool = False
    """Whether there is a slab that can be laid under riders (mjlab only)."""
    timestep: float = TIMESTEP
    """[s]."""


def skate_spec(board: Board, options: SceneOptions | None = None, *, visuals: bool = False) -> mujoco.MjSpec:
    """Return the whole scene for plain MuJoCo.

    Args:
        visuals: Keep the robot's meshes, for pictures.
    """
    options = options or SceneOptions()
    spec = mujoco.MjSpec()
    spec.modelname = f"skate_{board.name}"
    spec.stat.extent = EXTENT
    spec.option.timestep = options.timestep
    spec.option.integrator = integrator_value("implicitfast")
    spec.visual.map.shadowclip = 8.0  # the edge of the shadow's map, where it speckles, is out of sight
    spec.worldbody.add_light(
        name="sun",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM,  # goes along, so that the shadow does
        pos=[0.0, 0.0, 3.0],
        dir=[0.1, 0.15, -1.0],
    )
    add_terrain(spec, options.terrain)
    robot = g1.g1_spec(visuals=visuals)
    g1.add_servos(robot)
    # Attaching takes over named elements, not a child's options.
    written = as_written(board, options)
    for child, prefix in ((robot, ROBOT), (_board_child(written, options), BOARD)):
        spec.attach(child, prefix=prefix, frame=spec.worldbody.add_frame())
    return spec


def as_written(board: Board, options: SceneOptions) -> Board:
    """Return the board as this scene must hold it, so that it decays like its record.

    `check` vouches for the record in a scene with this compensation; a policy must see the same board.
    """
    return compensate(board, "in-scene", timestep=options.timestep, coupling=options.coupling).board


def standing_state(model: mujoco.MjModel) -> Array:
    """Return a configuration of the plain scene, shape (nq,): one foot on the deck, one on the ground.

    The robot, in its default pose, is lowered until the first foot touches.
    """
    qpos = model.qpos0.copy()
    robot = model.joint(f"{ROBOT}floating_base_joint").qposadr[0]
    qpos[robot : robot + 7] = (*STANDING_PELVIS, standing_height(deck_top(model)), 1.0, 0.0, 0.0, 0.0)
    qpos[robot + 7 : robot + 30] = g1.default_pose()
    return qpos


def deck_top(model: mujoco.MjModel) -> float:
    """Return the height of the deck's upper face over the ground [m]."""
    return float(model.body(f"{BOARD}board").pos[2] + model.site(f"{BOARD}front_marker").pos[2])


def standing_height(deck: float) -> float:
    """Return the pelvis height [m] at which the first foot touches: left on the ground, right on a deck of this height [m]."""
    model = g1.g1_spec(visuals=False).compile()
    data = mujoco.MjData(model)
    data.qpos[7:] = g1.default_pose()
    data.qpos[3] = 1.0
    data.qpos[:3] = 0.0
    mujoco.mj_forward(model, data)
    left, right = (g1.sole_points(model, data, side)[:, 2].min() for side in ("left", "right"))
    return float(max(-left, deck - right))


def mjlab_scene(board: Board, options: SceneOptions, environments: int) -> "SceneCfg":
    """Return the same scene for mjlab, with its contact sensors (see `sim.skate.world.contacts`)."""
    from mjlab.actuator import BuiltinPositionActuatorCfg
    from mjlab.entity import EntityArticulationInfoCfg, EntityCfg
    from mjlab.scene import SceneCfg
    from mjlab.terrains import TerrainEntityCfg

    from sim.skate.world.contacts import contact_sensors

    written = as_written(board, options)
    actuators = tuple(
        BuiltinPositionActuatorCfg(
            target_names_expr=tuple(names),
            stiffness=motor.stiffness,
            damping=motor.damping,
            effort_limit=motor.effort,
            armature=motor.armature,
        )
        for motor, names in _joints_by_motor().items()
    )
    axis = board.geometry["wheel_radius"].value + board.geometry["truck_height"].value
    robot = EntityCfg(
        spec_fn=_robot_child,
        init_state=EntityCfg.InitialStateCfg(
            pos=(*STANDING_PELVIS, standing_height(axis + board.geometry["thickness"].value / 2)),
            joint_pos=dict(zip(g1.JOINTS, g1.default_pose().tolist(), strict=True)),
        ),
        articulation=EntityArticulationInfoCfg(actuators=actuators, soft_joint_pos_limit_factor=0.9),
    )
    skateboard = EntityCfg(
        spec_fn=lambda: _board_child(written, options),
        init_state=EntityCfg.InitialStateCfg(pos=(0.0, 0.0, axis)),
    )
    return SceneCfg(
        num_envs=environments,
        env_spacing=0.0,  # worlds do not meet; one lane serves all
        terrain=TerrainEntityCfg(terrain_type="plane"),
        entities={"robot": robot, "board": skateboard},
        sensors=contact_sensors(),
        spec_fn=_terrain_editor(options),
        extent=EXTENT,
    )


def mjlab_simulation(options: SceneOptions) -> "SimulationCfg":
    """Return mjlab's solver settings and its contact budgets."""
    from mjlab.sim import MujocoCfg, SimulationCfg

    return SimulationCfg(
        nconmax=48,
        njmax=256,
        contact_sensor_maxmatch=64,
        mujoco=MujocoCfg(
            timestep=options.timestep,
            integrator="implicitfast",
            iterations=ITERATIONS,
            ls_iterations=LINE_SEARCH_ITERATIONS,
        ),
    )


def _robot_child() -> mujoco.MjSpec:
    """Return the robot with no sensor but those that are read: two more took a sixth of a step in MuJoCo Warp."""
    spec = g1.g1_spec(visuals=False)
    for sensor in spec.sensors:
        if sensor.name not in SENSORS:
            spec.delete(sensor)
    return spec


def _board_child(board: Board, options: SceneOptions) -> mujoco.MjSpec:
    spec = board_spec(board, coupling=options.coupling, ground=False, timestep=options.timestep)
    for geom in spec.geoms:
        if geom.name == "deck_collision":
            geom.priority = 0  # the sole's friction counts on the deck as on the ground
    if not options.steered:
        for constraint in spec.equalities:
            constraint.data[:5] = 0.0
    fresh = mujoco.MjSpec().option  # the scene's options count; a child's would only draw a warning
    spec.option.timestep, spec.option.integrator = fresh.timestep, fresh.integrator
    return spec


def _terrain_editor(options: SceneOptions) -> Callable[[Any], None] | None:
    if options.ledge:
        return add_ledge
    return None if options.terrain == "flat" else lambda spec: add_terrain(spec, options.terrain)


def _joints_by_motor() -> dict[g1.Motor, list[str]]:
    groups: dict[g1.Motor, list[str]] = {}
    for joint in g1.JOINTS:
        groups.setdefault(g1.motor_of(joint), []).append(joint)
    return groups
