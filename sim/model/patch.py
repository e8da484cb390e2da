"""A fitted joint written into a copy of the user's file: comments, order and includes stay, one joint changes.

MuJoCo's own writer loses comments and includes. So the effects change a spec, and the changed attributes are written
into the text of the joint. The compiled text is compared with the compiled spec.
"""

import difflib
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sim.model import urdf
from sim.model.arc import walk
from sim.model.faults import disabled, pressed, refuse_unphysical
from sim.model.setup import Setup
from sim.model.subject import in_degrees, rest_of
from sim.model.text import (
    ADDED,
    LINKED,
    Wanted,
    files_of,
    included,
    is_actuator,
    is_joint,
    retag,
    tagged,
    with_folders,
    with_sections,
)
from sysid.board import Board
from sysid.effects import effect
from sysid.effects._mjcf import actuators_of
from sysid.errors import SysidError
from sysid.files import require_writable, write_atomically
from sysid.quantity import slide_unit

ATTRIBUTES = {
    "stiffness": "stiffness", "damping": "damping", "springref": "springref", "armature": "armature",
    "frictionloss": "frictionloss", "solref_friction": "solreffriction", "solimp_friction": "solimpfriction",
    "springyield": "springyield",
}  # fmt: skip
"""Attributes of a joint that a fit may change: MjSpec's name and MJCF's."""
ACTING = {name: name for name in ("gainprm", "biasprm", "forcerange", "delay", "nsample")}
"""The same of an actuator."""
COMPARED = (
    "jnt_stiffness", "jnt_stiffnesspoly", "dof_damping", "dof_dampingpoly", "dof_armature", "qpos_spring",
    "dof_frictionloss", "dof_solref", "dof_solimp", "tendon_stiffness", "tendon_lengthspring", "body_mass", "qpos0",
    "jnt_range", "actuator_gainprm", "actuator_biasprm", "actuator_forcerange",
)  # fmt: skip
"""Fields of a compiled model in which the copy must equal the spec."""
PACKAGES = {"site-packages", "dist-packages"}
"""Folders of installed packages: no default output goes there."""


@dataclass(frozen=True, slots=True)
class Patch:
    """The changes to the user's files."""

    before: Mapping[Path, str]
    """Text of the model's file, which is the first, and of all files that it includes."""
    files: Mapping[Path, str]
    """New text of each."""
    remarks: tuple[str, ...]
    """Parts that were not written, and the meaning of the numbers."""
    _spec: mujoco.MjSpec

    @property
    def diff(self) -> str:
        """The change, as `diff -u` shows it."""
        lines: list[str] = []
        for file, text in self.files.items():
            old, new = self.before[file].splitlines(keepends=True), text.splitlines(keepends=True)
            lines += difflib.unified_diff(old, new, str(file), f"{file} (patched)")
        return "".join(
            line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n" for line in lines
        )

    def save(self, path: Path) -> list[Path]:
        """Write the patched copies and return their paths, the model's first.

        An included file that changes is copied too, under the new model's name. In another folder than the model's all included
        files are copied, and meshes, textures and other files get absolute paths.

        Raises:
            SysidError: A file cannot be written, or the copy compiles to another model than the fitted one.
        """
        main = next(iter(self.files))
        home, folder = main.parent.resolve(), path.parent.resolve()
        moved = folder != home
        copied = {
            file for file, text in self.files.items() if moved or file == main or text != self.before[file]
        }
        while more := {file for file in self.files if included(main, self.files[file]) & copied} - copied:
            copied |= more
        named = {
            old: path if old == main else (folder if moved else old.parent) / f"{path.stem}_{old.name}"
            for old in copied
        }

        def linked(match: re.Match[str]) -> str:
            target = main.parent / match[3]
            if target in named:
                return f"{match[1]}{match[2]}{os.path.relpath(named[target].resolve(), folder)}{match[2]}"
            return f"{match[1]}{match[2]}{target.resolve()}{match[2]}" if moved else match[0]

        assets = any(len(getattr(self._spec, kind)) for kind in ("meshes", "textures", "hfields", "skins"))
        try:
            for old, new in named.items():
                text = LINKED.sub(linked, self.files[old])
                write_atomically(
                    new, with_folders(text, self._spec, home) if moved and assets and old == main else text
                )
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
    retag(files_of(setup.file), setup.joint, is_joint(setup.joint))


Writer = Callable[[Any, Any], Sequence[str]]
"""Changes a spec and one of its joints; returns remarks for the user."""


def patch(setup: Setup, board: Board) -> Patch:
    """Write a record's joint into the text of its model.

    Raises:
        SysidError: The joint is not in the text, a number is not physical, or MuJoCo cannot hold an effect there.
    """
    plain = setup.with_(payload=())

    def write(spec: Any, joint: Any) -> list[str]:
        return [*_write(plain, spec, joint, board), *pressed(plain, spec)]

    return patched(plain, {setup.joint: write})


def patched(setup: Setup, writers: Mapping[str, Writer]) -> Patch:
    """Change joints of a model and their actuators, and write the changes into the text of its files.

    Raises:
        SysidError: A joint is not in the text, or an effect needs a body of its own.
    """
    spec = setup.load()
    kept = setup.load() if setup.is_urdf else spec
    known = {kind: {one.name for one in getattr(spec, f"{kind}s")} for kind in ADDED}
    bodies, before = len(spec.bodies), files_of(setup.file)
    texts = dict(before)
    remarks: list[str] = []
    for name, write in writers.items():
        joint = setup.with_(joint=name).joint_of(spec)
        elements = [(joint, ATTRIBUTES, is_joint(name))]
        elements += [(one, ACTING, is_actuator(one.name, name)) for one in actuators_of(spec, joint)]
        given = [_numbers(one, names) for one, names, _ in elements]
        remarks += write(spec, joint)
        for (one, names, wanted), old in zip(elements, given, strict=True):
            changed = {
                key: value
                for key, value in _numbers(one, names).items()
                if not np.array_equal(value, old[key])
            }
            if names is ATTRIBUTES and setup.is_urdf:
                values = {ATTRIBUTES[key]: _text(value) for key, value in changed.items()}
                held = setup.with_(joint=name).joint_of(kept)
                remarks += urdf.write(texts, held, values)
            elif changed or names is ATTRIBUTES:  # a joint from elsewhere is refused, changed or not
                _rewrite(texts, name, wanted, changed)
            remarks += disabled(spec, changed)
    if len(spec.bodies) > bodies:
        raise SysidError(
            f"{setup.file}: an effect needs a body of its own, and a patch changes joints. Build the body into the model by hand, or "
            "fit without the effect."
        )
    if not setup.is_urdf:
        texts[setup.file] = with_sections(texts[setup.file], spec, known)
    return Patch(before, texts, tuple(remarks), kept)


def _rewrite(texts: dict[Path, str], joint: str, wanted: Wanted, changed: Mapping[str, np.ndarray]) -> None:
    """Set attributes of one element in the text of its file."""

    def change(tag: str) -> str:
        written = {{**ATTRIBUTES, **ACTING}[key]: _text(value) for key, value in changed.items()}
        if tag.startswith("<position"):  # a servo's gains have names of their own
            gains = {"gainprm": ("kp", 0, 1), "biasprm": ("kv", 2, -1)}
            for key in gains.keys() & changed.keys():
                del written[key]
                name, at, sign = gains[key]
                written[name] = _text(sign * changed[key][at])
        return tagged(tag, written)

    retag(texts, joint, wanted, change)


def _numbers(element: Any, names: Mapping[str, str]) -> dict[str, np.ndarray]:
    return {
        name: np.array(getattr(element, name), dtype=np.float64) for name in names if hasattr(element, name)
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


def _text(values: Any) -> str:
    """Return an attribute's value; of several numbers it ends at the last that is not zero."""
    return " ".join(f"{value:.7g}" for value in np.trim_zeros(np.atleast_1d(values), "b")) or "0"
