# pyright: reportMissingImports=false
"""Moving average of an actor's weights, which is exported and evaluated.

Rare situations, such as a command to stand, go well after one update and badly after the next. The mean over
updates is steadier. Iteration t weighs about t^η (Shamir and Zhang 2013, polynomial-decay averaging). So the
mean covers the same share of every run.
"""

import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

ETA = 16
"""The last eighteenth of a run, in the mean."""


def mean_actor(actor: nn.Module) -> AveragedModel:
    """Return the mean of an actor, which `update_parameters` takes a further iteration into; normalisers too."""
    return AveragedModel(actor, avg_fn=_mean, use_buffers=True)


def _mean(mean: torch.Tensor, now: torch.Tensor, done: torch.Tensor | int) -> torch.Tensor:
    if not now.is_floating_point():
        return now  # a count
    return torch.lerp(mean, now, torch.as_tensor((ETA + 1) / (done + ETA + 1), dtype=now.dtype))
