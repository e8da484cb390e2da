"""Keep what a training can go on from, without its optimisers: a sixth of a checkpoint's size.

    python data/policies/keep_weights.py RUN/checkpoints/model_N.pt data/policies/NAME/model_N.pt

`husky-sysid train --board BOARD --from data/policies/NAME/model_N.pt` starts from it.
"""

import sys
from pathlib import Path
from typing import Any

import torch

LARGE = 1000
"""Matrices of more numbers than this are stored in half precision; counts and variances are not."""


def main() -> None:
    """Read a checkpoint and write its weights."""
    source, target = map(Path, sys.argv[1:])
    kept: dict[str, Any] = torch.load(source, map_location="cpu", weights_only=True)
    weights = {
        name: {key: _small(value) for key, value in content.items()} if isinstance(content, dict) else content
        for name, content in kept.items()
        if "optimi" not in name
    }
    torch.save(weights, target)


def _small(value: Any) -> Any:
    is_large = isinstance(value, torch.Tensor) and value.ndim == 2 and value.numel() > LARGE
    return value.half() if is_large else value


if __name__ == "__main__":
    main()
