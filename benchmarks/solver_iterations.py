"""What fewer iterations of the contact solver cost in accuracy, on the states that a trained policy rides through.

    python benchmarks/solver_iterations.py [--policy data/policies/pink.onnx] [--episodes 6]

At every policy step the training scene's step of 5 ms is taken from the same state with few iterations and with 100 of
them (tolerance 0), started as in a ride from the last acceleration. The difference in velocity after the step is the
error: of the robot's joints and of the deck [rad/s]. How much time they save: `skate_throughput.py --iterations`.
"""

import copy
from pathlib import Path

import mujoco
import numpy as np
from pages import table
from suite import command_line

from policy_runtime.evaluation.plain import Protocol, policy_named, run_episode
from policy_runtime.loop.world import make_world
from sim.skate.robot.g1 import JOINTS
from sim.skate.world.scene import ITERATIONS, LINE_SEARCH_ITERATIONS, ROBOT, SceneOptions
from sysid.workspace import Workspace

TRIED = ((ITERATIONS, LINE_SEARCH_ITERATIONS), (10, 10), (6, 20), (5, 10), (4, 10), (3, 10), (2, 10))


class Probe:
    """A policy that takes trial steps from every state that it acts in."""

    def __init__(self, policy, world):
        self.policy, self.world, self.errors = policy, world, []
        self.reference = copy.copy(world.robot.model)
        self.reference.opt.timestep = SceneOptions().timestep
        self.reference.opt.iterations, self.reference.opt.ls_iterations = 100, 50
        self.reference.opt.tolerance = 0.0
        self.models = []
        for iterations, line_search in TRIED:
            model = copy.copy(world.robot.model)
            model.opt.timestep = SceneOptions().timestep
            model.opt.iterations, model.opt.ls_iterations = iterations, line_search
            self.models.append(model)
        self.joints = [self.reference.joint(ROBOT + name).dofadr[0] for name in JOINTS]
        self.deck = [
            self.reference.jnt_dofadr[j]
            for j in range(self.reference.njnt)
            if "tilt" in self.reference.joint(j).name
        ]

    def __getattr__(self, name):
        return getattr(self.policy, name)

    def act(self, *arguments, **named):
        answer = self.policy.act(*arguments, **named)
        exact = self._step(self.reference)
        rows = []
        for model in self.models:
            off = np.abs(self._step(model) - exact)
            rows.append((off[self.joints].max(), off[self.deck].max()))
        self.errors.append(rows)
        return answer

    def _step(self, model):
        data = copy.copy(self.world.robot.data)
        mujoco.mj_step(model, data)
        return data.qvel.copy()


def main():
    parser = command_line(__doc__)
    parser.add_argument("--policy", default="data/policies/pink.onnx")
    parser.add_argument("--board", default="pink")
    parser.add_argument("--episodes", type=int, default=6)
    options = parser.parse_args()
    board = Workspace(Path()).load_board(options.board)
    world = make_world(board)
    probe = Probe(policy_named(options.policy, board, force=True), world)
    for episode in range(options.episodes):
        run_episode(world, probe, Protocol(), np.random.default_rng([0, episode]))
    errors = np.array(probe.errors)  # (t, tried, joints or deck)
    print(f"{len(errors)} states of {options.episodes} rides; error of velocity after 5 ms [rad/s]")
    head = ("iterations", "of line search", "joints, RMS", "joints, 99.9 %", "deck, RMS", "deck, 99.9 %")
    sizes = np.stack([np.sqrt((errors**2).mean(axis=0)), np.quantile(errors, 0.999, axis=0)], axis=-1)
    rows = zip(TRIED, sizes.reshape(len(TRIED), 4), strict=True)
    print(table(head, [(*map(str, tried), *(f"{size:.2g}" for size in row)) for tried, row in rows]))


if __name__ == "__main__":
    main()
