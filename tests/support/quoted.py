"""Whether a text says what a page quotes: words are the same, numbers are close."""

import re

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")
CLOSE = 0.05
"""Share by which a number may differ: what is behind that is the noise of a processor, or of a search."""


def plain(text: str) -> str:
    """Return the words of a text without what draws tables, and without Markdown's rules between their rows."""
    return " ".join(re.sub(r"[│┃|]|-{3,}", " ", text).split())


def missing(quoted: tuple[str, ...], printed: str) -> list[str]:
    """Return the quoted lines that are not in what was printed, each looked for after the one before."""
    printed, lost, begin = plain(printed), [], 0
    for line in filter(None, map(plain, quoted)):
        pattern = re.escape(NUMBER.sub("NUMBER", line)).replace("NUMBER", f"({NUMBER.pattern})")
        wanted = [float(number) for number in NUMBER.findall(line)]
        for match in re.compile(pattern).finditer(printed, begin):
            found = [float(number) for number in match.groups()]
            if all(map(close, wanted, found)):
                begin = match.end()
                break
        else:
            lost.append(line)
    return lost


def close(one: float, other: float) -> bool:
    """Return whether two printed numbers are the same but for noise."""
    return abs(one - other) <= CLOSE * max(abs(one), abs(other))
