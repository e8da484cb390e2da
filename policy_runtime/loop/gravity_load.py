# pyright: reportAttributeAccessIssue=false, reportUnknownParameterType=false
# (MuJoCo ships no type stubs.)
"""Gravity compensation: joint targets with which soft servos reach a pose instead of sagging below it.

The servos are soft: a quarter of the torque limit bends a knee by 20°. So a script asks for more than the pose.
Statics give the surplus: holding torques over the servos' stiffness. The standing feet share the weight so that
the centre of pressure lies under the centre of mass.
"""

import mujoco
import numpy as np

from sim.skate.robot.g1 import FOOT_BODIES, SOLE_CENTRE, g1_spec, servos
from sysid.roll import Array


class GravityLoad:
    """Static joint torques of the G1 standing on one foot or on both."""

    def __init__(self) -> None:
        """Build the robot's model."""
        self.model = g1_spec(visuals=False).compile()
        self.data = mujoco.MjData(self.model)

    def torques(self, qpos: Array, standing: tuple[bool, bool], thrust: float = 0.0) -> Array:
        """Return the torques that hold a pose at rest [N*m], shape (23,).

        Args:
            qpos: The robot's MuJoCo configuration, shape (30,); its place does not matter.
            standing: Whether left and right foot bear weight.
            thrust: Force along x with which the ground pushes the left foot [N], where it stands.
        """
        model, data = self.model, self.data
        data.qpos[:], data.qvel[:] = qpos, 0.0
        mujoco.mj_forward(model, data)
        feet = [model.body(name).id for name, stands in zip(FOOT_BODIES, standing, strict=True) if stands]
        torque = data.qfrc_bias.copy()
        soles = [data.xpos[foot] + data.xmat[foot].reshape(3, 3) @ SOLE_CENTRE for foot in feet]
        weight = np.array([0.0, 0.0, float(model.body_subtreemass[1]) * 9.81])
        jacobian = np.zeros((3, model.nv))
        for foot, point, share in shares(feet, soles, data.subtree_com[1]):
            mujoco.mj_jac(model, data, jacobian, None, point, foot)
            torque -= jacobian.T @ (share * weight)
            if standing[0] and foot == feet[0]:
                torque -= thrust * jacobian[0]
        return torque[6:]

    def asked(self, qpos: Array, standing: tuple[bool, bool], thrust: float = 0.0) -> Array:
        """Return the joint targets that come to rest in a pose [rad], shape (23,); arguments as in `torques`."""
        robot = servos()
        torque = np.clip(self.torques(qpos, standing, thrust), -robot.effort, robot.effort)
        return qpos[7:] + torque / robot.stiffness


def shares(feet: list[int], soles: list[Array], com: Array) -> list[tuple[int, Array, float]]:
    """Share the weight between feet so that its centre of pressure lies under the centre of mass.

    Args:
        feet: Bodies of the feet that bear weight, none to two.
        soles: Middle of each sole [m], each of shape (3,).
        com: Centre of mass [m], shape (3,).

    Returns:
        For each foot: its body, the point of its pressure [m], its share of the weight.
    """
    if len(feet) == 1:
        return [(feet[0], np.array([com[0], com[1], soles[0][2]]), 1.0)]
    if not feet:
        return []
    apart = soles[1][:2] - soles[0][:2]
    second = float(np.clip((com[:2] - soles[0][:2]) @ apart / (apart @ apart), 0.0, 1.0))
    aside = com[:2] - soles[0][:2] - second * apart
    points = [sole + np.array([*aside, 0.0]) for sole in soles]
    return [(feet[0], points[0], 1 - second), (feet[1], points[1], second)]
