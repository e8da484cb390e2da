# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""CUDA graphs: many small operations recorded once and launched as one, so that the GPU need not wait for Python.

A recorded function must write lasting results in place and ask nothing of the host (no `.item()`, no lists
whose length depends on data); Python in it runs only while it is recorded.
"""

import sys
from collections.abc import Callable
from typing import Any

import torch

EAGER_CALLS = 3
"""Calls before one is recorded: libraries allocate memory at their first use."""


class Graphed:
    """A function without arguments: recorded at its fourth call, then replayed.

    Its result is what the recorded call returned: tensors whose content every replay renews. If recording
    fails, it warns once and goes on without a graph.
    """

    def __init__(self, function: Callable[[], Any], *, enabled: bool = True) -> None:
        """Keep the function; it is never recorded unless enabled."""
        self._function, self._enabled = function, enabled
        self._calls, self._graph, self._result = 0, None, None

    def __call__(self) -> Any:
        """Do it, and return the result."""
        self._calls += 1
        if self._graph is None and self._enabled and self._calls > EAGER_CALLS:
            self._record()
        if self._graph is None:
            return self._function()
        self._graph.replay()
        return self._result

    def _record(self) -> None:
        graph = torch.cuda.CUDAGraph()
        try:
            with torch.cuda.graph(graph, capture_error_mode="thread_local"):
                self._result = self._function()
        except RuntimeError as error:
            self._enabled, self._result = False, None
            torch.cuda.synchronize()
            reason = str(error).strip().splitlines()[0]
            print(f"{self._function}: goes on without a CUDA graph ({reason})", file=sys.stderr)  # noqa: T201
        else:
            self._graph = graph
