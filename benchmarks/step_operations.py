"""How many tensor operations a policy step of the training task takes, which the GPU waits for Python to launch.

    python benchmarks/step_operations.py

Views are left out: they launch nothing. Runs on the processor; the numbers are the same on a GPU, and do not
depend on the number of worlds.
"""

import contextlib
import sys
from pathlib import Path

import torch
from torch.utils._python_dispatch import TorchDispatchMode

from policy_runtime.learning.fused_rewards import SkateEnv
from policy_runtime.learning.progress import Progress
from sim.skate.options import SkateOptions
from sim.skate.task import skate_env_cfg
from sysid.workspace import Workspace

VIEWS = (
    "alias", "as_strided", "detach", "diagonal", "expand", "permute", "select", "slice", "split", "squeeze", "t.default",
    "transpose", "unbind", "unsqueeze", "view",
)  # fmt: skip
WORLDS = 8


class Count(TorchDispatchMode):
    """Counts what is launched within a block."""

    def __init__(self):
        super().__init__()
        self.launched = 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        name = func.__name__.removeprefix("_")
        self.launched += not name.startswith(VIEWS)
        return func(*args, **(kwargs or {}))


def main() -> None:
    board = Workspace(Path.cwd()).load_board("pink")
    cfg = skate_env_cfg(board, SkateOptions(boards=4), environments=WORLDS, seed=1)
    with contextlib.redirect_stdout(sys.stderr):
        env = SkateEnv(cfg, device="cpu")
    env.reset()
    progress, actions = Progress(env), torch.zeros(WORLDS, 23)
    for _ in range(3):
        env.step(actions)
        progress.add(torch.zeros(()))
    counts: dict[str, int] = {}
    for name in ("a step", "a step in which an episode ends"):
        with Count() as count:
            env.step(actions)
        assert bool(env.reset_buf.any()) == ("ends" in name)
        counts[name] = count.launched
        env.episode_length_buf[0] = int(env.max_episode_length) + 5
    for name, part in (("of it, what is judged", env._judge_state), ("of it, what is seen", env._see_state)):
        with Count() as count:
            part()
        counts[name] = count.launched
    with Count() as count:
        progress.add(torch.zeros(()))
    counts["its account"] = count.launched
    for name, launched in counts.items():
        print(f"{name}: {launched}")


if __name__ == "__main__":
    main()
