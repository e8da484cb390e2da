"""Make the pictures of runtime.md: run `python docs/make_ride_pictures.py` (needs mjlab for the G1's model)."""

import os

if not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")

from pathlib import Path

from policy_runtime.evaluation.recording import Recorder
from policy_runtime.loop.commands import Command, constant
from policy_runtime.loop.policy import OnnxPolicy, Policy
from policy_runtime.loop.policy_file import open_policy
from policy_runtime.loop.scripted import scripted_push
from policy_runtime.loop.world import joint_limits, make_world
from policy_runtime.motion.motion_check import motion_facts
from policy_runtime.motion.motions import load_motions
from policy_runtime.robots.simulated import Gantry
from policy_runtime.runtime import Runtime
from reports.figures.motion import motion_figure
from reports.figures.ride import ride_figure
from reports.figures.ride_film import film_strip
from sim.skate.robot.g1 import g1_spec
from sysid.workspace import Workspace, shipped_data

PICTURES = Path(__file__).parent / "pictures"


def draw_ride(
    name: str, title: str, policy: Policy, *, gantry: Gantry | None, start: str, filmed: float
) -> None:
    """Ride one cycle on pink, and draw it as curves and as a strip of its first seconds."""
    world = make_world(Workspace(Path()).load_board("pink"), start=start, gantry=gantry, visuals=True)
    world.reset()
    recorder = Recorder(world.robot)
    Runtime(
        robot=world.robot,
        policy=policy,
        commands=constant(Command(0.8, 0.0)),
        limits=joint_limits(world.robot.model),
        on_tick=recorder.add,
        stop_time=0.0,
    ).run(6.0)
    ride = recorder.recording()
    ride_figure(ride, title, PICTURES / f"{name}.png")
    shown = ride.column("time") < filmed
    film_strip(
        world.robot.model,
        ride.column("qpos")[shown],
        ride.column("time")[shown],
        PICTURES / f"{name}-film.png",
        columns=6,
    )


def main() -> None:
    """Draw a scripted ride, a learned one, and the reference motions."""
    draw_ride(
        "ride-push", "scripted push on pink, held by a gantry", scripted_push(),
        gantry=Gantry(), start="push", filmed=2.4,
    )  # fmt: skip
    learned = open_policy(shipped_data() / "policies" / "pink-strides.onnx", force=True)
    draw_ride(
        "ride-learned", "learned policy on pink", OnnxPolicy(learned), gantry=None, start="stand", filmed=6.0
    )
    clips = load_motions()
    model = g1_spec(visuals=False).compile()
    motion_figure(clips, [motion_facts(clip, model).planted for clip in clips], PICTURES / "motions.png")


if __name__ == "__main__":
    main()
