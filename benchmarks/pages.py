"""Tables of benchmarks in the pages that show them."""

from pathlib import Path


def write_between(page: Path, mark: str, text: str) -> None:
    """Replace what a page has between <!-- mark --> and <!-- end of mark -->."""
    begin, end = f"<!-- {mark} -->", f"<!-- end of {mark} -->"
    head, rest = page.read_text(encoding="utf-8").split(begin)
    _, tail = rest.split(end)
    page.write_text(f"{head}{begin}\n{text}\n{end}{tail}", encoding="utf-8")
