"""Worlds of the task in the training's own simulator, on the processor; a module that imports this needs the training stack."""

import contextlib
import math
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from sysid.workspace import Workspace

for _module in ("torch", "mjlab", "onnxruntime"):
    pytest.importorskip(_module, reason="needs the training stack")

ALIKE = {"boards": 0, "foot_place": (0.0, 0.0), "change": math.inf, "standing": 0.0, "slow": 0.0}
"""Options of worlds that do not differ."""


@contextlib.contextmanager
def worlds(
    count: int, board: Any = None, *, kind: Any = None, seed: int = 3, clips: Any = (), **options: Any
) -> Generator[Any]:
    """Yield so many worlds of a variant of the task after their first reset; mjlab's own environment, or another kind."""
    from policy_runtime.learning.fused_rewards import SkateEnv
    from sim.skate.options import SkateOptions
    from sim.skate.task import skate_env_cfg

    board = board or Workspace(Path("/nonexistent")).load_board("pink")
    cfg = skate_env_cfg(board, SkateOptions(**options), environments=count, seed=seed, clips=clips)
    with contextlib.redirect_stdout(sys.stderr):
        env = (kind or SkateEnv)(cfg, device="cpu")
    try:
        env.reset()
        yield env
    finally:
        env.close()
