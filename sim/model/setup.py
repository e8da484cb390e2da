"""The setup of a measurement: the joint of a model, its pose, the free joints and the payload."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import mujoco
import numpy as np

from sim.model.urdf import is_urdf
from sysid.errors import SysidError, did_you_mean
from sysid.roll import Array

SINGLE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def switch_off(options: Any, *parts: str) -> None:
    """Switch off parts of MuJoCo's physics, named as in `mjtDisableBit`, in the options of a spec or model."""
    for part in parts:
        options.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{part}"))


@dataclass(frozen=True, slots=True)
class Payload:
    """A known mass, small enough to count as a point, that was fixed to the model."""

    mass: float
    """[kg]."""
    where: tuple[float, float, float] | str
    """In the frame of the joint's body [m], or the name of a site."""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read 'MASS@X,Y,Z' or 'MASS@SITE', in kg and m.

        Raises:
            SysidError: The text has another shape.
        """
        mass, _, where = text.partition("@")
        try:
            numbers = tuple(float(part) for part in where.split(","))
        except ValueError:
            numbers = ()
        try:
            if where and float(mass) > 0:
                return cls(float(mass), numbers if len(numbers) == 3 else where)
        except ValueError:
            pass
        raise SysidError(
            f"payload '{text}': expected MASS@X,Y,Z in the frame of the joint's body, or MASS@SITE; kg and m."
        )

    def __str__(self) -> str:
        """As it is parsed."""
        where = self.where if isinstance(self.where, str) else ",".join(f"{value:g}" for value in self.where)
        return f"{self.mass:g}@{where}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """One joint of a model in the setup of the measurement."""

    file: Path
    """The MJCF, with its includes."""
    joint: str
    keyframe: str = ""
    """Pose of the whole model; its own if left out."""
    pose: Mapping[str, float] = field(default_factory=dict[str, float])
    """Positions of single joints [rad or m], on top of that."""
    free: tuple[str, ...] = ()
    """Joints that were free to move along; all others were held, but for those that a loop ties to this one."""
    payload: tuple[Payload, ...] = ()

    @property
    def is_urdf(self) -> bool:
        """Whether the model is a URDF."""
        return is_urdf(self.file)

    def with_(self, **changes: Any) -> Self:
        """Return the same with some things changed."""
        return replace(self, **changes)

    def entry(self) -> dict[str, Any]:
        """Return it as a table of the record."""
        fields = {
            "file": str(self.file), "joint": self.joint, "keyframe": self.keyframe, "pose": dict(self.pose),
            "free": list(self.free), "payload": [str(one) for one in self.payload],
        }  # fmt: skip
        return {name: value for name, value in fields.items() if value}

    @classmethod
    def of_entry(cls, entry: Mapping[str, Any]) -> Self:
        """Return the setup of an `entry`."""
        return cls(
            file=Path(entry["file"]), joint=entry["joint"], keyframe=entry.get("keyframe", ""),
            pose=entry.get("pose", {}), free=tuple(entry.get("free", ())),
            payload=tuple(Payload.parse(text) for text in entry.get("payload", ())),
        )  # fmt: skip

    def read(self) -> mujoco.MjSpec:
        """Read the model without the payload.

        Raises:
            SysidError: The file cannot be read.
        """
        if not self.file.is_file():
            raise SysidError(f"{self.file}: there is no such model.")
        try:
            return mujoco.MjSpec.from_file(str(self.file))
        except (OSError, ValueError) as error:
            raise SysidError(
                f"{self.file}: MuJoCo cannot read it ({str(error).strip().splitlines()[0]})."
            ) from error

    def compiled(self, spec: mujoco.MjSpec) -> mujoco.MjModel:
        """Compile a spec of the model.

        Raises:
            SysidError: It does not compile.
        """
        try:
            return spec.compile()
        except ValueError as error:  # e.g. a moving body without a mass
            said = " ".join(str(error).removeprefix("Error: ").split())
            packages = ' Name the folder of its meshes: <mujoco><compiler strippath="true" meshdir="FOLDER"/></mujoco>.'
            raise SysidError(
                f"{self.file}: MuJoCo cannot compile it ({said}).{packages if 'package:' in said else ''}"
            ) from error

    def load(self) -> mujoco.MjSpec:
        """Read the model, with the payload on it.

        Raises:
            SysidError: The file cannot be read, or lacks the joint or a site.
        """
        spec = self.read()
        joint = self.joint_of(spec)
        if np.all(np.asarray(joint.springdamper) > 0):
            raise SysidError(
                f"{self.file}: springdamper of joint '{self.joint}' overrides its stiffness and damping, so a fitted joint has no "
                "place. Replace it by stiffness and damping."
            )
        for number, load in enumerate(self.payload):
            body, where = joint.parent, load.where
            if isinstance(where, str):
                site = next((one for one in spec.sites if one.name == where), None)
                if site is None:
                    names = [one.name for one in spec.sites if one.name]
                    raise SysidError(
                        f"{self.file}: there is no site '{where}' for the payload.{did_you_mean(where, names)}"
                    )
                body, where = site.parent, site.pos
            # No smaller inertia compiles; it is that of a grain.
            body.add_body(
                name=f"payload {number}", pos=where, mass=load.mass, inertia=[1e-12] * 3, ipos=[0.0, 0.0, 0.0],
                explicitinertial=True,
            )  # fmt: skip
        return spec

    def joint_of(self, spec: mujoco.MjSpec) -> mujoco.MjsJoint:
        """Return the joint in a spec.

        Raises:
            SysidError: The joint is missing, or is a ball or free joint.
        """
        found = next((one for one in spec.joints if one.name == self.joint), None)
        if found is None:
            names = [one.name for one in spec.joints if one.name and int(one.type) in SINGLE]
            raise SysidError(
                f"{self.file}: there is no joint '{self.joint}'.{did_you_mean(self.joint, names)} Joints: {', '.join(names)}. Name one by "
                "--joint."
            )
        if int(found.type) not in SINGLE:
            raise SysidError(
                f"{self.file}: '{self.joint}' is a ball or free joint; a hinge or a slide has one angle to measure."
            )
        return found

    def posed(self, model: mujoco.MjModel) -> Array:
        """Return the positions of the model in its pose, shape (nq,), in MuJoCo's units.

        Raises:
            SysidError: There is no such keyframe or joint.
        """
        data = mujoco.MjData(model)
        if self.keyframe:
            key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, self.keyframe)
            if key < 0:
                names = [model.key(i).name for i in range(model.nkey)]
                raise SysidError(
                    f"{self.file}: there is no keyframe '{self.keyframe}'. Keyframes: {', '.join(names) or 'none'}."
                )
            mujoco.mj_resetDataKeyframe(model, data, key)
        qpos = np.array(data.qpos)
        for name, value in self.pose.items():
            qpos[model.jnt_qposadr[self.named(model, name)]] = value
        return qpos

    def named(self, model: mujoco.MjModel, name: str) -> int:
        """Return the number of a hinge or slide.

        Raises:
            SysidError: No hinge or slide has that name.
        """
        number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        if number < 0 or int(model.jnt_type[number]) not in SINGLE:
            names: Sequence[str] = [
                model.joint(i).name for i in range(model.njnt) if int(model.jnt_type[i]) in SINGLE
            ]
            raise SysidError(f"{self.file}: there is no hinge or slide '{name}'.{did_you_mean(name, names)}")
        return number
