"""`husky-sysid run`: a policy in real time, in MuJoCo or on the robot."""

import signal
from collections.abc import Generator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Group, Parameter

from sysid.cli.console import Common, Output, Printer
from sysid.cli.ride_options import Ride, RideOptions, SafetyOptions, choose_renderer, prepare
from sysid.errors import SysidError, UsageError

if TYPE_CHECKING:
    from policy_runtime.loop.commands import CommandSource
    from policy_runtime.loop.preparation import Preparation
    from policy_runtime.loop.ranges import RangeCheck
    from policy_runtime.loop.world import World
    from policy_runtime.robots import Robot
    from policy_runtime.robots.loopback import SimulatedG1
    from policy_runtime.robots.simulated import SimulatedRobot
    from policy_runtime.runtime import Event, RunResult


@Parameter(name="*", group=Group("Robot", sort_key=1))
@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """The robot, and its way to the start pose of the policy; a simulated one begins there."""

    robot: Literal["simulated", "rehearsal", "unitree"] = "simulated"
    """Simulated in plain MuJoCo; a rehearsal, the same simulation with the G1's messages over this computer's loopback; or
    a G1 on the network."""
    interface: str | None = None
    """Network interface towards the robot, e.g. eth0."""
    domain: int = 0
    """DDS domain of the robot."""
    ramp: float = 3.0
    """Time of the way to the start pose [s]."""
    pose_tolerance: float = 0.5
    """Largest distance of a joint from the start pose when the policy begins [rad]."""
    handset: Annotated[bool, Parameter(negative="--no-handset")] = True
    """Wait for the handset: 'start' moves to the start pose, 'A' begins; 'select' or L2+B stop at any time."""
    dry_run: bool = False
    """Hold the start pose, do not send the policy's actions, and compare its observations with its training."""

    def preparation(self, world: "World") -> "Preparation | None":
        """Return the way of a robot to the start of a world's ride; None for a simulated one."""
        from policy_runtime.loop.preparation import Preparation

        if self.robot == "simulated":
            return None
        return Preparation(
            pose=world.start_joints,
            ramp=self.ramp,
            tolerance=self.pose_tolerance,
            handset=self.handset,
            dry=self.dry_run,
        )

    def require_fit(self, ride: Ride, options: RideOptions, printer: Printer) -> None:
        """Check that ride and robot fit together."""
        if self.dry_run and self.robot == "simulated":
            raise UsageError(
                "--dry-run compares a robot's sensors with the training's. Add --robot rehearsal or unitree."
            )
        if self.robot == "unitree" and options.gantry:
            raise UsageError("--gantry holds a simulated robot. Hold the real one yourself.")
        if self.robot == "unitree" and not options.force:
            printer.require_passed(ride.board, force=False)


def run(
    policy: str,
    /,
    *,
    options: RideOptions = RideOptions(),
    robot: RobotOptions = RobotOptions(),
    safety: SafetyOptions = SafetyOptions(),
    keyboard: bool = False,
    viewer: bool = False,
    output: Output | None = None,
    common: Common = Common(),
) -> int:
    """Run a policy in real time: 50 decisions a second over servos at 500 Hz.

    Args:
        policy: zero, stand or push (scripted), an ONNX file, or an exported folder.
        options: The ride; terrain, start and gantry count in simulation only.
        safety: Limits that stop the robot.
        keyboard: Take speed and turn from the arrow keys.
        viewer: Show the simulated robot in the MuJoCo viewer.
        output: Folder for the log; reports/BOARD of the workspace if not given.
    """
    choose_renderer()
    printer = Printer(common)
    ride = prepare(policy, options, printer, visuals=viewer)
    robot.require_fit(ride, options, printer)
    with _keyboard(options, printer) if keyboard else nullcontext(ride.commands) as commands:
        ranges = _ranges(ride) if robot.dry_run else None
        runtime = ride.runtime(
            options,
            safety,
            commands=commands,
            real_time=robot.robot == "simulated",  # the others wait by themselves
            on_tick=lambda tick: None if ranges is None else ranges.add(tick.state, tick.target),
            preparation=robot.preparation(ride.world),
        )
        with _ended_from_outside(), _driven(ride.world.robot, robot, viewer) as (driven, rehearsed):

            def on_event(event: "Event") -> None:
                printer.note(f"{event.time:8.2f} s  {event.kind}: {event.text}")
                if rehearsed is not None:
                    rehearsed.assist(event.kind)

            runtime.robot, runtime.on_event = driven, on_event
            result = runtime.run(options.duration)
    _report(ride, result, ranges, output or common.space.outputs(ride.board.name), printer)
    return 0 if result.stopped is None and (ranges is None or not ranges.outside()) else 1


@contextmanager
def _keyboard(options: RideOptions, printer: Printer) -> "Generator[CommandSource]":
    from math import radians

    from policy_runtime.loop.commands import Command, Keyboard

    source = Keyboard(Command(options.speed, radians(options.turn_deg)))
    printer.note(Keyboard.HELP)
    try:
        yield source
    finally:
        source.close()


def _ranges(ride: Ride) -> "RangeCheck":
    """Return the check of the policy's observations against its training."""
    from policy_runtime.loop.policy import OnnxPolicy
    from policy_runtime.loop.ranges import RangeCheck

    if not isinstance(ride.policy, OnnxPolicy):
        raise SysidError(f"--dry-run: '{ride.policy.name}' was not trained on anything. Give an ONNX file.")
    return RangeCheck(ride.policy)


@contextmanager
def _ended_from_outside() -> "Generator[None]":
    """Treat SIGTERM as Ctrl-C, so that the robot brakes first."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _driven(
    simulated: "SimulatedRobot", options: RobotOptions, viewer: bool
) -> "Generator[tuple[Robot, SimulatedG1 | None]]":
    """Yield the robot to drive, and the simulated one of a rehearsal; close them at the end."""
    if options.robot == "simulated":
        from policy_runtime.loop.viewer import viewed

        with viewed(simulated, viewer):
            yield simulated, None
        return
    from policy_runtime.robots.loopback import LOOPBACK, SimulatedG1
    from policy_runtime.robots.unitree import UnitreeG1

    if viewer:
        raise UsageError("--viewer belongs to --robot simulated. Leave it out.")
    rehearses = options.robot == "rehearsal"
    interface, domain = LOOPBACK if rehearses else options.interface, options.domain
    with (
        SimulatedG1(simulated, interface=interface, domain=domain, hoisted=True)
        if rehearses
        else nullcontext()
    ) as rehearsed:
        driven = UnitreeG1(interface, domain)
        try:
            yield driven, rehearsed
        finally:
            driven.close()


def _report(
    ride: Ride, result: "RunResult", ranges: "RangeCheck | None", folder: Path, printer: Printer
) -> None:
    from sysid.files import write_json

    content = {"board": ride.board.name, "policy": ride.policy.name, **result.to_json()}
    if ranges is not None and ranges.seen():
        content["dry_run"] = ranges.to_json()
        _report_ranges(ranges, printer)
    log = folder / f"run-{ride.policy.name}.json"
    write_json(log, content)
    printer.say(
        f"{ride.policy.name} ran for {result.duration:.2f} s; ended: {result.stopped or 'as planned'}"
    )
    rows = [
        (name, f"{times['p50_ms']:.2f}", f"{times['p99_ms']:.2f}", f"{times['max_ms']:.2f}")
        for name, times in result.timing().items()
    ]
    if rows:
        printer.table(("per tick [ms]", "p50", "p99", "max"), rows)
    printer.result(content, log)


def _report_ranges(ranges: "RangeCheck", printer: Printer) -> None:
    """Print observations beside their range in training: all outside it, else the farthest."""
    outside = ranges.outside()
    rows = [
        (
            n.name,
            f"{n.live[0]:.3g} … {n.live[1]:.3g}",
            f"{n.mean:.3g} ± {n.std:.2g}",
            f"{n.worst:.1f}",
            f"{n.far:.1%}",
        )
        for n in outside or ranges.seen()[:5]
    ]
    printer.table(("the policy's input", "live", "in training", "worst [std]", "far"), rows, "Dry run")
    joint, move = ranges.first_move
    printer.say(f"the first answer would have moved {joint} by {move:+.2f} rad")
    printer.say(
        f"outside the training's range: {', '.join(n.name for n in outside)}. Look for a turned axis, another unit, "
        "order or pose before you start the policy."
        if outside
        else "all observations are within the training's range"
    )
