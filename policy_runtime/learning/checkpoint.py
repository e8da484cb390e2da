# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""Checkpoints: the learner (`AmpPPO.save`), counters, the curriculum's level and random states.

Without the optimisers it has a sixth of the size: shipped weights are such checkpoints.
"""

import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
    """Return the random states of all processes in order. Every process has to call it; all that is drawn is PyTorch's."""
    here = {
        "torch": torch.get_rng_state(),
        "cuda": torch.cuda.get_rng_state(device) if device != "cpu" else None,
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
