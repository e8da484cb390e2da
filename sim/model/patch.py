"""A fitted joint written back into a copy of the user's file: comments, order and includes stay, one joint changes.

MuJoCo's own writer loses comments and includes. So the change is made in a spec, as effects make it, what became other
there is written into the text where the joint stands, and the text is held against the spec.
"""

import difflib
import os
import re
import xml.etree.ElementTree as ElementTree
import xml.parsers.expat
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from sim.model.setup import Setup
from sysid.board import Board
from sysid.effects import effect
from sysid.errors import SysidError
from sysid.files import write_atomically
from sysid.quantity import slide_unit

ATTRIBUTES = {
    "stiffness": "stiffness", "damping": "damping", "springref": "springref", "armature": "armature",
    "frictionloss": "frictionloss", "solref_friction": "solreffriction", "solimp_friction": "solimpfriction",
    "springyield": "springyield",
}  # fmt: skip
"""What a fit may change of a joint: MjSpec's name and MJCF's."""
POLYNOMIALS = ("stiffness", "damping")
"""Attributes that may have one number or several."""
HOLDERS = {"body", "worldbody", "frame", "replicate", "mujocoinclude", "mujoco"}
"""Elements in which a joint may stand; elsewhere the word means another thing."""
ADDED = ("tendon", "actuator")
"""Sections that an effect may add elements to."""


@dataclass(frozen=True, slots=True)
class Patch:
    """The changes to the user's files."""

    files: Mapping[Path, str]
    """New text of each file that changes, by the file's old path: the one with the joint, and those that include it."""
    diff: str
    """The change, as `diff -u` shows it."""
    remarks: tuple[str, ...]
    """What could not be written, and what the numbers mean."""
    _spec: mujoco.MjSpec
    _main: Path

    def save(self, path: Path) -> list[Path]:
        """Write the patched copies and return their paths, the model's first.

        An included file is copied beside itself, under the new model's name; the copy of the model names that.

        Raises:
            SysidError: A file cannot be written, or the copy does not load as what was fitted.
        """
        renamed = {
            old: path if old == self._main else old.with_name(f"{path.stem}_{old.name}") for old in self.files
        }
        for old, text in self.files.items():
            for other, new in renamed.items():
                if other not in (old, self._main):
                    text = _including(text, old, other, new, renamed[old])
            write_atomically(renamed[old], text)
        try:
            self._verify(path)
        except SysidError:
            for new in renamed.values():
                new.unlink(missing_ok=True)
            raise
        return sorted(renamed.values(), key=lambda new: new != path)

    def _verify(self, path: Path) -> None:
        """Hold the compiled copy against what was meant.

        Raises:
            SysidError: It does not load there, or differs.
        """
        try:
            copy = mujoco.MjModel.from_xml_path(str(path))
        except ValueError as error:
            raise SysidError(
                f"{path}: the patched copy does not load from there ({str(error).strip().splitlines()[0]}). Its meshes and "
                "includes are found from its folder: write it beside the model."
            ) from error
        meant = self._spec.compile()
        for name in ("jnt_stiffness", "jnt_stiffnesspoly", "dof_damping", "dof_dampingpoly", "dof_armature", "qpos_spring",
                     "dof_frictionloss", "dof_solref", "dof_solimp", "tendon_stiffness", "tendon_lengthspring", "body_mass",
                     "qpos0", "jnt_range", "actuator_biasprm"):  # fmt: skip
            one, other = np.asarray(getattr(copy, name)), np.asarray(getattr(meant, name))
            if one.shape != other.shape or not np.allclose(one, other, rtol=1e-5, atol=1e-12):
                raise SysidError(
                    f"{path}: the patched copy compiles to another {name} than was fitted. Nothing is written."
                )


def patch(setup: Setup, board: Board) -> Patch:
    """Write a record's joint into the text of its model.

    Raises:
        SysidError: The joint is not in the text, or MuJoCo cannot hold an effect there.
    """
    plain = setup.with_(payload=())
    spec = plain.load()
    joint = plain.joint_of(spec)
    before = {
        name: np.array(getattr(joint, name), dtype=np.float64) for name in ATTRIBUTES if hasattr(joint, name)
    }
    known = {kind: {one.name for one in getattr(spec, f"{kind}s")} for kind in ADDED}
    bodies = len(spec.bodies)
    remarks = [*_write(setup, spec, joint, board), *_leaning(spec, setup.joint)]
    if len(spec.bodies) > bodies:
        raise SysidError(
            f"an effect of {board.name} needs a body of its own in the model, which a patch of the joint is not. Build it in "
            "by hand, or fit without it."
        )
    changed = {
        ATTRIBUTES[name]: text(name, np.array(getattr(joint, name), dtype=np.float64))
        for name, old in before.items()
        if not np.array_equal(old, np.array(getattr(joint, name), dtype=np.float64))
    }
    chain, start, end = find_element(setup.file, setup.joint, is_joint(setup.joint))
    home = chain[-1]
    texts = {file: file.read_bytes().decode() for file in chain}
    raw = texts[home].encode()
    tag = tagged(raw[start:end].decode(), changed)
    texts[home] = (raw[:start] + tag.encode() + raw[end:]).decode()
    main = chain[0]
    texts[main] = with_sections(texts[main], spec, known)
    return Patch(texts, difference(texts), tuple(remarks), spec, main)


def difference(texts: Mapping[Path, str]) -> str:
    """Return how texts differ from their files, as `diff -u` shows it."""
    old = {file: file.read_bytes().decode() for file in texts}
    return "".join(
        line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"
        for file in texts
        if texts[file] != old[file]
        for line in difflib.unified_diff(
            old[file].splitlines(keepends=True),
            texts[file].splitlines(keepends=True),
            str(file),
            f"{file} (patched)",
        )
    )


def _write(setup: Setup, spec: mujoco.MjSpec, joint: mujoco.MjsJoint, board: Board) -> list[str]:
    """Change the joint in the spec; return what a user should know."""
    from sim.model.subject import board_of

    stated, _ = board_of(setup)
    carried = stated.damping - float(joint.damping[0])
    own = board.damping - carried
    if own < 0:
        raise SysidError(
            f"the fitted damping {board.damping:.4g} is less than the {carried:.4g} that joints which '{setup.joint}' carries "
            "along have already. Lower theirs."
        )
    tendons, springref = len(spec.tendons), float(joint.springref)
    joint.stiffness = [board.stiffness, 0.0, 0.0]
    joint.damping = [own, 0.0, 0.0]
    joint.frictionloss = 0.0
    angular = spec.compiler.degree and int(joint.type) == int(mujoco.mjtJoint.mjJNT_HINGE)
    joint.springref = float(np.degrees(board.rest_angle)) if angular else board.rest_angle
    remarks: list[str] = []
    for part in board.effects:
        found = effect(part.name)
        values = {name: quantity.value for name, quantity in part.parameters.items()}
        if not found.is_known:
            told = found.to_mjcf(spec, joint, values, native=True)
            remarks += map(slide_unit, told) if board.slides else told
        elif values.get("scale", 1.0) != 1.0:
            remarks.append(
                f"the weight on the joint is {values['scale']:.4g} times what the masses of the model make; they are left as "
                "they are, for only their moment is known"
            )
    if not np.any(joint.stiffness) and len(spec.tendons) == tendons:
        joint.springref = springref  # nothing refers to it
    return remarks


def _leaning(spec: mujoco.MjSpec, name: str) -> list[str]:
    """Return a word of a joint whose spring rests beyond its range."""
    model = spec.copy().compile()
    joint = model.joint(name)
    rest, (low, high) = float(model.qpos_spring[joint.qposadr[0]]), map(float, joint.range)
    if not joint.limited[0] or low <= rest <= high:
        return []
    return [
        f"the spring of '{name}' rests at {rest:.4g}, beyond the joint's range of {low:.4g} to {high:.4g}: the model will lean on "
        "its limit. Correct the range, or fit a log whose zero is the model's"
    ]


def text(name: str, values: np.ndarray) -> str:
    """Return an attribute's value; a polynomial ends at its last term that is not zero."""
    numbers = np.atleast_1d(values)
    if name in POLYNOMIALS:
        numbers = numbers[: max(1, int(np.max(np.flatnonzero(numbers), initial=-1)) + 1)]
    return " ".join(f"{value:.7g}" for value in numbers)


def is_joint(name: str) -> Callable[[str, Mapping[str, str], Sequence[str]], bool]:
    """Return the test for the element of a joint: by its tag, its attributes and the tags around it."""
    return lambda tag, own, stack: (
        tag == "joint" and own.get("name") == name and (not stack or stack[-1] in HOLDERS)
    )


def find_element(
    file: Path, joint: str, wanted: Callable[[str, Mapping[str, str], Sequence[str]], bool],
    seen: Sequence[Path] = (), folder: Path | None = None, texts: Mapping[Path, str] | None = None,
) -> tuple[list[Path], int, int]:  # fmt: skip
    """Return the files from the model down to the one with an element, and where in that its start tag is [bytes].

    Args:
        joint: Named where there is none.
        wanted: Whether an element is the one, from its tag, its attributes and the tags around it.
        texts: Of files that have changed already.

    Raises:
        SysidError: It is in none of them.
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
        f'{file}: no element <joint name="{joint}"> stands in it or in what it includes, so it was attached or replicated from '
        "elsewhere. Patch the file that it comes from."
    )


def _end_of_tag(raw: bytes, start: int) -> int:
    match = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""").match(raw, start)
    assert match is not None  # expat has read it
    return match.end()


def tagged(tag: str, values: Mapping[str, str]) -> str:
    """Return a start tag with attributes set: in their place where they are there, else at its end."""
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


def _including(text: str, old: Path, other: Path, new: Path, home: Path) -> str:
    """Return a text that includes the copy of a file instead of the file."""
    wanted = os.path.relpath(new, home.parent)

    def swapped(match: re.Match[str]) -> str:
        same = (old.parent / match[2]).resolve() == other.resolve()
        return f"{match[1]}{wanted}{match[3]}" if same else match[0]

    return re.sub(r"""(<include[^>]*\bfile\s*=\s*["'])([^"']*)(["'])""", swapped, text)
