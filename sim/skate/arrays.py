# pyright: reportMissingImports=false
"""Array functions for NumPy (runtime, evaluation, tests) and torch (training) alike.

PyTorch accepts NumPy's argument name `axis`. So one function serves both, and the robot runs the code of the
training.
"""

from functools import lru_cache
from typing import Any

import numpy as np


def namespace(array: Any) -> Any:
    """Return the module whose functions work on `array`: numpy, or torch for a tensor."""
    if isinstance(array, np.ndarray | np.generic | float | int):
        return np
    import torch  # only where a tensor shows that it is here anyway

    return torch


def wrap_angle(angle: Any) -> Any:
    """Return an angle [rad] wrapped into [-π, π)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def constant(values: Any, like: Any) -> Any:
    """Return `values` as an array of the kind, precision and device of `like`.

    Tuples are put on a device once: a copy in every step would make the processor wait for it. Do not write to
    the result.
    """
    if namespace(like) is np:
        return np.asarray(values, dtype=np.asarray(like).dtype)
    if isinstance(values, tuple):
        return _tensor(values, like.dtype, like.device)
    return like.new_tensor(np.asarray(values).tolist())


@lru_cache(maxsize=64)
def _tensor(values: tuple[Any, ...], dtype: Any, device: Any) -> Any:
    import torch

    with torch.inference_mode(False):  # one made within could not be used in learning
        return torch.tensor(values, dtype=dtype, device=device)
