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
) -> None:
    """List reference motions and their properties; draw them, or play them in Rerun.

    Args:
        motion: Names of shipped clips, files (.npy, (frames, 36)) or folders; all shipped clips by default.
        plot: Draw the joints over time into this PNG file.
        rerun: Write a Rerun recording of the moving robot to this file; open it with `rerun FILE`.
    """
    from policy_runtime.motion.motion_check import motion_facts
    from policy_runtime.motion.motions import load_motions, motion_paths, transition_folder
    from sim.skate.robot.g1 import JOINTS, g1_spec

    printer = Printer(common)
    printer.keep(motion, {"--plot": plot, "--rerun": rerun})
    clips = load_motions(motion)
    model = g1_spec(visuals=rerun is not None).compile()
    facts = {clip.name: motion_facts(clip, model) for clip in clips}
    if len(facts) < len(clips):
        raise SysidError("two motions have the same name; give them one at a time.")
    head = ("motion", "length", "speed", "period", "on ground", "slide", "peak joint speed", "limit margin")
    printer.table(head, [_row(name, fact) for name, fact in facts.items()])
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
    if rerun is not None:
        from reports.rerun.ride import motion_recording

        motion_recording(model, clips, rerun)
    written = [path for path in (plot, rerun) if path is not None]
    printer.result({"motions": [_json(name, fact, JOINTS) for name, fact in facts.items()]}, *written)


def _row(name: str, fact: "MotionFacts") -> tuple[str, ...]:
    return (
        name,
        f"{fact.frames} frames, {fact.duration:.2f} s",
        f"{fact.speed:.2f} m/s",
        f"{fact.period:.2f} s" if math.isfinite(fact.period) else "none",
        f"{100 * fact.stance:.0f} %",
        f"{fact.slide * 1e3:.0f} mm/s",
        f"{fact.peak_speed:.1f} rad/s ({fact.peak_speed_joint})",
        f"{fact.limit_margin:.3f} rad",
    )


def _json(name: str, fact: "MotionFacts", joints: tuple[str, ...]) -> dict[str, object]:
    own = ("speed", "stance", "slide", "penetration", "limit_margin", "period", "support_margin")
    peaks = ("peak_speed", "peak_speed_joint", "self_contacts")
    ranges = zip(joints, fact.joint_low, fact.joint_high, strict=True)
    return {
        "name": name,
        "frames": fact.frames,
        "duration_s": fact.duration,
        **{key: getattr(fact, key) for key in (*own, *peaks)},
        "ranges": {joint: [float(low), float(high)] for joint, low, high in ranges},
    }
