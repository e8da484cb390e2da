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

    def __init__(
        self, function: Callable[[], Any], device: str, *, enabled: bool = True, side_stream: bool = False
    ) -> None:
        """Keep the function.

        Args:
            device: Device; a function on 'cpu' is never recorded.
            enabled: Whether to record at all.
            side_stream: Whether the calls before are made beside the main stream, as automatic differentiation
                wants it before it is recorded.
        """
        self._function, self._enabled = function, enabled and device != "cpu"
        self._beside = torch.cuda.Stream(device) if self._enabled and side_stream else None
        self._calls, self._graph, self._result = 0, None, None

    @property
    def recorded(self) -> bool:
        """Whether calls are replays."""
        return self._graph is not None

    def __call__(self) -> Any:
        """Do it, and return the result."""
        if self._graph is None and self._enabled and self._calls >= EAGER_CALLS:
            self._record()
        if self._graph is None:
            self._calls += 1
            return self._function() if self._beside is None else self._call_beside(self._beside)
        self._graph.replay()
        return self._result

    def _call_beside(self, stream: torch.cuda.Stream) -> Any:
        main = torch.cuda.current_stream(stream.device)
        stream.wait_stream(main)
        with torch.cuda.stream(stream):
            result = self._function()
        main.wait_stream(stream)
        return result

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
