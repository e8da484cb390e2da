"""A fitted joint written into a copy of the user's file: comments, order and includes stay, one joint changes.

MuJoCo's own writer loses comments and includes. So the effects change a spec, and the changed attributes are written
into the text of the joint. The compiled text is compared with the compiled spec.
"""

import difflib
import os
import re
import xml.etree.ElementTree as ElementTree
import xml.parsers.expat
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from sim.model import urdf
from sim.model.arc import walk
from sim.model.faults import disabled, refuse_unphysical
from sim.model.setup import Setup
from sim.model.subject import in_degrees, rest_of
from sysid.board import Board
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.files import require_writable, write_atomically
from sysid.quantity import slide_unit

ATTRIBUTES = {
    "stiffness": "stiffness", "damping": "damping", "springref": "springref", "armature": "armature",
    "frictionloss": "frictionloss", "solref_friction": "solreffriction", "solimp_friction": "solimpfriction",
    "springyield": "springyield",
}  # fmt: skip
"""Attributes of a joint that a fit may change: MjSpec's name and MJCF's."""
COMPARED = (
    "jnt_stiffness", "jnt_stiffnesspoly", "dof_damping", "dof_dampingpoly", "dof_armature", "qpos_spring",
    "dof_frictionloss", "dof_solref", "dof_solimp", "tendon_stiffness", "tendon_lengthspring", "body_mass", "qpos0",
    "jnt_range", "actuator_biasprm",
)  # fmt: skip
"""Fields of a compiled model in which the copy must equal the spec."""
POLYNOMIALS = ("stiffness", "damping")
"""Attributes that hold one number or several."""
HOLDERS = {"body", "worldbody", "frame", "replicate", "mujocoinclude", "mujoco"}
"""Parents of a joint element; elsewhere `joint` means another thing."""
ADDED = ("tendon", "actuator")
"""Sections that an effect may add elements to."""
LINKED = re.compile(r"""(<(?:include|model)\b[^>]*?\bfile\s*=\s*)(["'])(.*?)\2""")
"""An element that reads another model file, relative to the folder of the main one."""
PACKAGES = {"site-packages", "dist-packages"}
"""Folders of installed packages: no default output goes there."""


@dataclass(frozen=True, slots=True)
class Patch:
    """The changes to the user's files."""

    files: Mapping[Path, str]
    """New text of each file that changes, by its old path: the joint's file, and the files that include it."""
    diff: str
    """The change, as `diff -u` shows it."""
    remarks: tuple[str, ...]
    """Parts that were not written, and the meaning of the numbers."""
    _spec: mujoco.MjSpec
    _main: Path

    def save(self, path: Path) -> list[Path]:
        """Write the patched copies and return their paths, the model's first.

        An included file is copied too, under the new model's name. In another folder than the model's, the copy names
        meshes, textures and other files by absolute paths.

        Raises:
            SysidError: A file cannot be written, or the copy compiles to another model than the fitted one.
        """
        home = self._main.parent.resolve()
        moved = path.parent.resolve() != home
        texts = {file.resolve(): text for file, text in self.files.items()}
        for file in _nested(self._main, home) if moved else ():
            texts.setdefault(file, file.read_bytes().decode())
        main, assets = self._main.resolve(), ("meshes", "textures", "hfields", "skins")
        has_assets = any(len(getattr(self._spec, kind)) for kind in assets)
        named = {
            old: path if old == main else (path.parent if moved else old.parent) / f"{path.stem}_{old.name}"
            for old in texts
        }

        def linked(match: re.Match[str]) -> str:
            target = (home / match[3]).resolve()
            if target in named:
                return f"{match[1]}{match[2]}{os.path.relpath(named[target].resolve(), path.parent.resolve())}{match[2]}"
            return f"{match[1]}{match[2]}{target}{match[2]}" if moved else match[0]

        try:
            for old, text in texts.items():
                text = LINKED.sub(linked, text)
                text = _with_folders(text, self._spec, home) if moved and has_assets and old == main else text
                write_atomically(named[old], text)
            self._verify(path)
        except SysidError:
            for new in named.values():
                new.unlink(missing_ok=True)
            raise
        return [path, *(new for old, new in named.items() if old != main)]

    def _verify(self, path: Path) -> None:
        """Compare the compiled copy with the compiled spec.

        Raises:
            SysidError: The copy does not load, or differs.
        """
        try:
            copy = mujoco.MjModel.from_xml_path(str(path))
        except ValueError as error:
            raise SysidError(
                f"{path}: the patched copy does not load from there ({str(error).strip().splitlines()[0]}). Write it beside "
                "the model."
            ) from error
        meant = self._spec.compile()
        for name in COMPARED:
            one, other = np.asarray(getattr(copy, name)), np.asarray(getattr(meant, name))
            if one.shape != other.shape or not np.allclose(one, other, rtol=1e-5, atol=1e-12):
                raise SysidError(
                    f"{path}: the patched copy compiles to another {name} than was fitted. Nothing is written."
                )


def copy_path(setup: Setup, name: str, folder: Path) -> Path:
    """Return the default path of a patched copy: NAME beside the model.

    The model's folder may belong to an installed package, or be read-only: then the copy goes into `folder`.
    """
    beside = setup.file.with_name(f"{name}{setup.file.suffix}")
    if PACKAGES & {*setup.file.resolve().parts}:
        return folder / beside.name
    try:
        require_writable(beside)
    except SysidError:
        return folder / beside.name
    return beside


def require_patchable(setup: Setup) -> None:
    """Check before a fit that the joint's element can be found in the text of its model.

    Raises:
        SysidError: No file has the joint.
    """
    if setup.is_urdf:
        urdf.locate(setup.file, setup.joint)
    else:
        find_element(setup.file, setup.joint, is_joint(setup.joint))


def patch(setup: Setup, board: Board) -> Patch:
    """Write a record's joint into the text of its model.

    Raises:
        SysidError: The joint is not in the text, a number is not physical, or MuJoCo cannot hold an effect there.
    """
    plain = setup.with_(payload=())
    spec = plain.load()
    joint = plain.joint_of(spec)
    before = _attributes(joint)
    known = {kind: {one.name for one in getattr(spec, f"{kind}s")} for kind in ADDED}
    bodies = len(spec.bodies)
    remarks = [*_write(plain, spec, joint, board), *_leaning(spec, setup.joint)]
    if len(spec.bodies) > bodies:
        raise SysidError(
            f"an effect of {board.name} needs a body of its own, and a patch changes one joint. Build the body into the model "
            "by hand, or fit without the effect."
        )
    changed = {
        ATTRIBUTES[name]: attribute_text(name, value)
        for name, value in _attributes(joint).items()
        if not np.array_equal(before[name], value)
    }
    if setup.is_urdf:
        spec = plain.load()
        text, lost = urdf.written(setup.file, plain.joint_of(spec), changed)
        texts, remarks = {setup.file: text}, [*remarks, *lost]
    else:
        chain, start, end = find_element(setup.file, setup.joint, is_joint(setup.joint))
        texts = {file: file.read_bytes().decode() for file in chain}
        raw = texts[chain[-1]].encode()
        tag = tagged(raw[start:end].decode(), changed)
        texts[chain[-1]] = (raw[:start] + tag.encode() + raw[end:]).decode()
        texts[setup.file] = with_sections(texts[setup.file], spec, known)
    remarks += disabled(spec, changed)
    return Patch(texts, difference(texts), tuple(remarks), spec, setup.file)


def difference(texts: Mapping[Path, str]) -> str:
    """Return how texts differ from their files, as `diff -u` shows it."""
    lines: list[str] = []
    for file, text in texts.items():
        old = file.read_bytes().decode()
        before, after = old.splitlines(keepends=True), text.splitlines(keepends=True)
        lines += difflib.unified_diff(before, after, str(file), f"{file} (patched)")
    return "".join(
        line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n" for line in lines
    )


def _attributes(joint: mujoco.MjsJoint) -> dict[str, np.ndarray]:
    return {
        name: np.array(getattr(joint, name), dtype=np.float64) for name in ATTRIBUTES if hasattr(joint, name)
    }


def _write(setup: Setup, spec: mujoco.MjSpec, joint: mujoco.MjsJoint, board: Board) -> list[str]:
    """Change the joint in the spec; return remarks for the user."""
    arc = walk(setup, spec)
    rest = rest_of(setup, spec, arc)
    damping, friction = arc.at(rest, arc.damping), arc.at(rest, arc.friction)
    tendons, springref = len(spec.tendons), float(joint.springref)
    joint.stiffness = [board.stiffness, 0.0, 0.0]
    joint.damping = [board.damping - damping, 0.0, 0.0]
    joint.frictionloss = 0.0
    joint.springref = float(np.degrees(board.rest_angle)) if in_degrees(spec, joint) else board.rest_angle
    remarks: list[str] = []
    for part in board.effects:
        found = effect(part.name)
        values = {name: quantity.value for name, quantity in part.parameters.items()}
        if not found.is_known:
            told = found.to_mjcf(spec, joint, values, native=True)
            remarks += map(slide_unit, told) if board.slides else told
        elif (scale := part.parameters.get("scale")) and not scale.ci95[0] <= 1 <= scale.ci95[1]:
            remarks.append(
                f"the fitted weight is {scale.value:.4g} times the model's. The masses are left as they are: only their moment "
                "is known"
            )
    if joint.frictionloss:
        joint.frictionloss -= friction
    for word, carried in (("damping", damping), ("dry friction", friction)):
        if carried:
            remarks.append(
                f"{word}: tendons and carried joints hold {carried:.4g} of it, the rest is the joint's"
            )
    refuse_unphysical(setup, joint, board)
    if not np.any(joint.stiffness) and len(spec.tendons) == tendons:
        joint.springref = springref  # no spring refers to it
    return remarks


def _leaning(spec: mujoco.MjSpec, name: str) -> list[str]:
    """Return a remark on a spring that rests outside the joint's range."""
    model = spec.copy().compile()
    joint = model.joint(name)
    rest, (low, high) = float(model.qpos_spring[joint.qposadr[0]]), map(float, joint.range)
    if not joint.limited[0] or low <= rest <= high or not joint.stiffness[0]:
        return []
    return [
        f"the spring of '{name}' rests at {rest:.4g}, outside the joint's range of {low:.4g} to {high:.4g}: the model leans on "
        "its limit. Correct the range, or fit a log whose zero is the model's"
    ]


def attribute_text(name: str, values: np.ndarray) -> str:
    """Return an attribute's value; a polynomial ends at its last term that is not zero."""
    numbers = np.atleast_1d(values)
    if name in POLYNOMIALS:
        numbers = numbers[: max(1, int(np.max(np.flatnonzero(numbers), initial=-1)) + 1)]
    return " ".join(f"{value:.7g}" for value in numbers)


def is_joint(name: str) -> Callable[[str, Mapping[str, str], Sequence[str]], bool]:
    """Return the test for the element of a joint: of its tag, its attributes and the tags around it."""
    return lambda tag, own, stack: (
        tag == "joint" and own.get("name") == name and (not stack or stack[-1] in HOLDERS)
    )


def find_element(
    file: Path, joint: str, wanted: Callable[[str, Mapping[str, str], Sequence[str]], bool], seen: Sequence[Path] = (),
    folder: Path | None = None, texts: Mapping[Path, str] | None = None,
) -> tuple[list[Path], int, int]:  # fmt: skip
    """Return the files from the model down to an element's, and the element's start tag in that [bytes].

    Args:
        joint: Named in the error.
        wanted: The test for the element.
        texts: Texts of files that have changed already.

    Raises:
        SysidError: No file has the element.
    """
    folder = folder or file.parent
    raw = texts[file].encode() if texts and file in texts else file.read_bytes()
    parser = xml.parsers.expat.ParserCreate()
    stack: list[str] = []
    found: list[int] = []
    includes: list[Path] = []

    def start(name: str, attributes: Mapping[str, str]) -> None:
        if wanted(name, attributes, stack):
            found.append(parser.CurrentByteIndex)
        if name == "include" and "file" in attributes:
            includes.append(folder / attributes["file"])
        stack.append(name)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: stack.pop()
    try:
        parser.Parse(raw, True)
    except xml.parsers.expat.ExpatError as error:
        raise SysidError(f"{file}: not XML ({error}).") from error
    if found:
        return [*seen, file], found[0], _end_of_tag(raw, found[0])
    for path in includes:
        if path.is_file():
            try:
                return find_element(path, joint, wanted, [*seen, file], folder, texts)
            except LookupError:
                continue
    if seen:
        raise LookupError(joint)
    raise SysidError(
        f'{file}: no element <joint name="{joint}"> stands in it or in its includes, so it was attached or replicated from '
        "another file. Patch that file."
    )


def _end_of_tag(raw: bytes, start: int) -> int:
    match = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""").match(raw, start)
    assert match is not None  # expat has read it
    return match.end()


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


def _nested(file: Path, home: Path) -> Iterator[Path]:
    """Yield included files that include others: MuJoCo resolves their links from the main file's folder."""
    for match in LINKED.finditer(file.read_bytes().decode()):
        included = (home / match[3]).resolve()
        if match[1].startswith("<include") and included.is_file() and LINKED.search(included.read_text()):
            yield included
            yield from _nested(included, home)


def _with_folders(text: str, spec: mujoco.MjSpec, home: Path) -> str:
    """Return the model's text with absolute folders of meshes and textures; the last compiler element of a file counts."""
    folders = {name: str((home / getattr(spec, name)).resolve()) for name in ("meshdir", "texturedir")}
    robot = "</robot>" in text
    if robot and (found := re.search(r"<compiler\b[^>]*>", text)):  # a URDF may have one only
        return text[: found.start()] + tagged(found[0], folders) + text[found.end() :]
    element = tagged("<compiler/>", folders)
    root = "</mujoco>" if "</mujoco>" in text else "</robot>"
    element = f"<mujoco>{element}</mujoco>" if root == "</robot>" else element
    at = text.rindex(root)
    return f"{text[:at]}  {element}\n{text[at:]}"
