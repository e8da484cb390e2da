"""`husky-sysid effects`: every effect with its law and origin; a file for one of your own."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from sysid.cli.console import Common, Output, Printer
from sysid.errors import SysidError
from sysid.files import write_atomically, write_figure


def effects(
    name: Annotated[str | None, Parameter(help="Show all of this effect; or 'new'.")] = None,
    new: Annotated[str | None, Parameter(help="After 'new': name of the effect in the new file.")] = None,
    /,
    *,
    output: Output | None = None,
    common: Common = Common(),
) -> None:
    """List all effects with law and provenance, show one, or write the file of a new one.

    Args:
        output: Write the picture of the effect here: a decay with and without it.
    """
    from sysid.effects import catalogue, origin

    printer = Printer(common)
    if name == "new":
        _write(new, printer)
    elif new is not None:
        raise SysidError(f"effects {name} {new}: expected one name, or: effects new NAME")
    elif name is not None:
        _show(name, output, printer)
    else:
        rows = [(n, part.title, part.law, origin(n) or "catalogue") for n, part in catalogue().items()]
        printer.table(("effect", "what it is", "law", "from"), rows)
        fields = ("name", "title", "law", "from")
        printer.result({"effects": [dict(zip(fields, row, strict=True)) for row in rows]})


def _write(name: str | None, printer: Printer) -> None:
    from sysid.effects import catalogue, effect_file

    if name is None:
        raise SysidError("effects new: which? Give the new effect's name: husky-sysid effects new my_effect")
    path = Path(f"{Path(name).name.removesuffix('.py').replace('-', '_')}.py")
    called = path.stem.replace("_", "-").lower()
    if path.exists():
        raise SysidError(f"{path}: there is such a file already. Give another name.")
    if called in catalogue():
        raise SysidError(f"there is an effect '{called}' already. Give another name.")
    write_atomically(path, effect_file(called))
    printer.say(f"written: {path}. Try it: husky-sysid fit LOG --board BOARD --effect-file {path}")
    printer.result({"name": called, "file": path})


def _show(name: str, output: Path | None, printer: Printer) -> None:
    from sysid.effects import effect, origin

    part = effect(name)
    parameters = ", ".join(f"{p.name} [{p.unit}]" for p in part.parameters[:6])
    more = f" and {len(part.parameters) - 6} values of tables" if len(part.parameters) > 6 else ""
    rows = [
        ("what it is", part.title), ("also called", ", ".join(part.also_called) or "-"), ("law", part.law), ("parameters", parameters + more), ("does", part.does),
        ("source", part.source), ("in MuJoCo", part.mujoco.means), ("looks like", ", ".join(part.look_alikes) or "-"),
        ("tell it apart", part.experiment_on()), ("from", origin(name) or "catalogue"),
    ]  # fmt: skip
    printer.table((name, ""), rows)
    written: list[Path] = []
    if output is not None:
        from reports.figures.effect import effect_figure

        written = [write_figure(output, effect_figure(part), dpi=120)]
    content = {"name": name, **dict(rows), "also_called": part.also_called, "picture": output}
    printer.result(content, *written)
