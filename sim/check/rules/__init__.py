"""Pass and fail criteria of `check`: one a file, discovered by its file.

Such a file ends in `RULE = Rule(...)`: the moment at which it is asked, and a function that yields sentences on a case.
"""

import importlib
import pkgutil

from sim.check.rules._base import Asked, Case, Rule


def rules() -> tuple[Rule, ...]:
    """Return every rule, in the order in which they speak."""
    modules = (name for _, name, _ in pkgutil.iter_modules(__path__) if name[0] != "_")
    found: list[Rule] = [importlib.import_module(f"{__name__}.{name}").RULE for name in modules]
    return tuple(sorted(found, key=lambda rule: rule.order))


def said(asked: Asked, case: Case) -> tuple[str, ...]:
    """Return the sentences of the rules that are asked now, or of the one that is the whole answer."""
    spoken: list[str] = []
    for rule in rules():
        is_asked = asked in rule.asked and not (rule.of_board and case.parts is None)
        texts = tuple(rule.says(case)) if is_asked else ()
        if texts and rule.whole_answer:
            return texts
        spoken += texts
    return tuple(spoken)
