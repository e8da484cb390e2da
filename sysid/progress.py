"""Progress reports of long work to a listener, such as a bar in a terminal.

What takes a while goes through its parts with `steps`, or says with `stage` which share of the whole a part is. What these do
inside counts within them, so nobody passes a callback on. Where nobody listens it costs nothing.
"""

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

Listener = Callable[[str, float], None]
"""Takes what is being done and which share of all is done."""
T = TypeVar("T")


@dataclass(slots=True)
class _Now:
    listener: Listener | None = None
    low: float = 0.0
    high: float = 1.0
    """Shares of the whole at which the present stage begins and ends."""
    name: str = ""
    done: float = 0.0
    """The largest share told."""


_now = _Now()


@contextmanager
def listening(listener: Listener | None) -> Generator[None]:
    """Tell a listener what is done inside."""
    before, _now.listener, _now.done = _now.listener, listener, 0.0
    try:
        yield
    finally:
        _now.listener = before


@contextmanager
def stage(low: float, high: float, name: str = "") -> Generator[None]:
    """Say that what is done inside is a part of the present stage, from the share `low` of it to `high`.

    It is called as the stage is, if it has no name of its own.
    """
    begin, end, outer = before = _now.low, _now.high, _now.name
    _now.low, _now.high = begin + low * (end - begin), begin + high * (end - begin)
    _now.name = name or outer
    if _now.listener is not None:
        _now.done = max(_now.done, _now.low)  # what was not announced as a part must not set it back
        _now.listener(_now.name, _now.done)
    try:
        yield
    finally:
        _now.low, _now.high, _now.name = before


def steps(parts: Sequence[T], name: Callable[[T], str] = lambda _: "") -> Iterable[T]:
    """Go through parts that take about as long each; `name` says of a part what is done."""
    return parts if _now.listener is None else _told(parts, name)


def _told(parts: Sequence[T], name: Callable[[T], str]) -> Generator[T]:
    for number, part in enumerate(parts):
        with stage(number / len(parts), (number + 1) / len(parts), name(part)):
            yield part
