"""Common options of the commands that ride a board: policy, world, outputs."""

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter
from cyclopts.validators import Number

from sysid.board import Board
from sysid.cli.console import BoardName, Coupling, Printer, Terrain
from sysid.errors import SysidError

if TYPE_CHECKING:
    from policy_runtime.evaluation.recording import Recording
    from policy_runtime.loop.commands import CommandSource
    from policy_runtime.loop.policy import Policy
    from policy_runtime.loop.world import World
    from policy_runtime.runtime import Runtime


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class RideOptions:
    """Options of `run` and `play`."""

    board: BoardName | None = None
    """The board to ride; an exported folder brings its own."""
    duration: Annotated[float, Parameter(validator=Number(gt=0))] = 12.0
    """Length of the ride [s]."""
    speed: float = 0.8
    """Commanded speed [m/s]; below 0.1 the robot stands still."""
    turn_deg: float = 0.0
    """Commanded turn in every steering stretch [degrees], left positive."""
    commands: Path | None = None
    """CSV file of commands: time_s,speed_m_s,turn_rad; replaces --speed and --turn-deg."""
    hold_heading: bool = False
    """Correct the heading errors of earlier turns, by the IMU's yaw."""
    start: Literal["stand", "push", "steer"] = "stand"
    """Begin with one foot on the ground, or in a canonical pose on the rolling board."""
    terrain: Terrain = "flat"
    """The ground: level, descents of 5 to 10 degrees, or ledges of 3 to 6 cm to roll down."""
    coupling: Coupling = "equality"
    """Steering of the trucks by the deck's tilt."""
    gantry: bool = False
    """Hold the pelvis upright, like a robot on a trolley."""
    force: bool = False
    """Run even if policy and board disagree, or the board has not passed `check`."""


Limit = Annotated[float, Parameter(validator=Number(gte=0))]


@Parameter(name="*", group=Group("Safety", sort_key=1))
@dataclass(frozen=True, kw_only=True)
class SafetyOptions:
    """Limits beyond which the robot is stopped."""

    joint_margin: Limit = 0.05
    """Largest measured excess over a joint's range [rad]; the HUSKY release's ankle needs 0.1."""
    tilt_deg: Limit = 60.0
    """Greatest inclination of the pelvis [degrees]."""
    torque_time: Limit = 0.5
    """Longest time that a motor may be at its torque limit without a break [s]."""
    link_timeout: Limit = 0.1
    """Longest time without a message from the robot, or with the same state repeated [s]."""


def choose_renderer() -> None:
    """Let MuJoCo render without a display; call it before the import of MuJoCo."""
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")


@dataclass(frozen=True)
class Ride:
    """Everything that a ride needs."""

    board: Board
    policy: "Policy"
    world: "World"
    commands: "CommandSource"

    def runtime(self, options: RideOptions, safety: SafetyOptions, **more: Any) -> "Runtime":
        """Return the loop that rides in simulation; `more` are further fields of `Runtime`."""
        from policy_runtime.loop.world import joint_limits
        from policy_runtime.runtime import Runtime

        given = vars(safety).copy()
        tilt = math.radians(given.pop("tilt_deg"))
        usual: dict[str, Any] = {
            "robot": self.world.robot, "policy": self.policy, "commands": self.commands,
            "limits": joint_limits(self.world.robot.model, tilt=tilt, **given), "hold_heading": options.hold_heading,
        }  # fmt: skip
        return Runtime(**(usual | more))


def prepare(policy: str, options: RideOptions, printer: Printer, *, visuals: bool = True) -> Ride:
    """Open policy, board and world; `visuals` keeps the robot's meshes."""
    from policy_runtime.evaluation.plain import policy_named
    from policy_runtime.export import MANIFEST, load_folder
    from policy_runtime.loop.policy import OnnxPolicy
    from policy_runtime.loop.world import make_world
    from policy_runtime.robots.simulated import Gantry

    printer.keep([Path(policy), *([] if options.commands is None else [options.commands])])
    commands = command_source(options)
    gantry = Gantry() if options.gantry else None
    if (Path(policy) / MANIFEST).is_file() or Path(policy).is_dir():
        bundle = load_folder(Path(policy))
        if bundle.policy is None:
            raise SysidError(f"{policy}: holds no policy. Export it with one.")
        if options.board not in (None, bundle.board.name):
            raise SysidError(
                f"{policy}: exported for board '{bundle.board.name}', not for '{options.board}'."
            )
        world = bundle.world(start=options.start, gantry=gantry)
        board, name = bundle.board, str(bundle.policy)
    else:
        if options.board is None:
            raise SysidError(
                f"{policy}: not an exported folder with its own board. Name the board with --board."
            )
        board, name = printer.common.space.load_board(options.board), policy
        world = make_world(
            board,
            coupling=options.coupling,
            terrain=options.terrain,
            start=options.start,
            gantry=gantry,
            visuals=visuals,
        )
    rider = policy_named(name, board, force=options.force)
    if isinstance(rider, OnnxPolicy):
        for note in rider.file.notes:
            printer.note(note)
    printer.require_passed(board, force=True)
    world.reset()
    return Ride(board, rider, world, commands)


def command_source(options: RideOptions) -> "CommandSource":
    """Return the source of the commands."""
    from policy_runtime.loop.commands import SPEED_RANGE, TURN_RANGE, Command, constant, load_script

    if options.commands is not None:
        return load_script(options.commands)
    limit = math.degrees(TURN_RANGE[1])
    if not SPEED_RANGE[0] <= options.speed <= SPEED_RANGE[1]:
        raise SysidError(
            f"--speed {options.speed:g}: policies are trained for {SPEED_RANGE[0]:g} to {SPEED_RANGE[1]:g} m/s."
        )
    if not abs(options.turn_deg) <= limit:
        raise SysidError(f"--turn-deg {options.turn_deg:g}: policies are trained for ±{limit:g}°.")
    return constant(Command(options.speed, math.radians(options.turn_deg)))


def write_ride(ride: Ride, recording: "Recording", folder: Path, printer: Printer) -> dict[str, str]:
    """Write picture, film strip, Rerun recording and numbers of a ride; return their paths by kind."""
    from reports.figures.ride import ride_figure
    from reports.figures.ride_film import film_strip
    from reports.rerun.ride import ride_recording

    name = f"ride-{ride.policy.name}"
    model = ride.world.robot.model
    files = {kind: folder / f"{name}{suffix}" for kind, suffix in (("picture", ".png"), ("numbers", ".npz"))}
    ride_figure(recording, f"{ride.policy.name} on {ride.board.name}", files["picture"])
    recording.save(files["numbers"])
    files["recording"] = folder / f"{name}.rrd"
    ride_recording(model, recording, name, files["recording"])
    try:
        film_strip(model, recording.column("qpos"), recording.column("time"), folder / f"{name}-film.png")
        files["film"] = folder / f"{name}-film.png"
    except SysidError as error:
        printer.warn(f"no film strip: {error}")
    return {kind: str(path) for kind, path in files.items()}
