"""`husky-sysid run`: a policy in real time, in MuJoCo or on the robot."""

import signal
from collections.abc import Generator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from sysid.cli.console import OUTPUT, Common, Printer
from sysid.cli.ride_options import Ride, RideOptions, choose_renderer, prepare, write_ride
from sysid.errors import QualityGateError, SysidError

if TYPE_CHECKING:
    from policy_runtime.evaluation.recording import Recorder
    from policy_runtime.loop.commands import CommandSource
    from policy_runtime.robots import Robot
    from policy_runtime.robots.simulated import SimulatedRobot
    from policy_runtime.runtime import RunResult


def run(
    policy: str,
    /,
    *,
    options: RideOptions = RideOptions(),
    robot: Literal["simulated", "rehearsal", "unitree"] = "simulated",
    interface: str | None = None,
    domain: int = 0,
    keyboard: bool = False,
    viewer: bool = False,
    record: bool = False,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"], group=OUTPUT)] = None,
    common: Common = Common(),
) -> int:
    """Run a policy in real time: 50 decisions a second over servos at 500 Hz.

    Ends when the time is over, at 'q' or Ctrl-C, or when a check stops the robot: stale or non-finite state,
    too much tilt, joint or torque limit, lost link. However it ends, all joints brake, and the log says why.

    Args:
        policy: zero, stand or push (scripted), an ONNX file, or an exported folder.
        options: The ride; terrain, start and gantry count in simulation only.
        robot: In plain MuJoCo; a rehearsal, in which the same simulation speaks the G1's messages over this
            computer's loopback; or a G1 on the network.
        interface: Network interface towards the robot, e.g. eth0.
        domain: DDS domain of the robot.
        keyboard: Take speed and turn from the arrow keys.
        viewer: Show the simulated robot in the MuJoCo viewer.
        record: Write recording and pictures of the simulated ride at the end.
        output: Folder for them and for the log; reports/BOARD of the workspace if not given.
        common: Options of every command.
    """
    choose_renderer()
    printer = Printer(common)
    ride = prepare(policy, options, printer, visuals=viewer or record)
    if robot != "simulated" and (viewer or record):
        raise SysidError("--viewer and --record belong to --robot simulated. Leave them out.")
    if robot == "unitree":
        if options.gantry:
            raise SysidError("--gantry holds a simulated robot. Hold the real one yourself.")
        if not ride.board.passed and not options.force:
            raise QualityGateError(
                f"board '{ride.board.name}' has not passed `check`: a policy made for it is not fit for the robot. "
                f"Run `husky-sysid check --board {ride.board.name}`, or add --force."
            )
    commands = _keyboard(options, printer) if keyboard else ride.commands
    folder = output or common.space.outputs(ride.board.name)
    try:
        result, recorder = _drive(ride, commands, options, robot, interface, domain, viewer, record, printer)
    finally:
        commands.close()
    files = {} if recorder is None else write_ride(ride, recorder.recording(), folder, printer)
    _report(ride, result, files, folder, printer)
    return 0 if result.stopped is None else 1


def _keyboard(options: RideOptions, printer: Printer) -> "CommandSource":
    from math import radians

    from policy_runtime.loop.commands import Command, Keyboard

    source = Keyboard(Command(options.speed, radians(options.turn_deg)))
    printer.note(Keyboard.HELP)
    return source


def _drive(
    ride: Ride,
    commands: "CommandSource",
    options: RideOptions,
    robot: str,
    interface: str | None,
    domain: int,
    viewer: bool,
    record: bool,
    printer: Printer,
) -> "tuple[RunResult, Recorder | None]":
    """Run until the end and let go of the robot."""
    from policy_runtime.evaluation.recording import Recorder
    from policy_runtime.loop.world import joint_limits
    from policy_runtime.runtime import Runtime

    simulated = ride.world.robot
    recorder = Recorder(simulated) if record else None
    with _ended_from_outside(), _driven(simulated, robot, interface, domain, viewer) as driven:
        runtime = Runtime(
            robot=driven,
            policy=ride.policy,
            commands=commands,
            limits=joint_limits(simulated.model),
            real_time=robot == "simulated",  # the others wait by themselves
            on_tick=None if recorder is None else recorder.add,
            on_event=lambda event: printer.note(f"{event.time:8.2f} s  {event.kind}: {event.text}"),
        )
        return runtime.run(options.duration), recorder


@contextmanager
def _ended_from_outside() -> "Generator[None]":
    """Treat the signal that ends programs as Ctrl-C, so that the robot brakes first."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _driven(
    simulated: "SimulatedRobot", robot: str, interface: str | None, domain: int, viewer: bool
) -> "Generator[Robot]":
    """Yield the robot to drive, and let go of it at the end."""
    if robot == "simulated":
        from policy_runtime.loop.viewer import viewed

        with viewed(simulated, viewer) as shown:
            yield shown
        return
    from policy_runtime.robots.loopback import LOOPBACK, SimulatedG1
    from policy_runtime.robots.unitree import UnitreeG1

    interface = LOOPBACK if robot == "rehearsal" else interface
    with (
        SimulatedG1(simulated, interface=interface, domain=domain) if robot == "rehearsal" else nullcontext()
    ):
        driven = UnitreeG1(interface, domain)
        try:
            yield driven
        finally:
            driven.close()


def _report(ride: Ride, result: "RunResult", files: dict[str, str], folder: Path, printer: Printer) -> None:
    from sysid.files import write_json

    content = {"board": ride.board.name, "policy": ride.policy.name, **result.to_json(), "files": files}
    log = folder / f"run-{ride.policy.name}.json"
    write_json(log, content)
    printer.say(
        f"{ride.policy.name} ran for {result.duration:.2f} s; ended: {result.stopped or 'as planned'}"
    )
    rows = [
        (name, f"{times['p50_ms']:.2f}", f"{times['p99_ms']:.2f}", f"{times['max_ms']:.2f}")
        for name, times in result.timing.summary().items()
    ]
    if rows:
        printer.table(("per tick [ms]", "p50", "p99", "max"), rows)
    for kind, path in files.items():
        printer.say(f"{kind}: {path}")
    printer.say(f"log: {log}")
    printer.result(content)
