"""Standard streams and termination signals of a command."""

import io
import os
import signal
import sys
from types import FrameType

AGAIN = 1.0
"""Time after which a command that still runs after a signal is interrupted again [s]."""
_received: list[int] = []


def listen() -> None:
    """Let SIGINT and SIGTERM unwind the command, so that every file is complete.

    Python may lose an exception in a callback from C, or change it amid an import. So they raise again until `stop_listening`.
    """
    _received.clear()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)


def stop_listening() -> int | None:
    """Return the received signal, if any, and restore Python's signal handlers."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    return _received[0] if _received else None


def _interrupt(number: int, frame: FrameType | None) -> None:
    if not _received and hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, _interrupt)
        signal.setitimer(signal.ITIMER_REAL, AGAIN, AGAIN)
    is_second = bool(_received) and number != getattr(signal, "SIGALRM", None)
    _received.append(number)
    if not is_second:  # `timeout` sends its signal to the process and to its group
        raise KeyboardInterrupt


def open_streams() -> None:
    """Let standard output and error accept every character: those outside their encoding become question marks."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the shell, as `>&-` does
            setattr(sys, name, open(os.devnull, "w"))  # noqa: PTH123, SIM115  as long as the process
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def drop_output() -> None:
    """Drop the buffer of standard output: its reader is gone, or the disk is full."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, ValueError):  # a test's own stream
        return


def one_line(text: str) -> str:
    """Return a message on one line; line ends and control characters, from a damaged file, become blanks."""
    return "".join(sign if sign.isprintable() else " " for sign in text)
