"""What MkDocs does beside its usual work: README and CONTRIBUTING are pages of the site, and links out of `docs/` stay plain text.

`mkdocs build` calls it; see mkdocs.yml.
"""

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
PAGES = {"index.md": "README.md", "contributing.md": "CONTRIBUTING.md"}
"""Pages of the site, and the files of the repository that they are."""
LINK = re.compile(r"(?P<image>!?)\[(?P<text>(?:[^][]|\[[^]]*\])*)\]\((?P<to>[^)\s]+)\)")


def on_files(files: Files, *, config: Any) -> Files:
    """Add the pages that lie outside docs/."""
    for page, source in PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=LINK.sub(_inside, text)))
    return files


def on_page_markdown(markdown: str, *, page: Any, config: Any, files: Files) -> str:
    """Return a page whose links to files that are not in the site are text."""
    del config
    folder = Path(page.file.src_uri).parent
    known = {file.src_uri for file in files}

    def kept(link: re.Match[str]) -> str:
        to = link["to"].split("#")[0]
        if not to or "://" in to:
            return link[0]
        place = _normal(folder / to)
        if place in known:
            return link[0]
        renamed = {source: name for name, source in PAGES.items()}.get(place.removeprefix("../"))
        return link[0].replace(to, renamed) if renamed else link["text"]

    return LINK.sub(kept, markdown)


def _inside(link: re.Match[str]) -> str:
    """Return a link of a file at the root as seen from docs/."""
    to = link["to"]
    if "://" in to or to.startswith("#"):
        return link[0]
    return link[0].replace(
        f"({to})", f"({to.removeprefix('docs/') if to.startswith('docs/') else f'../{to}'})"
    )


def _normal(path: Path) -> str:
    """Return a path without `..` inside; leading ones stay."""
    parts: list[str] = []
    for part in path.as_posix().split("/"):
        if part == ".." and parts and parts[-1] != "..":
            parts.pop()
        elif part != ".":
            parts.append(part)
    return "/".join(parts)
