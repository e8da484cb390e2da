"""Several processes that work on a list of jobs, in order.

Threads would not do: CasADi computes inside Python's lock.
"""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from importlib import import_module
from types import TracebackType
from typing import Self, TypeVar

from sysid.errors import SysidError

T = TypeVar("T")
_LOADED = "sysid.diagnosis.search"
"""What jobs are made of: the half second of loading it is over when the first one comes."""
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""How libraries of linear algebra are told to compute in one thread. The largest matrices here have a hundred rows, and of those
several threads make none faster; those of two processes on two cores wait for each other, so that a learned torque took five times as long."""


class WorkerPool:
    """Runs jobs in processes of their own, or here where there is one worker only.

    A job is a function and its arguments; with more than one worker both must be such that pickle takes
    them, and a script that calls this must guard its main part (`if __name__ == "__main__"`).
    """

    def __init__(self, workers: int) -> None:
        """Start nothing yet.

        Args:
            workers: Processes; 1 for none.
        """
        self._workers = workers
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Self:
        """Start the processes; they load while the first jobs are made."""
        if self._workers > 1:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self._workers, mp_context=context)
            before = {name: os.environ[name] for name in _ONE_THREAD if name in os.environ}
            try:  # what they begin with is what they keep
                os.environ.update(dict.fromkeys(_ONE_THREAD, "1") | before)
                for _ in range(self._workers):  # a process starts with the first job that none is free for
                    self._pool.submit(import_module, _LOADED)
            finally:
                for name in _ONE_THREAD:
                    if name not in before:
                        del os.environ[name]
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the processes; on an error, without waiting for jobs that have not begun."""
        if self._pool is not None:
            self._pool.shutdown(wait=kind is None, cancel_futures=True)

    def each(self, function: Callable[..., T], arguments: Sequence[tuple[object, ...]]) -> Iterator[T]:
        """Yield the results of a function for each tuple of arguments, in order.

        Raises:
            SysidError: A process died.
        """
        for result in [self.begin(function, *one) for one in arguments]:
            yield result()

    def begin(self, function: Callable[..., T], *arguments: object) -> Callable[[], T]:
        """Begin one job and return what waits for its result; where there is one worker only, that does it.

        Raises:
            SysidError: When waiting: a process died.
        """
        if self._pool is None:
            return partial(function, *arguments)
        future = self._pool.submit(function, *arguments)

        def result() -> T:
            try:
                return future.result()
            except BrokenProcessPool as error:
                raise SysidError(
                    f"one of {self._workers} processes that search died (out of memory, or a script without "
                    "'if __name__ == \"__main__\"'). Try one worker (--workers 1)."
                ) from error

        return result
