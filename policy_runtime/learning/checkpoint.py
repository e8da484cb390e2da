# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""Checkpoints: counters and the state of all random number generators, besides the learner.

| key | content |
|---|---|
| actor_state_dict, critic_state_dict | networks with their normalisers |
| mean_actor | mean of the actor's weights on their way, with its count |
| optimizer_state_dict | PPO's optimiser, its adaptive rate included |
| discriminator, amp_optimiser | of the style reward |
| iteration, samples, step_counter | done so far: iterations, steps of all worlds, steps of each |
| curriculum | patience and strength, see `policy_runtime.learning.curriculum` |
| random | for each process: states of torch on CPU and GPU, NumPy and Python |
"""

import pickle
import random
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.distributed

from sysid.errors import SysidError

NEEDED = (
    *("actor_state_dict", "critic_state_dict", "discriminator"),
    *("iteration", "samples", "step_counter", "random"),
)
"""Keys that every checkpoint holds."""


@dataclass(frozen=True, slots=True)
class Done:
    """How far a run has come."""

    iterations: int = 0
    samples: int = 0
    """Steps of all worlds in all processes, whatever their number was."""


def read_checkpoint(path: Path, device: str = "cpu") -> dict[str, Any]:
    """Read a checkpoint."""
    try:
        content: Any = torch.load(path, map_location=device, weights_only=True)
    except OSError as error:
        raise SysidError(f"{path}: cannot be read ({error.strerror or error}).") from error
    except (RuntimeError, EOFError, ValueError, LookupError, TypeError, pickle.UnpicklingError) as error:
        raise SysidError(
            f"{path}: not a whole checkpoint; it may have been cut short while it was copied. Use an earlier one."
        ) from error
    missing = [key for key in NEEDED if not isinstance(content, dict) or key not in content]
    if missing:
        raise SysidError(
            f"{path}: not a checkpoint of husky-sysid: '{missing[0]}' is not in it. Expected a model_N.pt that "
            "`husky-sysid train` wrote."
        )
    return content


def grow_critic(kept: dict[str, Any], size: int) -> None:
    """Append inputs to the critic of a checkpoint's content, in place, without changing its answers.

    Its optimiser, whose state is of the old size, is then no longer in the content.
    """
    state: dict[str, torch.Tensor] = kept["critic_state_dict"]
    more = size - state["mlp.0.weight"].shape[1]
    if more <= 0:
        return
    for name, fill in (
        ("mlp.0.weight", 0.0),
        ("obs_normalizer._mean", 0.0),
        ("obs_normalizer._var", 1.0),
        ("obs_normalizer._std", 1.0),
    ):
        state[name] = torch.cat((state[name], state[name].new_full((len(state[name]), more), fill)), 1)
    kept.pop("optimizer_state_dict", None)


def random_states(device: str) -> list[dict[str, Any]]:
    """Return the state of everything random in all processes, in order, in types that are safe to load.

    Every process has to call it.
    """
    numbers: Any = np.random.get_state(legacy=True)  # noqa: NPY002 (mjlab seeds it)
    kind, keys, position, has_gauss, gauss = numbers
    here = {
        "torch": torch.get_rng_state(),
        "cuda": torch.cuda.get_rng_state(device) if device != "cpu" else None,
        "numpy": [kind, torch.tensor(keys.astype(np.int64)), position, has_gauss, gauss],
        "python": list(random.getstate()),
    }
    if not torch.distributed.is_initialized():
        return [here]
    states: list[Any] = [None] * torch.distributed.get_world_size()
    torch.distributed.all_gather_object(states, here)
    return states


def set_random_state(state: dict[str, Any], device: str) -> None:
    """Go on with the random numbers of one of `random_states`."""
    torch.set_rng_state(state["torch"].cpu())
    if device != "cpu" and state["cuda"] is not None:
        torch.cuda.set_rng_state(state["cuda"].cpu(), device)
    kind, keys, position, has_gauss, gauss = state["numpy"]
    np.random.set_state((kind, keys.cpu().numpy().astype(np.uint32), position, has_gauss, gauss))  # noqa: NPY002
    version, inner, gauss_next = state["python"]
    random.setstate((version, tuple(inner), gauss_next))
