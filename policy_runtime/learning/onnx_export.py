# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""A trained actor as an ONNX file: input `obs` [1, 390], output `actions` [1, 23], metadata inside."""

import warnings
from pathlib import Path
from typing import Any

from sim.skate.mdp.actor_observation import FRAMES, PARTS, SCALE
from sim.skate.robot.g1 import JOINTS, default_pose, servos
from sysid.board import Board
from sysid.files import atomic_path


def policy_metadata(board: Board, board_hash: str, run: str, *, turn_feedback: bool = True) -> dict[str, str]:
    """Return the metadata that a runtime checks against robot and board; lists are comma-separated."""
    numbers = servos()
    join = lambda values: ",".join(f"{value:.6g}" for value in values)  # noqa: E731
    return {
        "run_path": run,
        "joint_names": ",".join(JOINTS),
        "joint_stiffness": join(numbers.stiffness),
        "joint_damping": join(numbers.damping),
        "default_joint_pos": join(default_pose()),
        "action_scale": join(numbers.action_scale),
        "command_names": "skate",
        "observation_names": ",".join(name for name, *_ in PARTS),
        "observation_scale": join(SCALE),
        "observation_layout": "frame-major",
        "observation_turn": "still-to-turn" if turn_feedback else "as-told",
        "observation_history": str(FRAMES),
        "board": board.name,
        "board_sha256": board_hash,
        "board_passed": str(board.passed).lower(),
        "board_stiffness": f"{board.stiffness:.6g}",
        "board_damping": f"{board.damping:.6g}",
        "board_inertia": f"{board.inertia.value:.6g}",
    }


def export_policy(actor: Any, path: Path, metadata: dict[str, str]) -> None:
    """Write an rsl_rl actor, its normaliser included."""
    import torch
    from mjlab.rl.exporter_utils import attach_metadata_to_onnx

    model = actor.as_onnx(verbose=False)
    model.to("cpu").eval()
    with atomic_path(path) as temporary:
        with warnings.catch_warnings():
            # The exporter without TorchDynamo is on its way out, but the other one needs a package more
            # and writes weights beside the file.
            warnings.simplefilter("ignore")
            torch.onnx.export(
                model,
                model.get_dummy_inputs(),
                str(temporary),
                input_names=["obs"],
                output_names=["actions"],
                opset_version=18,
                dynamo=False,
            )
        attach_metadata_to_onnx(str(temporary), dict(metadata))
