"""The tilt joint: its law and its motion."""

from sysid.joint.law import JointLaw
from sysid.joint.trajectory import Trajectory, simulate

__all__ = ["JointLaw", "Trajectory", "simulate"]
