"""`husky-sysid play`: show a policy in Rerun or in the MuJoCo viewer."""

from sysid.cli.bars import working
from sysid.cli.console import Common, Output, Printer
from sysid.cli.ride_options import RideOptions, SafetyOptions, choose_renderer, prepare, write_ride
from sysid.errors import SysidError
from sysid.progress import stage


def play(
    policy: str,
    /,
    *,
    options: RideOptions = RideOptions(),
    safety: SafetyOptions = SafetyOptions(),
    output: Output | None = None,
    viewer: bool = False,
    common: Common = Common(),
) -> None:
    """Ride in simulation at full speed, and write a recording and pictures.

    Args:
        policy: zero, stand or push (scripted), pink or black (shipped), an ONNX file, or an exported folder.
        options: The ride.
        safety: Limits that end it early.
        output: Folder for picture, film strip, numbers and Rerun recording; reports/BOARD of the workspace
            if not given.
        viewer: Open the MuJoCo viewer and ride in real time instead.
    """
    choose_renderer()
    from policy_runtime.evaluation.metrics import episode_errors
    from policy_runtime.evaluation.recording import Recorder
    from policy_runtime.loop.viewer import viewed

    printer = Printer(common)
    ride = prepare(policy, options, printer)
    robot = ride.world.robot
    recorder = Recorder(robot)
    runtime = ride.runtime(options, safety, on_tick=recorder.add, real_time=viewer, stop_time=0.0)
    with working(printer):
        with stage(0.0, 0.3, "riding"), viewed(robot, viewer):
            result = runtime.run(options.duration)
        if len(recorder) < 2:
            raise SysidError(f"the ride ended at once ({result.stopped}); there is nothing to draw.")
        recording = recorder.recording()
        with stage(0.3, 1.0, "drawing the ride"):
            files = write_ride(ride, recording, output or common.space.outputs(ride.board.name), printer)
    printer.say(f"{ride.policy.name} rode {ride.board.name} for {result.duration:.2f} s")
    printer.say(f"ended: {result.stopped or 'as planned'}")
    for kind, path in files.items():
        printer.say(f"{kind}: {path}")
    errors = {key: float(value[0]) for key, value in episode_errors(recording.rides(succeeded=True)).items()}
    known = {key: value for key, value in errors.items() if value == value}
    printer.result(
        {"board": ride.board.name, "policy": ride.policy.name, **result.to_json(), "files": files, **known}
    )
