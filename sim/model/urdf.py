"""A fitted joint in a URDF, whose `<dynamics>` holds two numbers of a joint: damping and dry friction."""

import re
from collections.abc import Mapping
from pathlib import Path

import mujoco

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
        text = file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    root = re.search(r"<([A-Za-z][\w:]*)", re.sub(r"<!--.*?-->|<\?.*?\?>|<!.*?>", "", text, flags=re.DOTALL))
    return root is not None and root[1] == "robot"


def locate(file: Path, joint: str, text: str) -> re.Match[str]:
    """Return the element of a joint in the text of a URDF.

    Raises:
        SysidError: It is not there.
    """
    blank = re.sub(r"<!--.*?-->", lambda comment: " " * len(comment[0]), text, flags=re.DOTALL)
    # The joints of transmissions have no type.
    tag = rf"""<joint\b(?=[^>]*\btype\s*=)(?=[^>]*\bname\s*=\s*["']{re.escape(joint)}["'])[^>]*[^/]>.*?</joint>"""
    found = re.search(tag, blank, re.DOTALL)
    if found is None:
        raise SysidError(f'{file}: no element <joint name="{joint}"> with a content stands in it.')
    return found


def written(
    file: Path, joint: mujoco.MjsJoint, values: Mapping[str, str], text: str
) -> tuple[str, list[str]]:
    """Return the text with `<dynamics>` of a joint set, and a remark on the attributes that it cannot hold.

    Args:
        joint: The joint as the file states it; changed in place.
    """
    found = locate(file, joint.name, text)
    held = {name: value for name, value in values.items() if name in HELD and " " not in value}
    element = text[found.start() : found.end()]
    old = re.search(r"<dynamics\b[^>]*>", element)
    tag = old[0] if old else "<dynamics/>"
    for name, value in held.items():
        tag = re.sub(rf"""\s+{HELD[name]}\s*=\s*("[^"]*"|'[^']*')""", "", tag)
        tag = re.sub(r"\s*(/?>)$", rf' {HELD[name]}="{value}"\1', tag)
    at = old.span() if old else (element.rindex("</joint>"),) * 2
    element = element[: at[0]] + tag + element[at[1] :]
    if "damping" in held:
        joint.damping[0] = float(held["damping"])
    if "frictionloss" in held:
        joint.frictionloss = float(held["frictionloss"])
    lost = [f'{name}="{value}"' for name, value in values.items() if name not in held]
    remark = [f"not written, for a URDF cannot hold it: {', '.join(lost)}"] if lost else []
    return text[: found.start()] + element + text[found.end() :], remark
