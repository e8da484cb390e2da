"""Arrays state shape and unit where a function takes or gives them; constants say what they are, and in which unit."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

SYSID = Path(__file__).parents[1] / "sysid"
ARRAY = re.compile(r"\b(Array|Complex|Picture|Rows|Mask|NDArray|ndarray)\b")
SHAPE = re.compile(r"\(\w[^()\[\]:;]*,[^()\[\]:;]*\)|shape \(\)")
UNIT = re.compile(r"\[[^\]\n]+\]|\bunits?\b|\bdimensionless\b")


def public_functions(body: list[ast.stmt], inside: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public_functions(node.body, f"{inside}{node.name}.")
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield inside + node.name, node


def silent(source: str) -> list[str]:
    """Return the public functions of a module with arrays but without shape or without unit, and what is missing."""
    found = []
    for name, function in public_functions(ast.parse(source).body):
        given = function.args
        taken = [argument.annotation for argument in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
        types = " ".join(ast.unparse(note) for note in (*taken, function.returns) if note)
        text = ast.get_docstring(function) or ""
        missing = [word for word, pattern in (("shape", SHAPE), ("unit", UNIT)) if not pattern.search(text)]
        if ARRAY.search(types) and missing:
            found.append(f"{name}: no {' and no '.join(missing)}")
    return found


ROOMS = sorted(
    path.name for path in SYSID.iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()
)


@pytest.mark.parametrize("room", ROOMS)
def test_arrays_state_shape_and_unit(room):
    modules = [SYSID / room] if room.endswith(".py") else sorted((SYSID / room).rglob("*.py"))
    found = [f"{path.relative_to(SYSID)} {text}" for path in modules for text in silent(path.read_text())]
    assert not found, "\n".join(found)


CONSTANT = re.compile(r"_?[A-Z][A-Z0-9_]*")
DIMENSIONLESS = re.compile(
    r"\[1\]|\b(shares?|ratios?|factors?|fractions?|times|over|multiple|relative(ly)?|percent|cosine|correlation|probabilit"
    r"(y|ies)|χ²|likelihood|odds|deviance|periods?|deviations?|draws|weight|independent values|as the default)\b|%|\be\^",
    re.I,
)


def is_number(node: ast.expr | None, kind: type) -> bool:
    """Whether an expression is written with numbers alone, and one of them is of a kind."""
    if node is None or (isinstance(node, ast.Constant) and not isinstance(node.value, int | float)):
        return False
    leaves = [part for part in ast.walk(node) if isinstance(part, ast.Constant | ast.Name)]
    values = [part.value for part in leaves if isinstance(part, ast.Constant)]
    known = all(isinstance(part, ast.Constant) or part.id in ("math", "np") for part in leaves)
    shape = not any(isinstance(part, ast.Dict | ast.List | ast.Set | ast.Lambda) for part in ast.walk(node))
    plain = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    return known and shape and plain and any(isinstance(value, kind) for value in values)


def unexplained(source: str) -> list[str]:
    """Return the constants of a module that are numbers and of which nothing is said, or whose unit is not.

    Neighbours, line by line, share what is said below the last.
    """
    found, group = [], []
    body = ast.parse(source).body
    for node, after in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.Assign | ast.AnnAssign) or not is_number(node.value, int | float):
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = [part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)]
        if not all(CONSTANT.fullmatch(name) for name in names):
            continue
        group += [(name, is_number(node.value, float)) for name in names]
        if isinstance(after, ast.Assign | ast.AnnAssign) and after.lineno == node.end_lineno + 1:
            continue
        said = (
            after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else ""
        )
        if not said:
            found += [f"{name}: nothing is said" for name, _ in group]
        elif not (UNIT.search(said) or DIMENSIONLESS.search(said)):
            found += [f"{name}: no unit" for name, real in group if real]
        group = []
    return found


PRODUCT = [
    path for room in ("sysid", "sim", "reports") for path in sorted((SYSID.parent / room).rglob("*.py"))
]


def test_constants_say_what_they_are_and_in_which_unit():
    found = [
        f"{path.relative_to(SYSID.parent)} {text}"
        for path in PRODUCT
        for text in unexplained(path.read_text(encoding="utf-8"))
    ]
    assert not found, "\n".join(found)
