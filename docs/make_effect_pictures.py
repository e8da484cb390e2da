"""Draw what each effect does to a decay, and write docs/effects.md from the catalogue.

python docs/make_effect_pictures.py
"""

from pathlib import Path

from reports.figures.effect import effect_figure
from sysid.effects import catalogue
from sysid.effects._base import Effect, TorqueEffect

DOCS = Path(__file__).parent
ROLES = {
    "torque": "The joint's torque",
    "learned": "Learned, without a formula",
    "support": "What the joint stands on",
    "shift": "The rest angle",
    "record": "The record's numbers, or the simulator",
    "measurement": "The sensor",
}


def section(effect: Effect) -> str:
    """Return the effect's part of the page."""
    tables = effect.smoothness() if isinstance(effect, TorqueEffect) and effect.smoothness else None
    units = ", ".join(
        f"`{p.name}` [{p.unit}]" for p in effect.parameters if tables is None or p.name not in tables.names
    )
    if tables is not None:
        units += f"; {len(tables.names)} values [N*m] of its tables over {', '.join(tables.tables)}"
    support = effect.mujoco
    if support.since:
        runs = f"MuJoCo {support.since} and newer" + (", MuJoCo Warp too" if support.warp else "")
        mujoco = f"{support.means} ({runs})"
    else:
        mujoco = support.written
    return "\n".join(
        (
            f"### `{effect.name}`: {effect.title}",
            "",
            f"![{effect.does}](effects/{effect.name}.png)",
            "",
            effect.does,
            "",
            f"- **Law:** {effect.law}",
            f"- **Parameters:** {units}",
            f"- **Source:** {effect.source}",
            f"- **In MuJoCo:** {mujoco}",
            f"- **Looks like:** {', '.join(effect.look_alikes)}",
            f"- **Tell it apart:** {effect.experiment}",
            "",
        )
    )


def page() -> str:
    """Return docs/effects.md."""
    lines = [
        "# The effect catalogue",
        "",
        "Written by `docs/make_effect_pictures.py` from `sysid/effects/`, one file an effect; do not edit.",
        "",
        "x = roll - rest angle, v its rate, and I φ̈ = -k x - d v + Σ τ. Orange is the board with the effect, blue",
        "the model without it.",
        "",
        "A new effect is one file in `sysid/effects/` that ends in `EFFECT = Effect(...)`, and one test. The",
        "command line, the fit, the diagnosis and this page then know it.",
        "",
    ]
    for role, heading in ROLES.items():
        lines += [f"## {heading}", ""]
        lines += [section(effect) for effect in catalogue().values() if effect.role == role]
    return "\n".join(lines).rstrip() + "\n"


def main() -> None:
    """Write all pictures and the page."""
    folder = DOCS / "effects"
    folder.mkdir(exist_ok=True)
    for effect in catalogue().values():
        effect_figure(effect).savefig(folder / f"{effect.name}.png", dpi=90, metadata={"Software": None})
    (DOCS / "effects.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
