"""Every public function of `sysid` that takes or gives an array states a shape and a unit in its docstring."""

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


EXAMPLE = '''
def {name}(time: Array, rate: float) -> None:
    """{text}"""
class Trace:
    def at(self) -> "npt.NDArray[np.bool_]":
        """Return which rows, shape (n,) [1]."""
'''


@pytest.mark.parametrize(
    ("name", "text", "found"),
    [
        ("f", "Take time [s], shape (n,).", []),
        ("f", "Take time [s].", ["f: no shape"]),
        ("f", "Take time, shape (n, 3).", ["f: no unit"]),
        ("f", "Take time (see above).", ["f: no shape and no unit"]),
        ("_f", "Take time.", []),
    ],
)
def test_what_a_docstring_lacks_is_seen(name, text, found):
    assert silent(EXAMPLE.format(name=name, text=text)) == found
