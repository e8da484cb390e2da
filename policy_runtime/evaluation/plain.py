"""Evaluation in plain MuJoCo: many episodes, several seeds, the paper's protocol.

An episode begins at rest with one foot on the ground and lasts 20 s. Its speed is drawn from 0 to 1.5 m/s, and
a turn of up to ±45° for every cycle. It ends early when the pelvis leans beyond 70°, anything but a foot
touches ground or board, or both feet have left the deck.
"""

import math
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from policy_runtime.evaluation.metrics import Rides
from policy_runtime.evaluation.protocol import Protocol
from policy_runtime.evaluation.recording import Recorder, Recording
from policy_runtime.evaluation.result import PATHS, TIME_LIMIT, Evaluation, Part, part_of, summarise
from policy_runtime.evaluation.stress import StressedRobot, change
from policy_runtime.loop.commands import Command
from policy_runtime.loop.policy import OnnxPolicy, Policy
from policy_runtime.loop.policy_file import find_policy, open_policy
from policy_runtime.loop.scripted import SCRIPTS, scripted
from policy_runtime.loop.world import World, direct_rake, joint_limits, make_world
from policy_runtime.runtime import INTERRUPTED, Runtime
from sim.board.scaled import scaled_board
from sim.board.scene import Coupling
from sim.skate.cycle.clock import CONTROL_PERIOD, Clock
from sim.skate.mdp.terminations import FALLEN_INCLINATION, SETTLING_STEPS
from sysid.board import Board
from sysid.errors import SysidError
from sysid.roll import Array

STOP_TIME = 9.0
"""Duration of a commanded stop [s]; the robot must be at rest after 8 s."""


class _Episode:
    """One episode's commands, and the judgement of when it is over: a command source for the runtime."""

    def __init__(
        self, world: World, recorder: Recorder, protocol: Protocol, rng: np.random.Generator
    ) -> None:
        self._world, self._recorder, self._protocol, self._rng = world, recorder, protocol, rng
        self.ending = TIME_LIMIT
        self._unloaded = False
        self._draw()
        self._push = float(rng.uniform(5, 10))
        self._stop = float(rng.uniform(6, 12)) if protocol.stop else math.inf
        self._jump = protocol.jump or math.inf

    def _draw(self) -> None:
        self._speed = float(self._rng.uniform(*self._protocol.speed))
        self._draw_turn()

    def _draw_turn(self) -> None:
        self._turn = float(self._rng.uniform(-self._protocol.turn, self._protocol.turn))

    def at(self, time: float) -> Command | None:
        """Return the command, or None where the episode is over."""
        if len(self._recorder):
            ending = self._over(time)
            if ending is not None:
                self.ending = ending
                return None
        step = round(time / CONTROL_PERIOD)
        # A turn counts only where it is latched, at the start of steering: drawing one a cycle suffices.
        if step > 0 and step % Clock().period == 0:
            self._draw_turn()
        if time >= self._jump - CONTROL_PERIOD / 2:
            self._draw()
            self._jump += self._protocol.jump
        if self._protocol.push > 0 and time >= self._push:
            assert isinstance(self._world.robot, StressedRobot)  # as `protocol_world` builds it
            angle = self._rng.uniform(-math.pi, math.pi)
            self._world.robot.push_with(self._protocol.push * np.array([math.cos(angle), math.sin(angle)]))
            self._push = time + float(self._rng.uniform(5, 10))
        stands = self._stop <= time < self._stop + STOP_TIME
        return Command(0.0 if stands else self._speed, self._turn)

    def _over(self, time: float) -> str | None:
        truth = self._world.robot.truth()
        if truth.upright < math.cos(FALLEN_INCLINATION):
            return "fallen"
        if truth.other_contacts:
            return "body contact"
        unloaded = not truth.foot_on_deck.any()
        before, self._unloaded = self._unloaded, unloaded
        return "off the board" if unloaded and before and time > SETTLING_STEPS * CONTROL_PERIOD else None


def run_episode(
    world: World, policy: Policy, protocol: Protocol, rng: np.random.Generator
) -> tuple[Recording, str]:
    """Ride one episode, leave the world at its end, and return the recording and the ending.

    Raises:
        KeyboardInterrupt: The run was interrupted; its ride is incomplete.
    """
    world.reset(rng=rng)
    if isinstance(world.robot, StressedRobot):
        world.robot.rng = rng.spawn(1)[0]
    recorder = Recorder(world.robot)
    episode = _Episode(world, recorder, protocol, rng)
    limits = joint_limits(world.robot.model, tilt=FALLEN_INCLINATION, joint_margin=0.3, torque_time=math.inf)
    runtime = Runtime(
        robot=world.robot,
        policy=policy,
        commands=episode,
        limits=limits,
        on_tick=recorder.add,
        stop_time=0.0,
        hold_heading=protocol.hold_heading,
    )
    result = runtime.run(protocol.duration)
    if result.stopped == INTERRUPTED:
        raise KeyboardInterrupt
    if result.stopped is not None:
        episode.ending = "fallen" if result.stopped.startswith("tilt") else result.stopped.split(":")[0]
    return recorder.recording(), episode.ending


def protocol_world(board: Board, protocol: Protocol) -> World:
    """Build the world that a protocol asks for."""
    board = scaled_board(board, protocol.board_scale)
    coupling: Coupling = "equality" if protocol.coupling == "none" else protocol.coupling
    steered = protocol.coupling != "none"
    world = make_world(board, coupling=coupling, steered=steered, terrain=protocol.terrain)
    if not protocol.is_stressed:
        return world
    model = world.robot.model
    change(model, protocol)
    return World(StressedRobot(model, protocol, direct_rake(board, coupling)), world.start)


def policy_named(name: str, board: Board | None, *, force: bool = False) -> Policy:
    """Return the scripted policy of that name, or open an ONNX file: of that path, or shipped under that name."""
    found = None if name in SCRIPTS else find_policy(name)
    if found is None and not name.endswith(".onnx"):
        return scripted(name)
    return OnnxPolicy(open_policy(found or Path(name), board, force=force))


def _work(name: str, board: Board, protocol: Protocol, force: bool, seed: int, episodes: range) -> Part:
    """Ride some episodes of one seed in a separate process."""
    world = protocol_world(board, protocol)
    policy = policy_named(name, board, force=force)
    rides: list[Rides] = []
    endings: list[str] = []
    paths: list[Array] = []
    for episode in episodes:
        recording, ending = run_episode(world, policy, protocol, np.random.default_rng([seed, episode]))
        rides.append(recording.rides(succeeded=ending == TIME_LIMIT))
        endings.append(ending)
        if episode < PATHS:
            where = recording.column("board_position")[:, :2]
            paths.append(np.column_stack([where, recording.column("board_heading")]))
    return part_of(seed, Rides.join(rides), endings, paths)


def evaluate_policy(
    policy: str,
    board: Board,
    *,
    episodes: int,
    seeds: tuple[int, ...],
    protocol: Protocol | None = None,
    pool: Executor | None = None,
    force: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Evaluation:
    """Measure a policy.

    Args:
        seeds: Seeds; an episode is drawn from its seed and its number, whatever the processes.
        pool: Processes to ride in, of `riders`; this one alone if None.
    """
    protocol = protocol or Protocol()
    if protocol.randomised:
        raise SysidError("worlds drawn as in training are mjlab's. Add --simulator mjlab.")
    name = policy_named(policy, board, force=force).name
    size = math.isqrt(episodes)  # as many jobs a seed as rides a job
    spans = [range(first, min(first + size, episodes)) for first in range(0, episodes, size)]
    jobs = [(seed, span) for seed in seeds for span in spans]
    work = partial(_work, policy, board, protocol, force)
    parts: list[Part] = []
    for part in (map if pool is None else pool.map)(work, *zip(*jobs, strict=True)):
        parts.append(part)
        if progress is not None:
            progress(len(part.endings))
    return summarise(parts, name, board.name)


def riders(workers: int) -> AbstractContextManager[Executor | None]:
    """Return so many processes to ride in; None for this one alone.

    Forking a process with threads (Rerun, onnxruntime) can hang; spawned ones start clean.
    """
    return nullcontext() if workers == 1 else ProcessPoolExecutor(workers, mp_context=get_context("spawn"))
