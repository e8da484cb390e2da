"""A first inference of an ONNX file in a separate process.

onnxruntime limits neither loops nor memory: a
broken file could block the caller.
"""

import hashlib
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

from sysid.errors import SysidError, needs_extra

PATIENCE = 10.0
"""Longest time to load a policy and to answer once [s]; shipped ones take 0.3 s with Python's start."""
MEMORY = 2 << 30
"""Largest address space of that process [B]."""


def require_answer(path: Path) -> None:
    """Let a policy answer once, elsewhere.

    Raises:
        SysidError: It does not load, does not answer in time, or takes too much memory.
    """
    _require_answer(path, hashlib.sha256(path.read_bytes()).hexdigest())


@cache
def _require_answer(path: Path, digest: str) -> None:
    try:
        done = subprocess.run(
            [sys.executable, "-m", __name__, str(path)],
            check=False,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )
    except subprocess.TimeoutExpired:
        raise SysidError(
            f"{path}: gives no answer within {PATIENCE:g} s. Does it hold a loop without end?"
        ) from None
    if done.returncode:
        said = done.stderr.strip().splitlines()
        why = said[-1] if said else f"its process died with code {done.returncode}, as for want of memory"
        raise SysidError(f"{path}: not an ONNX model that can be run ({why}).")


def session_options() -> Any:
    """Return how sessions are run: on one thread, for waking others takes longer than such a net.

    Raises:
        SysidError: onnxruntime is not installed.
    """
    os.environ.setdefault(
        "ORT_DISABLE_TELEMETRY", "1"
    )  # else importing it writes into the home folder and calls home
    with needs_extra("run", "running a policy"):
        import onnxruntime
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    return options


def open_session(path: Path, options: Any) -> Any:
    """Return onnxruntime's session of a file."""
    import onnxruntime

    return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])


def _answer_once(path: Path) -> str | None:
    """Load a policy and run it on zeros; return its error."""
    import numpy as np

    options = session_options()
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    try:
        session = open_session(path, options)
        asked = {
            value.name: np.zeros([n if isinstance(n, int) else 1 for n in value.shape], np.float32)
            for value in session.get_inputs()
            if value.type == "tensor(float)"
        }
        if len(asked) == len(session.get_inputs()):  # else its shapes are refused later
            session.run(None, asked)
    except MemoryError:
        return f"takes more than {MEMORY >> 30} GiB of memory"
    except Exception as error:  # noqa: BLE001  onnxruntime raises its own kinds, one a status
        return str(error).splitlines()[0]
    return None


if __name__ == "__main__":
    sys.exit(_answer_once(Path(sys.argv[1])))
