"""Worlds and policies for the tests of the runtime."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from policy_runtime.learning.onnx_export import policy_metadata
from policy_runtime.loop.world import make_world
from policy_runtime.robots import RobotState
from sim.skate.robot.g1 import JOINTS, default_pose, servos
from sysid.errors import SysidError
from sysid.workspace import Workspace

HIDDEN = (512, 256, 128)


def pink():
    return Workspace(Path("/nonexistent")).load_board("pink")


def world_or_skip(**options):
    try:
        return make_world(pink(), **options)
    except SysidError as error:
        pytest.skip(str(error))


class HoldStill:
    """Asks for the same joint targets always."""

    name = "hold"

    def __init__(self, target=None):
        self.target = default_pose() if target is None else target
        self.action = np.zeros(len(JOINTS))
        self.seen = []

    def reset(self, state):
        self.seen = []

    def act(self, state, command, step):
        self.seen.append((command, step))
        return self.target


class Puppet:
    """A robot whose states a test writes; it stands upright and is perfectly well unless told otherwise."""

    def __init__(self):
        self.steps = 0
        self.sent = []
        self.change = {}
        self.clock = True

    def read(self):
        values = {
            "time": self.steps * 0.002 if self.clock else 1.0,
            "age": 0.0,
            "quaternion": np.array([1.0, 0, 0, 0]),
            "angular_velocity": np.zeros(3),
            "joint_position": default_pose(),
            "joint_velocity": np.zeros(len(JOINTS)),
            "joint_torque": np.zeros(len(JOINTS)),
        }
        return RobotState(**(values | self.change))

    def send(self, command):
        self.sent.append(command)

    def step(self):
        self.steps += 1


def published_metadata():
    """Metadata as a policy of the HUSKY release carries it: its own key names, three decimals."""
    robot = servos()

    def join(values):
        return ",".join(f"{value:.3f}" for value in values)

    return {
        "run_path": "2026-01-01_00-00-00_synthetic",
        "joint_names": ",".join(JOINTS),
        "stiffness": join(robot.stiffness),
        "damping": join(robot.damping),
        "default_joint_pos": join(default_pose()),
        "command_names": "skate",
        "observation_names": "command,heading,base_ang_vel,projected_gravity,joint_pos,joint_vel,actions,phase",
        "action_scale": join(robot.action_scale),
    }


def our_metadata(board):
    return policy_metadata(board, "0" * 64, "run")


def make_onnx(path, *, size, metadata, seed=0, gain=0.02, actions=23, bias=0.0):
    """Write a policy of the published interface: normaliser, three ELU layers, 23 answers; random weights.

    Its answers stay within about `gain` of `bias`.
    """
    onnx = pytest.importorskip("onnx")
    from onnx import TensorProto, helper, numpy_helper

    rng = np.random.default_rng(seed)
    widths = (size, *HIDDEN, actions)
    constants = {"mean": rng.normal(0, 0.1, size), "std": rng.uniform(0.5, 1.5, size) + 0.01}
    nodes = [
        helper.make_node("Sub", ["obs", "mean"], ["centred"]),
        helper.make_node("Div", ["centred", "std"], ["h0"]),
    ]
    for i, (inner, outer) in enumerate(pairwise(widths)):
        last = i == len(widths) - 2
        constants[f"w{i}"] = rng.normal(0, (gain if last else 1.0) / np.sqrt(inner), (inner, outer))
        constants[f"b{i}"] = rng.normal(0, 0.01, outer) + (bias if last else 0.0)
        nodes.append(helper.make_node("Gemm", [f"h{i}", f"w{i}", f"b{i}"], ["actions" if last else f"g{i}"]))
        if not last:
            nodes.append(helper.make_node("Elu", [f"g{i}"], [f"h{i + 1}"]))
    graph = helper.make_graph(
        nodes,
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, size])],
        [helper.make_tensor_value_info("actions", TensorProto.FLOAT, [1, actions])],
        [numpy_helper.from_array(value.astype(np.float32), name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 11)], ir_version=6)
    for key, value in metadata.items():
        model.metadata_props.add(key=key, value=value)
    onnx.save(model, str(path))
    return constants


def answer_of(constants, observation):
    """Return what such a policy answers, computed by hand."""
    h = (observation - constants["mean"]) / constants["std"]
    layers = len(HIDDEN) + 1
    for i in range(layers):
        h = h @ constants[f"w{i}"] + constants[f"b{i}"]
        if i < layers - 1:
            h = np.where(h > 0, h, np.expm1(np.minimum(h, 0)))
    return h
