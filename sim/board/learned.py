"""The part of a learned torque that MuJoCo has no element for, applied as an external torque in every step.

A model with such a torque (`husky-sysid mjcf`) carries its tables as custom numbers. The tables of the tilt act as tendons in any
case. In plain MuJoCo, these lines add the rest to the passive torques:

    import mujoco
    from sim.board.learned import passive
    mujoco.set_mjcb_passive(passive)
"""

import mujoco

from sysid.effects.learned import NUMERIC, Remainder

Left = list[tuple[int, int, Remainder]]


def left_out(model: mujoco.MjModel) -> Left:
    """Return address in qpos, address in qvel and missing part of each learned torque of a model."""
    found: Left = []
    for index in range(model.nnumeric):
        name = model.numeric(index).name
        if NUMERIC in name:
            joint = model.joint(name.split(NUMERIC)[0])
            found.append(
                (int(joint.qposadr[0]), int(joint.dofadr[0]), Remainder.of(model.numeric(index).data))
            )
    return found


def apply(left: Left, data: mujoco.MjData) -> None:
    """Set the missing parts as applied torques of the next step."""
    for _, v, _ in left:
        data.qfrc_applied[v] = 0.0
    for q, v, torque in left:
        data.qfrc_applied[v] += torque(float(data.qpos[q]), float(data.qvel[v]))


_KNOWN: dict[bytes, Left] = {}
"""By a model's custom numbers: the same model comes as another Python object each time."""


def passive(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Add the missing parts to the passive torques; for `mujoco.set_mjcb_passive`."""
    if model.nnumeric == 0:
        return
    key = model.numeric_data.tobytes()
    if key not in _KNOWN:
        _KNOWN[key] = left_out(model)
    for q, v, torque in _KNOWN[key]:
        data.qfrc_passive[v] += torque(float(data.qpos[q]), float(data.qvel[v]))
