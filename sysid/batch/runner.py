"""Many independent cases, a process a core or on a cluster, one line of JSON each as they end.

Cases in the file of rows are not run again, so a run may be stopped and continued.
"""

import json
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from sysid.errors import SysidError, install_extra

Row = Mapping[str, Any]


def read_rows(path: Path) -> list[Row]:
    """Return the rows of a file; one that was being written when the run was killed is left out."""
    if not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    return [json.loads(line) for line in lines if line.endswith("\n")]


def run_all(
    function: Callable[..., Row],
    cases: Sequence[tuple[Any, ...]],
    rows: Path | None,
    *,
    workers: int = -1,
    cluster: str | None = None,
) -> Iterator[Row]:
    """Yield a row a case as they end, each appended to the file of rows first.

    Args:
        function: Makes a row of a case's values; like these it must be such that pickle takes it.
        cases: Arguments of the function.
        rows: File to append to; None keeps nothing.
        workers: Processes here; -1 for one a core.
        cluster: Address of a Dask scheduler ('tcp://host:8786') or of a Ray cluster ('ray://host:10001') that shall
            run them instead.

    Raises:
        SysidError: A process died, or the cluster or its package is not there.
    """
    from joblib import Parallel, delayed, parallel_config
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    if rows is not None:
        rows.parent.mkdir(parents=True, exist_ok=True)
        # An unfinished line of a killed run must not run into the next one.
        rows.write_text("".join(json.dumps(row) + "\n" for row in read_rows(rows)), encoding="utf-8")
    with _backend(cluster) as backend, parallel_config(backend=backend, n_jobs=workers):
        try:
            for row in _results(Parallel, [delayed(function)(*case) for case in cases], backend):
                if rows is not None:
                    with rows.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(row) + "\n")
                yield row
        except TerminatedWorkerError as error:
            raise SysidError(
                "one of the processes died (out of memory?). Finished cases are kept: run this again, with fewer --workers."
            ) from error


def _results(parallel: Any, calls: Sequence[Any], backend: str) -> Iterable[Row]:
    if backend != "ray":
        return parallel(return_as="generator_unordered", batch_size=1)(calls)
    # Ray's backend returns lists only.
    return (row for first in range(0, len(calls), 64) for row in parallel()(calls[first : first + 64]))


@contextmanager
def _backend(cluster: str | None) -> Generator[str]:
    """Connect to a cluster, and yield joblib's name of the backend."""
    if cluster is None:
        yield "loky"
        return
    kind = "ray" if cluster.startswith("ray") else "dask"
    try:
        if kind == "dask":
            from distributed import Client

            with Client(cluster, timeout="20s"):
                yield kind
        else:
            with import_module("ray").init(address=cluster):
                import_module("ray.util.joblib").register_ray()
                yield kind
    except ImportError as error:
        command = install_extra("cluster") if kind == "dask" else "pip install 'ray[client]'"
        raise SysidError(f"--cluster {cluster}: {kind} is not installed: {command}.") from error
    except (OSError, ValueError) as error:
        raise SysidError(
            f"--cluster {cluster}: cannot be reached ({error}). Expected the address of a Dask scheduler, "
            "tcp://HOST:8786, or of a Ray cluster, ray://HOST:10001."
        ) from error
