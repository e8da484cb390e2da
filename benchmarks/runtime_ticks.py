"""How long one tick of the runtime takes: a policy of the published size on the simulated robot.

Run `python benchmarks/runtime_ticks.py` (needs mjlab, onnx and onnxruntime). Ten minutes of robot time, as
fast as the machine can; prints median, 99th percentile and maximum of deciding (reading, checking,
observing, the network, sending) and of the whole tick with its ten physics steps, and the memory at the
beginning and at the end.
"""

import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from policy_runtime.loop.commands import Command, constant
from policy_runtime.loop.gravity_load import GravityLoad
from policy_runtime.loop.policy import OnnxPolicy, action_for
from policy_runtime.loop.policy_file import open_policy
from policy_runtime.loop.world import joint_limits, make_world
from policy_runtime.robots.simulated import Gantry
from policy_runtime.runtime import Runtime, Tick
from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.robot.poses import load_poses
from sysid.workspace import Workspace

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from riding import make_onnx, our_metadata

MINUTES = 10.0


def main(minutes: float = MINUTES) -> None:
    """Ride, and print one line of JSON."""
    board = Workspace(Path()).load_board("pink")
    world = make_world(board, start="steer", gantry=Gantry())
    world.reset()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "policy.onnx"
        # Random weights about the steering pose: the ride is calm, the work is that of a trained policy.
        asked = GravityLoad().asked(load_poses()["steer"], (True, True))
        make_onnx(path, size=390, metadata=our_metadata(board), bias=action_for(asked))
        policy = OnnxPolicy(open_policy(path, board))
    ticks = round(60 * minutes / CONTROL_PERIOD)
    # Written in place: what memory grows by is the runtime's own.
    drift, spent, decided = (np.zeros(ticks) for _ in range(3))
    stepped = [time.thread_time()]
    step = world.robot.step

    def timed_step() -> None:
        step()
        stepped[0] = time.thread_time()

    world.robot.step = timed_step  # type: ignore[method-assign]

    def watch(tick: Tick) -> None:
        i = round(tick.time / CONTROL_PERIOD)
        drift[i] = tick.state.time - tick.time
        spent[i] = time.thread_time()
        decided[i] = spent[i] - stepped[0]

    limits = joint_limits(world.robot.model, tilt=np.pi, joint_margin=1.0, torque_time=np.inf)
    runtime = Runtime(
        robot=world.robot, policy=policy, commands=constant(Command(0.8, 0.0)), limits=limits, on_tick=watch
    )
    runtime.run(20.0)  # what is built on first use is built
    world.reset()
    drift[:] = spent[:] = decided[:] = 0.0
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    result = runtime.run(60 * minutes)
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    content = {
        "minutes": minutes,
        "ticks": result.ticks,
        "stopped": result.stopped,
        "clock_drift_s": float(np.abs(drift).max()),
        "memory_growth_mb": (after - before) / 1024,
        **result.timing(),
        # Processor time, so without what other programs on the computer took.
        "processor_decide": percentiles(decided[1:]),
        "processor_tick": percentiles(np.diff(spent)),
    }
    print(json.dumps(content))


def percentiles(seconds: npt.ArrayLike) -> dict[str, float]:
    """Return median, 99th percentile and maximum [ms]."""
    return {f"p{p}_ms": float(np.percentile(seconds, p) * 1e3) for p in (50, 99, 100)}


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else MINUTES)
