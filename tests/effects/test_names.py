"""Nothing outside `sysid/effects` knows an effect by its name; a new one is one new file."""

import ast
import re
from pathlib import Path

from sysid.effects import catalogue

ROOT = Path(__file__).parents[2]
OWNERS = ("sysid/effects", "sysid/synth", "sysid/cli/synth.py")
"""Rooms that may: the catalogue itself, and the independent truth that makes logs."""
WORDS = {"inertia", "gravity", "clock", "offset", "weight", "armature", "linkage", "payload", "learned"}
"""Effects whose names are everyday words: alone they may mean a quantity of the board, a channel of a log, a measure."""
LOOKUPS = {"effect", "with_effect", "parameters_from"}
"""Functions that take an effect's name."""


def literals(node: ast.AST) -> list[str]:
    """Return the strings in a part of a program."""
    found = (part.value for part in ast.walk(node) if isinstance(part, ast.Constant))
    return [value.strip() for value in found if isinstance(value, str)]


def keys(tree: ast.AST) -> list[str]:
    """Return the strings that are compared with a `.name`, or looked up in something called effects or a catalogue."""
    found = []
    for node in ast.walk(tree):
        # `effect(part.name).role` is no name, but what stands under it.
        if isinstance(node, ast.Compare) and re.search(r"\.name\b(?!\)\.)", ast.unparse(node)):
            found += literals(node)
        elif isinstance(node, ast.Subscript) and re.search("effect|catalogue", ast.unparse(node.value)):
            found += literals(node.slice)
        elif isinstance(node, ast.Call):
            function = ast.unparse(node.func)
            if function in LOOKUPS or re.search(r"(effect|catalogue).*\.get$", function):
                found += [text for argument in node.args[:1] for text in literals(argument)]
    return found


def names_in(source: str) -> list[str]:
    """Return the names of effects, and of their parameters, in a program's source."""
    tree = ast.parse(source)
    parameters = {f"{name}.{p}" for name, part in catalogue().items() for p in part.parameter_names}
    unmistakable = set(catalogue()) - WORDS | parameters
    quoted = [f"'{name}'" for name in catalogue()]
    texts = literals(tree)
    return (
        [text for text in texts if text in unmistakable]
        + [key for key in keys(tree) if key in WORDS]
        + [text for text in texts if any(name in text for name in quoted)]
    )


def test_no_effect_is_named_outside_the_catalogue():
    found = []
    for room in ("sysid", "sim", "reports", "policy_runtime"):
        for path in sorted((ROOT / room).rglob("*.py")):
            place = path.relative_to(ROOT).as_posix()
            if not place.startswith(OWNERS):
                found += [f"{place}: {name}" for name in names_in(path.read_text(encoding="utf-8"))]
    assert not found
