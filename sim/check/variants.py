"""A user's model with one part changed: if it then decays as measured, that part is the cause."""

import copy
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import mujoco
import numpy as np

from sim.board.clamped import ClampedScene
from sim.check.decays import SceneCheck, check_scene
from sysid.board import Board
from sysid.effects._mjcf import set_friction

Change = Callable[[mujoco.MjModel, int], bool]
"""Changes a model, given the number of the joint; returns whether there was something to change."""


def _actuated(model: mujoco.MjModel, joint: int) -> bool:
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)
    return model.nu > 0


def _constrained(model: mujoco.MjModel, joint: int) -> bool:
    bits = mujoco.mjtDisableBit
    off = int(bits.mjDSBL_CONSTRAINT) | int(bits.mjDSBL_FRICTIONLOSS) | int(bits.mjDSBL_LIMIT)
    changes = bool(model.opt.disableflags & off)
    model.opt.disableflags &= ~off
    return changes


def _unlimited(model: mujoco.MjModel, joint: int) -> bool:
    limited, model.jnt_limited[joint] = bool(model.jnt_limited[joint]), 0
    return limited


def _slack(model: mujoco.MjModel, joint: int) -> bool:
    for name in ("tendon_stiffness", "tendon_damping", "tendon_frictionloss"):
        getattr(model, name)[:] = 0.0
    return model.ntendon > 0


def _friction(*, hard: bool) -> Change:
    """Return the change to the friction solver's parameters that `fit` writes, or to MuJoCo's defaults."""
    like = mujoco.MjSpec().worldbody.add_body().add_joint()
    if hard:
        set_friction(like, 1.0)

    def change(model: mujoco.MjModel, joint: int) -> bool:
        dof = int(model.jnt_dofadr[joint])
        changes = bool(model.dof_frictionloss[dof]) and not np.allclose(
            model.dof_solref[dof], like.solref_friction
        )
        model.dof_solref[dof], model.dof_solimp[dof] = like.solref_friction, like.solimp_friction
        return changes

    return change


CHANGES: Mapping[str, tuple[Change, str]] = {
    "its actuators on": (_actuated, "they were probably on in the measurement: record without power"),
    "constraints and limits enabled": (_constrained, "delete the <flag> that disables them"),
    "without the joint's limit": (_unlimited, "correct its range"),
    "without its tendons": (
        _slack,
        "they were probably off in the measurement, or the joint's own damper holds them too",
    ),
    "hard frictionloss": (
        _friction(hard=True),
        'write solreffriction="0.002 1" and solimpfriction="0.9999 0.9999 0.001 0.5 2"',
    ),
    "MuJoCo's default soft frictionloss": (_friction(hard=False), "the log was probably simulated with it"),
}
"""Each change of the scene, and the advice if it halves the error."""


def variants(board: Board, scene: ClampedScene, decays: SceneCheck) -> Iterator[str]:
    """Yield each change of a user's model that halves the error: that part is the cause."""
    releases = [one.release for one in decays.releases]
    for name, (change, advice) in CHANGES.items():
        model = copy.copy(scene.model)
        if change(model, int(model.joint(scene.joint).id)):
            error = check_scene(board, replace(scene, model=model), releases).nrmse
            if error < decays.nrmse / 2:
                yield f"with {name} the scene is {100 * error:.2g} % off: {advice}"
