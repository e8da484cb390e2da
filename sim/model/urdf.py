"""A fitted joint in a URDF, whose `<dynamics>` holds two numbers of a joint: damping and dry friction."""

from collections.abc import Mapping
from pathlib import Path
from xml.parsers.expat import ExpatError

import mujoco

from sim.model.text import is_dynamics, is_joint, retag, start_of, tagged
from sysid.errors import SysidError

HELD = {"damping": "damping", "frictionloss": "friction"}
"""MJCF's attributes that URDF has, and its names."""
NOTE = (
    "a URDF holds a joint's damping and dry friction only: `fit` writes these into <dynamics> and prints the rest. Convert the "
    "file to MJCF to keep all (MjSpec.from_file, then to_xml)"
)


def is_urdf(file: Path) -> bool:
    """Return whether the root element of a file is `<robot>`."""
    try:
        return start_of(file.read_bytes(), lambda tag, own, stack: tag == "robot" and not stack) is not None
    except (OSError, ExpatError):
        return False


def write(texts: dict[Path, str], joint: mujoco.MjsJoint, values: Mapping[str, str]) -> list[str]:
    """Set `<dynamics>` of a joint in the text of its URDF, in place; return a remark on the attributes that it cannot hold.

    Args:
        joint: The joint as the file states it; changed in place.

    Raises:
        SysidError: The joint is not in the text.
    """
    held = {name: value for name, value in values.items() if name in HELD and " " not in value}
    dynamics = {HELD[name]: value for name, value in held.items()}
    try:
        retag(texts, joint.name, is_dynamics(joint.name), lambda tag: tagged(tag, dynamics))
    except SysidError:  # it has none
        new = tagged("<dynamics/>", dynamics) if dynamics else ""
        retag(texts, joint.name, is_joint(joint.name), lambda tag: tag + new)
    if "damping" in held:
        joint.damping[0] = float(held["damping"])
    if "frictionloss" in held:
        joint.frictionloss = float(held["frictionloss"])
    lost = [f'{name}="{value}"' for name, value in values.items() if name not in held]
    return [f"not written, for a URDF cannot hold it: {', '.join(lost)}"] if lost else []
