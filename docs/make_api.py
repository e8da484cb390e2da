"""Write docs/api.md from the docstrings of the public API of `sysid`.

Run:  python docs/make_api.py
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import sysid

ROOT = Path(__file__).parents[1]
TARGET = ROOT / "docs" / "api.md"
BEHIND = {
    "Release": "sysid.roll",
    "FreeDecay": "sysid.free_decay",
    "Fit": "sysid.fit_mjcf",
    "Comparison": "sysid.comparison.compare",
    "Diagnosis": "sysid.diagnosis.diagnose",
    "JointLaw": "sysid.joint",
    "Trajectory": "sysid.joint",
}
"""Classes that the public names take and return."""
ORDER = (
    "Recording", "Board", "Quantity", "Effect", "SysidError", "fit_decay", "fit", "diagnose", "compare", "simulate",
)  # fmt: skip
HEAD = """\
# API reference

<!-- made by docs/make_api.py from the docstrings; edit those -->

`import sysid` offers ten names. Everything else can be imported from its module, and may move. [library.md](library.md) shows
them at work, and `examples/` has five scripts.

- Units are SI and radians. Every estimate is a `Quantity` with its uncertainty.
- `Data`, which the functions take, is a `Recording`, a `Release`, or several of them.
- Every result has `.report()`, the text that its command prints; `.warnings`; `.to_json()`; and `.to_dataframe()`.
"""


def page() -> str:
    """Return docs/api.md."""
    parts = [HEAD]
    parts += [f"## `sysid.{name}`\n\n{_entry(getattr(sysid, name))}" for name in ORDER]
    parts.append("# Arguments and results\n")
    for name, module in BEHIND.items():
        parts.append(f"## `{module}.{name}`\n\n{_entry(getattr(__import__(module, fromlist=[name]), name))}")
    return "\n".join(part.rstrip() + "\n" for part in parts)


def _entry(thing: type) -> str:
    """Return the entry of one class or function."""
    source = Path(__import__(thing.__module__, fromlist=["_"]).__file__ or "").read_text(encoding="utf-8")
    (node,) = (
        n for n in ast.parse(source).body
        if isinstance(n, ast.ClassDef | ast.FunctionDef) and n.name == thing.__name__
    )  # fmt: skip
    return _function(node) if isinstance(node, ast.FunctionDef) else _class(node)


def _function(node: ast.FunctionDef) -> str:
    returns = "" if node.returns is None else f" -> {_annotation(node.returns)}"
    return f"```python\n{node.name}({_arguments(node)}){returns}\n```\n\n{_prose(ast.get_docstring(node) or '')}\n"


def _arguments(node: ast.FunctionDef) -> str:
    plain = ast.arguments(
        posonlyargs=node.args.posonlyargs,
        args=[a for a in node.args.args if a.arg not in ("self", "cls")],
        vararg=node.args.vararg,
        kwonlyargs=node.args.kwonlyargs,
        kw_defaults=node.args.kw_defaults,
        kwarg=node.args.kwarg,
        defaults=node.args.defaults,
    )
    text = ast.unparse(plain).replace('"', "").replace("'", '"')
    return text if len(text) < 90 else "\n    " + re.sub(r", (?=\*|\w+:)", ",\n    ", text) + ",\n"


def _annotation(node: ast.expr) -> str:
    return ast.unparse(node).strip("'\"")


def _class(node: ast.ClassDef) -> str:
    lines = [_prose(ast.get_docstring(node) or ""), ""]
    for name, annotation, text in _fields(node):
        lines.append(f"- `{name}: {annotation}`" + (f": {_line(text)}" if text else ""))
    methods: list[str] = []
    for part in node.body:
        if not isinstance(part, ast.FunctionDef) or part.name.startswith("_"):
            continue
        decorators = {ast.unparse(d) for d in part.decorator_list}
        text = ast.get_docstring(part) or ""
        if decorators & {"property", "cached_property"}:
            kind = _annotation(part.returns) if part.returns else ""
            lines.append(f"- `{part.name}: {kind}`: {_line(text.split(chr(10) + chr(10))[0])}")
        else:
            methods.append(f"### `{node.name}.{part.name}`\n\n{_function(part)}")
    return "\n".join([*lines, "", *methods])


def _fields(node: ast.ClassDef) -> Iterator[tuple[str, str, str]]:
    """Yield name, type and docstring of each field."""
    for part, after in zip(node.body, [*node.body[1:], None], strict=True):
        if not isinstance(part, ast.AnnAssign) or not isinstance(part.target, ast.Name):
            continue
        text = ""
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            text = str(after.value.value)
        if not part.target.id.startswith("_"):
            yield part.target.id, _annotation(part.annotation), text


def _line(text: str) -> str:
    """Return a docstring's paragraph in one line, as a phrase of a list."""
    return re.sub(r"\s+", " ", text).strip().rstrip(".")


def _prose(text: str) -> str:
    """Return a Google docstring as Markdown: its sections become lists."""
    lines: list[str] = []
    for block in re.split(r"\n\n", text):
        section = re.match(r"(Args|Raises|Returns):\n(.*)", block, re.S)
        if section is None:
            lines += [block, ""]
            continue
        if section[1] == "Returns":
            lines += [f"Returns: {_line(section[2])}.", ""]
            continue
        items = re.split(r"\n(?=    \S)", section[2])
        for item in items:
            name, _, what = item.strip().partition(":")
            lines.append(f"- {'raises ' if section[1] == 'Raises' else ''}`{name}`: {_line(what)}")
        lines.append("")
    return "\n".join(lines).rstrip()


if __name__ == "__main__":
    TARGET.write_text(page(), encoding="utf-8")
