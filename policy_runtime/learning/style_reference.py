"""Reference windows of the style discriminator: windows of the motions, with the phase of the cycle that they are of.

In the default a window is five joint frames of pushing. If style also teaches mounting and dismounting, three
more numbers name the phase one-hot, as `sim.skate.mdp.observations.phase_one_hot` does for the policy's
windows.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from policy_runtime.motion.motions import Motion, load_motions, windows
from sim.skate.options import SkateOptions
from sysid.files import shipped_data
from sysid.roll import Array

PHASES = ("push", "mount", "dismount")


def transition_folder() -> Path:
    """Return where the shipped clips of mounting and dismounting are."""
    return shipped_data() / "motions" / "transitions"


def style_reference(options: SkateOptions, pushing: Sequence[Motion] = ()) -> Array:
    """Return the reference windows of a variant of the task.

    Args:
        options: The variant. Nothing taught by style still gets the pushing windows: the discriminator is
            built, and left alone.

    Returns:
        Windows [rad], shape (m, 5 · 23), or (m, 5 · 23 + 3) with phases, grouped by phase.
    """
    pushing = pushing or load_motions()
    if options.transition != "style":
        return np.concatenate([windows(motion.joints) for motion in pushing])
    clips = load_motions([transition_folder()])
    groups = {
        "push": pushing if options.pushing == "amp" else [],
        "mount": [clip for clip in clips if clip.name.startswith("mount")],
        "dismount": [clip for clip in clips if clip.name.startswith("dismount")],
    }
    rows = [
        np.hstack([found, np.tile(np.eye(len(PHASES))[i], (len(found), 1))])
        for i, name in enumerate(PHASES)
        for found in (windows(motion.joints) for motion in groups[name])
    ]
    return np.concatenate(rows)
