"""What the shell gives a command: its streams, and the signal to end."""

import codecs
import io
import os
import signal
import sys
from types import FrameType

WORDS = {
    "·": "*",
    "×": "x",
    "±": "+-",
    "²": "^2",
    "−": "-",
    "→": "->",
    "✓": "ok:",
    "✗": "no:",
    "°": " deg",
    "≤": "<=",
    "≥": ">=",
    "…": "...",
}
DOTS = {"\u0307": "'", "\u0308": "''"}
"""Combining dots, which stand for derivatives."""


class Terminated(KeyboardInterrupt):
    """SIGTERM: ends a command as Ctrl-C does, so that nothing is left half-written."""


def open_streams() -> None:
    """Make standard output and error take every sign: what their encoding lacks is spelled in ASCII."""
    codecs.register_error("spelled", _spell)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the shell, as `>&-` does
            setattr(sys, name, open(os.devnull, "w"))  # noqa: PTH123, SIM115  as long as the process
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="spelled")


def drop_output() -> None:
    """Send what is left in the buffer of standard output nowhere: who should read it is gone, or the disk full."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (OSError, ValueError):  # a test's own stream
        return


def raise_on_sigterm() -> None:
    """Let SIGTERM unwind the command."""

    def end(number: int, frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_IGN)  # `timeout` sends it to the process and to its group
        raise Terminated

    signal.signal(signal.SIGTERM, end)


def _spell(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_word, error.object[error.start : error.end])), error.end


def _word(sign: str) -> str:
    """Return a sign in ASCII: 'omega' for ω, '|' for a line of a table, '?' where there is nothing better."""
    import unicodedata

    if "\u2500" <= sign <= "\u257f":
        return {"─": "-", "━": "-", "═": "-", "│": "|", "┃": "|", "║": "|"}.get(sign, "+")
    name = unicodedata.name(sign, "")
    if name.startswith("GREEK"):
        word = name.split("LETTER ")[-1].split(" ")[0].lower()
        return word.capitalize() if "CAPITAL" in name else word
    plain = unicodedata.normalize("NFKD", sign).encode("ascii", "ignore").decode()
    return WORDS.get(sign) or DOTS.get(sign) or plain or "?"
