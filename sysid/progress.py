"""Progress reports of long work to a listener, such as a bar in a terminal.

Long work iterates over its parts with `steps`, or marks a part of the whole with `stage`. Stages nest, so no function passes a
callback on. Without a listener they do nothing.
"""

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

Listener = Callable[[str, float], None]
"""Called with the name of the current stage and the share of all work that is done."""
T = TypeVar("T")


@dataclass(slots=True)
class _Now:
    listener: Listener | None = None
    low: float = 0.0
    high: float = 1.0
    """Shares of the whole at which the current stage begins and ends."""
    name: str = ""
    done: float = 0.0
    """Largest reported share."""


_now = _Now()


@contextmanager
def listening(listener: Listener | None) -> Generator[None]:
    """Report the progress of the block to a listener."""
    before, _now.listener, _now.done = _now.listener, listener, 0.0
    try:
        yield
    finally:
        _now.listener = before


@contextmanager
def stage(low: float, high: float, name: str = "") -> Generator[None]:
    """Mark the block as a part of the current stage, from its share `low` to `high`.

    Without a name it has that of the current stage.
    """
    begin, end, outer = before = _now.low, _now.high, _now.name
    _now.low, _now.high = begin + low * (end - begin), begin + high * (end - begin)
    _now.name = name or outer
    if _now.listener is not None:
        _now.done = max(_now.done, _now.low)  # progress never falls, even after an unmarked part
        _now.listener(_now.name, _now.done)
    try:
        yield
    finally:
        _now.low, _now.high, _now.name = before


def steps(parts: Sequence[T], name: Callable[[T], str] = lambda _: "") -> Iterable[T]:
    """Iterate over parts of about equal duration; `name` gives the stage of a part."""
    return parts if _now.listener is None else _told(parts, name)


def _told(parts: Sequence[T], name: Callable[[T], str]) -> Generator[T]:
    for number, part in enumerate(parts):
        with stage(number / len(parts), (number + 1) / len(parts), name(part)):
            yield part
