# pyright: reportMissingImports=false
"""Moving average of an actor's weights: what is exported and evaluated.

Every update throws the actor that learns about, and what it meets seldom, such as being told to stand, it does well
after one update and badly after the next. The mean over updates keeps what they have in common. Iteration t weighs in
proportion to t^η, approximately (Shamir and Zhang 2013, "Stochastic gradient descent for non-smooth optimization",
polynomial-decay averaging): the mean is over the same share of a run however long that is.
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
