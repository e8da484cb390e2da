"""The text of a model: its files, the place of an element in them, and changes that leave the rest as it is."""

import re
import xml.etree.ElementTree as ElementTree
import xml.parsers.expat
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import mujoco

from sysid.errors import SysidError

HOLDERS = {"body", "worldbody", "frame", "replicate", "mujocoinclude", "mujoco", "robot"}
"""Parents of a joint element; elsewhere `joint` means another thing."""
ADDED = ("tendon", "actuator")
"""Sections that an effect may add elements to."""
LINKED = re.compile(r"""(<(?:include|model)\b[^>]*?\bfile\s*=\s*)(["'])(.*?)\2""")
"""An element that reads another model file, relative to the folder of the main one."""

Stack = Sequence[tuple[str, Mapping[str, str]]]
"""Tags and attributes of the elements around an element, the outermost first."""
Wanted = Callable[[str, Mapping[str, str], Stack], bool]
"""The test for an element: of its tag, its attributes and the elements around it."""


def is_joint(name: str) -> Wanted:
    """Return the test for the element of a joint."""
    return lambda tag, own, stack: (
        tag == "joint" and own.get("name") == name and (not stack or stack[-1][0] in HOLDERS)
    )


def is_actuator(name: str, joint: str) -> Wanted:
    """Return the test for the element of an actuator, which may have no name."""
    return lambda tag, own, stack: (
        [around for around, _ in stack[-1:]] == ["actuator"]
        and own.get("name", "") == name
        and joint in own.values()
    )


def is_dynamics(joint: str) -> Wanted:
    """Return the test for the `<dynamics>` of a joint in a URDF."""
    return lambda tag, own, stack: tag == "dynamics" and is_joint(joint)(*stack[-1], stack[:-1])


def included(main: Path, text: str) -> set[Path]:
    """Return the files that a text includes; all count from the folder of the main file."""
    return {main.parent / found[3] for found in LINKED.finditer(text) if found[1].startswith("<include")}


def files_of(main: Path) -> dict[Path, str]:
    """Return the texts of a model's file, the first, and of the files that it includes, at any depth."""
    texts: dict[Path, str] = {}
    waiting = [main]
    while waiting:
        file = waiting.pop(0)
        texts[file] = file.read_bytes().decode()
        waiting += [one for one in included(main, texts[file]) if one.is_file() and one not in texts]
    return texts


def retag(texts: dict[Path, str], joint: str, wanted: Wanted, change: Callable[[str], str] = str) -> None:
    """Change the start tag of an element of a joint in the text of its file, in place.

    Raises:
        SysidError: No file has the element.
    """
    for file, text in texts.items():
        raw = text.encode()
        try:
            start = start_of(raw, wanted)
        except xml.parsers.expat.ExpatError as error:
            raise SysidError(f"{file}: not XML ({error}).") from error
        if start is not None:
            tag = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""").match(raw, start)
            assert tag is not None  # expat has read it
            texts[file] = (raw[:start] + change(tag[0].decode()).encode() + raw[tag.end() :]).decode()
            return
    raise SysidError(
        f'{next(iter(texts))}: no element <joint name="{joint}"> stands in it or in its includes, so it was attached or replicated '
        "from another file. Patch that file."
    )


def start_of(raw: bytes, wanted: Wanted) -> int | None:
    """Return where the first wanted element starts [bytes]."""
    parser = xml.parsers.expat.ParserCreate()
    stack: list[tuple[str, Mapping[str, str]]] = []
    found: list[int] = []

    def start(name: str, own: Mapping[str, str]) -> None:
        if wanted(name, own, stack):
            found.append(parser.CurrentByteIndex)
        stack.append((name, own))

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: stack.pop()
    parser.Parse(raw, True)
    return found[0] if found else None


def tagged(tag: str, values: Mapping[str, str]) -> str:
    """Return a start tag with attributes set: in place if present, else at its end."""
    for name, value in values.items():
        pattern = re.compile(rf"""(\s{name}\s*=\s*)("[^"]*"|'[^']*')""")
        if pattern.search(tag):
            tag = pattern.sub(rf'\g<1>"{value}"', tag, count=1)
        else:
            close = re.search(r"\s*/?>$", tag)
            assert close is not None
            tag = f'{tag[: close.start()]} {name}="{value}"{tag[close.start() :]}'
    return tag


def with_sections(text: str, spec: mujoco.MjSpec, known: Mapping[str, set[str]]) -> str:
    """Return the model's text with the tendons and actuators that effects added, as sections of their own at its end."""
    new = {
        kind: [one.name for one in getattr(spec, f"{kind}s") if one.name not in known[kind]] for kind in ADDED
    }
    if not any(new.values()):
        return text
    spec.compile()
    written = ElementTree.fromstring(spec.to_xml())
    lines: list[str] = []
    for kind, names in new.items():
        added = [one for section in written.findall(kind) for one in section if one.get("name") in names]
        for one in added:
            one.tail = None
        if added:
            inline = (re.sub(r">\s+<", "><", ElementTree.tostring(one, encoding="unicode")) for one in added)
            parts = "".join(f"    {one}\n" for one in inline)
            lines.append(f"  <{kind}>\n{parts}  </{kind}>\n")
    at = text.rindex("</mujoco>")
    return text[:at] + "".join(lines) + text[at:]


def with_folders(text: str, spec: mujoco.MjSpec, home: Path) -> str:
    """Return the model's text with absolute folders of meshes and textures; the last compiler element of a file counts."""
    folders = {name: str((home / getattr(spec, name)).resolve()) for name in ("meshdir", "texturedir")}
    robot = "</robot>" in text
    if robot and (found := re.search(r"<compiler\b[^>]*>", text)):  # a URDF may have one only
        return text[: found.start()] + tagged(found[0], folders) + text[found.end() :]
    element = tagged("<compiler/>", folders)
    element = f"<mujoco>{element}</mujoco>" if robot else element
    at = text.rindex("</robot>" if robot else "</mujoco>")
    return f"{text[:at]}  {element}\n{text[at:]}"
