"""Make the pictures of runtime.md: run `python docs/make_ride_pictures.py` (needs mjlab for the G1's model)."""

import os

if not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")

from pathlib import Path

from policy_runtime.commands import Command, Constant
from policy_runtime.motion_check import motion_facts
from policy_runtime.motions import load_motions
from policy_runtime.recording import Recorder
from policy_runtime.robots.simulated import Gantry
from policy_runtime.runtime import Runtime
from policy_runtime.scripted import scripted_push
from policy_runtime.world import joint_limits, make_world
from reports.motion_figure import motion_figure
from reports.ride_figure import ride_figure
from reports.ride_film import film_strip
from sim.skate.g1 import g1_spec
from sysid.workspace import Workspace

PICTURES = Path(__file__).parent / "pictures"


def main() -> None:
    """Draw a scripted ride and the reference motions."""
    world = make_world(Workspace(Path()).load_board("pink"), start="push", gantry=Gantry(), visuals=True)
    world.reset()
    recorder = Recorder(world.robot)
    Runtime(
        robot=world.robot,
        policy=scripted_push(),
        commands=Constant(Command(0.8, 0.0)),
        limits=joint_limits(world.robot.model),
        on_tick=recorder.add,
        stop_time=0.0,
    ).run(6.0)
    ride = recorder.recording()
    ride_figure(ride, "scripted push on pink, held by a gantry", PICTURES / "ride-push.png")
    moments = ride.time < 2.4
    film_strip(
        world.robot.model, ride.qpos[moments], ride.time[moments], PICTURES / "ride-push-film.png", columns=6
    )
    clips = load_motions()
    model = g1_spec(visuals=False).compile()
    motion_figure(clips, [motion_facts(clip, model).planted for clip in clips], PICTURES / "motions.png")


if __name__ == "__main__":
    main()
