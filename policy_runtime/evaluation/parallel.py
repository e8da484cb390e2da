# pyright: reportMissingImports=false, reportUnknownParameterType=false, reportAttributeAccessIssue=false
"""Evaluation in the training's own simulator (mjlab, MuJoCo Warp), all episodes of a seed in parallel.

The exported ONNX file is measured, not the network in memory. The difference to plain MuJoCo is the cost of
changing the simulator.
"""

import math
import sys
from collections import defaultdict
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from policy_runtime.evaluation.metrics import Rides, asked_course
from policy_runtime.evaluation.protocol import Protocol
from policy_runtime.evaluation.result import PATHS, TIME_LIMIT, Evaluation, Part, part_of, summarise
from policy_runtime.loop.policy_file import find_policy, open_policy
from sim.board.scaled import scaled_board
from sim.skate.cycle.clock import CONTROL_PERIOD
from sim.skate.mdp.actor_observation import OBSERVATION_SIZE
from sim.skate.robot.g1 import JOINTS
from sysid.board import Board
from sysid.errors import SysidError, needs_extra
from sysid.roll import Array

COLUMNS = (
    *("pushing", "steering", "still", "commanded_speed", "target_heading", "board_heading", "tilt"),
    *("joint_position", "foot_on_ground", "foot_on_deck", "left_slip", "left_place"),
)
"""Fields of `Rides` that `sim.skate.mdp.state.SkateState` has by the same names."""


class BatchPolicy:
    """An ONNX policy of batch size 1 that answers many observations at once; 'zero' answers zero."""

    def __init__(self, policy: str, board: Board, *, force: bool = False) -> None:
        """Open the policy."""
        self.name = Path(policy).stem
        self.turn_feedback = False
        self._session: Any = None
        if policy == "zero":
            return
        file = open_policy(find_policy(policy) or Path(policy), board, force=force)
        self.turn_feedback = file.turn_feedback
        if file.size != OBSERVATION_SIZE:
            raise SysidError(
                f"{policy}: takes {file.size} numbers, the task gives {OBSERVATION_SIZE}. Evaluate it in plain MuJoCo."
            )
        with needs_extra("run", "evaluating in parallel"):
            import onnx
            import onnxruntime
        model = onnx.load(file.path)
        for value in (*model.graph.input, *model.graph.output):
            value.type.tensor_type.shape.dim[0].dim_param = "n"
        self._session = onnxruntime.InferenceSession(
            model.SerializeToString(), providers=["CPUExecutionProvider"]
        )
        self._names = [file.output_name], file.input_name

    def act(self, observations: Array) -> Array:
        """Return actions, shape (n, 23), for observations, shape (n, 390)."""
        if self._session is None:
            return np.zeros((len(observations), len(JOINTS)))
        outputs, name = self._names
        return self._session.run(outputs, {name: observations.astype(np.float32)})[0]


def evaluate_in_parallel(
    policy: str,
    board: Board,
    *,
    episodes: int,
    seeds: tuple[int, ...],
    protocol: Protocol | None = None,
    device: str | None = None,
    force: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Evaluation:
    """Measure a policy in mjlab; arguments and result as in `evaluate.evaluate_policy`.

    Args:
        device: 'cuda:0' or 'cpu'; the first GPU if there is one.
    """
    protocol = protocol or Protocol()
    if protocol.is_stressed or protocol.hold_heading or protocol.jump or protocol.stop:
        raise SysidError(
            "delay, noise, mass, friction, rolling, slope, push, jump, stop and a held heading are of plain MuJoCo. "
            "Leave --simulator out."
        )
    batch = BatchPolicy(policy, board, force=force)
    parts: list[Part] = []
    for seed in seeds:
        with redirect_stdout(sys.stderr):  # mjlab prints its managers, Warp every kernel that it loads
            rides, endings, paths = _ride(batch, board, episodes, seed, protocol, device)
        parts.append(part_of(seed, rides, endings, paths))
        if progress is not None:
            progress(episodes)
    return summarise(parts, batch.name, board.name)


def _worlds(
    board: Board, count: int, seed: int, protocol: Protocol, device: str | None, *, turn_feedback: bool
) -> tuple[Any, Any]:
    """Return the environments, and torch."""
    with needs_extra("train", "evaluating in parallel", "Or evaluate in plain MuJoCo."):
        import torch
        from mjlab.envs import ManagerBasedRlEnv
    from sim.skate.cycle.start import AT_REST
    from sim.skate.options import SkateOptions
    from sim.skate.task import skate_env_cfg

    drawn = {
        "start": AT_REST,
        "foot_place": SkateOptions().foot_place,
        "boards": 64,
        "strength": 1.0,
    }
    options = SkateOptions.nominal(
        speed=protocol.speed,
        turn=protocol.turn,
        episode=protocol.duration,
        turn_feedback=turn_feedback,
        terrain=protocol.terrain,
        coupling="equality" if protocol.coupling == "none" else protocol.coupling,
        steered=protocol.coupling != "none",
        **(drawn if protocol.randomised else {}),
    )
    torch.manual_seed(seed)
    device = device or ("cuda:0" if torch.cuda.is_available() else "cpu")
    cfg = skate_env_cfg(scaled_board(board, protocol.board_scale), options, environments=count, seed=seed)
    return ManagerBasedRlEnv(cfg, device=device), torch


def _ride(
    policy: BatchPolicy, board: Board, count: int, seed: int, protocol: Protocol, device: str | None
) -> tuple[Rides, list[str], list[Array]]:
    """Ride every environment until its first episode is over."""
    env, torch = _worlds(board, count, seed, protocol, device, turn_feedback=policy.turn_feedback)
    # After it has made sure of torch and mjlab, which these need.
    from sim.skate.mdp.measuring import measure
    from sim.skate.mdp.observations import skate_command

    rows: dict[str, list[Array]] = defaultdict(list)
    running, succeeded = np.ones(count, dtype=bool), np.zeros(count, dtype=bool)
    endings = [TIME_LIMIT] * count
    try:
        observations, _ = env.reset()
        with torch.inference_mode():
            for _ in range(math.ceil(protocol.duration / CONTROL_PERIOD) + 1):
                actions = policy.act(observations["actor"].cpu().numpy())
                command = skate_command(env)
                # Place of the board before the step; after it, fallen riders are back at the start.
                place = torch.cat(
                    (command.reading.board.position()[:, :2], command.headings()[0][:, None]), 1
                )
                observations, *_ = env.step(torch.as_tensor(actions, dtype=torch.float32, device=env.device))
                state = measure(env)
                seen = {name: getattr(state, name) for name in COLUMNS} | {
                    "place": place,
                    "board_speed": state.board_velocity[:, 0],
                    "board_drift": state.board_velocity[:, 1],
                    "ground_load": state.ground_load[:, 0],
                    "power": (state.joint_torque * state.joint_velocity).abs().sum(dim=-1)
                    / command.reading.weight,
                }
                for name, values in seen.items():
                    rows[name].append(values.cpu().numpy().copy())
                rows["alive"].append(running.copy())
                _judge(env, running, succeeded, endings)
                if not running.any():
                    break
    finally:
        env.close()
    columns: dict[str, Any] = {name: np.array(values) for name, values in rows.items()}
    where = columns.pop("place")
    course = asked_course(columns["steering"], columns["target_heading"], columns["board_heading"])
    rides = Rides(**columns, course=course, succeeded=succeeded)
    lengths = rides.alive.sum(axis=0)
    paths = [where[: lengths[n], n] for n in range(min(count, PATHS))]
    return rides, endings, paths


def _judge(env: Any, running: Array, succeeded: Array, endings: list[str]) -> None:
    """Note whose first episode has just ended, and how."""
    terminations = env.termination_manager
    over = terminations.dones.cpu().numpy() & running
    for n in np.flatnonzero(over):
        for term in terminations.active_terms:
            if bool(terminations.get_term(term)[n]):
                endings[n] = TIME_LIMIT if term == "time_out" else term.replace("_", " ")
        succeeded[n] = endings[n] == TIME_LIMIT
    running &= ~over
