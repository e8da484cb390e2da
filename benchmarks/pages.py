"""Tables of benchmarks, and the pages that show them."""

from collections.abc import Iterable, Sequence
from pathlib import Path


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as Markdown."""
    first, *others = (f"| {' | '.join(cells)} |" for cells in (head, *rows))
    return "\n".join((first, "|" + "---|" * len(head), *others))


def write_result(name: str, text: str) -> None:
    """Write results/NAME, and print it."""
    (Path(__file__).parent / "results" / name).write_text(f"{text}\n", encoding="utf-8")
    print(text)


def write_between(page: Path, mark: str, text: str) -> None:
    """Replace what a page has between <!-- mark --> and <!-- end of mark -->."""
    begin, end = f"<!-- {mark} -->", f"<!-- end of {mark} -->"
    head, rest = page.read_text(encoding="utf-8").split(begin)
    _, tail = rest.split(end)
    page.write_text(f"{head}{begin}\n{text}\n{end}{tail}", encoding="utf-8")
