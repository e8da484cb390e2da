"""The torques of a joint along a motion: how strong each effect is, in plain numbers."""

import numpy as np

from sysid.effects import effect
from sysid.effects._algebra import NUMPY
from sysid.effects._base import JointState, TorqueEffect
from sysid.joint.law import JointLaw
from sysid.roll import Array


def effect_torque(law: JointLaw, name: str, time: Array, roll: Array, rate: Array) -> Array:
    """Return the torque of one effect of a law along a motion [N*m], shape (n,).

    For effects without memory it is the law itself. One with memory (an arm, a slider, a support) is what the
    joint's other torques leave of the inertia's.

    Args:
        time: Of the motion [s], shape (n,); counts where the effect has memory.
        roll: Roll [rad], shape (n,).
        rate: Roll rate [rad/s], shape (n,).
    """
    part = effect(name)
    parameters = part.named(dict(law.effects)[name])
    m = NUMPY
    motion = JointState(roll - law.rest_angle, rate, roll, law.stiffness)
    if part.states:
        return law.inertia * np.gradient(rate, time) - memoryless_torque(law, roll, rate)
    torque = np.zeros_like(roll)
    if not isinstance(part, TorqueEffect):
        return torque
    torque = torque + part.torque(m, motion, parameters, ())
    if part.friction is not None:
        torque = torque - np.sign(rate) * part.friction(m, motion.tilt, np.abs(rate), parameters)
    return torque


def memoryless_torque(law: JointLaw, roll: Array, rate: Array) -> Array:
    """Return the torque of spring, damper and all effects without memory [N*m] at roll and rate in SI, shape (n,) each."""
    torque = -law.stiffness * (roll - law.rest_angle) - law.damping * rate
    for name, _ in law.effects:
        if not effect(name).states:
            torque = torque + effect_torque(law, name, roll, roll, rate)
    return torque
