"""`husky-sysid motions`: list, plot and play reference motions."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.cli.console import Common, Made, Printer
from sysid.errors import SysidError

if TYPE_CHECKING:
    from policy_runtime.motion.motion_check import MotionFacts


def motions(
    *motion: Path, plot: Made | None = None, rerun: Made | None = None, common: Common = Common()
) -> int:
    """List reference motions and their properties; draw them, or play them in Rerun.

    Args:
        motion: Names of shipped clips, files (.npy, (frames, 36)) or folders; all shipped clips by default.
        plot: Draw the joints over time into this PNG file.
        rerun: Write a Rerun recording of the moving robot to this file; open it with `rerun FILE`.
    """
    from policy_runtime.learning.style_reference import transition_folder
    from policy_runtime.motion.motion_check import motion_facts
    from policy_runtime.motion.motions import load_motions, motion_paths
    from sim.skate.robot.g1 import JOINTS, g1_spec

    printer = Printer(common)
    printer.keep(motion, {"--plot": plot, "--rerun": rerun})
    clips = load_motions(motion)
    model = g1_spec(visuals=rerun is not None).compile()
    facts = {clip.name: motion_facts(clip, model) for clip in clips}
    if len(facts) < len(clips):
        raise SysidError("two motions have the same name; give them one at a time.")
    printer.records([_row(name, fact) for name, fact in facts.items()])
    if not motion:
        folder = transition_folder()
        printer.note(
            f"{len(motion_paths([folder]))} clips of mounting and dismounting: husky-sysid motions {folder}"
        )
    for name, fact in facts.items():
        if fact.limit_margin < 0:
            printer.warn(f"{name}: a joint is {math.degrees(-fact.limit_margin):.1f}° beyond its range")
        if fact.slide > 0.1:
            printer.warn(f"{name}: the planted left foot slides at up to {fact.slide:.2f} m/s")
    if plot is not None:
        from reports.figures.motion import motion_figure

        motion_figure(clips, [fact.planted for fact in facts.values()], plot)
        printer.say(f"picture: {plot}")
    if rerun is not None:
        from reports.rerun.ride import motion_recording

        motion_recording(model, clips, rerun)
        printer.say(f"recording: {rerun}")
    printer.result({"motions": [_json(name, fact, JOINTS) for name, fact in facts.items()]})
    return 0


def _row(name: str, fact: "MotionFacts") -> dict[str, str]:
    return {
        "motion": name,
        "length": f"{fact.frames} frames, {fact.duration:.2f} s",
        "speed": f"{fact.speed:.2f} m/s",
        "period": f"{fact.period:.2f} s" if math.isfinite(fact.period) else "none",
        "on ground": f"{100 * fact.stance:.0f} %",
        "slide": f"{fact.slide * 1e3:.0f} mm/s",
        "peak joint speed": f"{fact.peak_speed:.1f} rad/s ({fact.peak_speed_joint})",
        "limit margin": f"{fact.limit_margin:.3f} rad",
    }


def _json(name: str, fact: "MotionFacts", joints: tuple[str, ...]) -> dict[str, object]:
    finite = {"period": fact.period, "support_margin": fact.support_margin}
    as_they_are = (
        "speed", "stance", "slide", "penetration", "limit_margin", "peak_speed", "peak_speed_joint", "self_contacts",
    )  # fmt: skip
    return {
        "name": name,
        "frames": fact.frames,
        "duration_s": fact.duration,
        **{key: getattr(fact, key) for key in as_they_are},
        **{key: value if math.isfinite(value) else None for key, value in finite.items()},
        "ranges": {
            joint: [float(low), float(high)]
            for joint, low, high in zip(joints, fact.joint_low, fact.joint_high, strict=True)
        },
    }
