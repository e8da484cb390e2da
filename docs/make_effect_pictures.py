"""Draw what each effect does to a decay, and write docs/effects.md from the catalogue.

python docs/make_effect_pictures.py
"""

import re
from pathlib import Path

from reports.figures.effect import effect_figure
from sysid.effects import catalogue
from sysid.effects._base import Effect, TorqueEffect

DOCS = Path(__file__).parent
ROLES = {
    "torque": "Torques of the joint",
    "learned": "Learned torques, without a formula",
    "support": "The support of the joint",
    "shift": "The rest angle",
    "record": "The record's numbers, and the simulator",
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
            *([f"- **Looks like:** {', '.join(effect.look_alikes)}"] if effect.look_alikes else []),
            f"- **Tell it apart:** {effect.experiment_on()}",
            "",
        )
    )


def page() -> str:
    """Return docs/effects.md."""
    lines = [
        "# The effect catalogue",
        "",
        "What a joint can do beyond a linear spring and damper. `diagnose` says which of these effects a log shows, `fit --effect NAME` fits one,",
        "and `husky-sysid effects NAME` prints what stands here.",
        "",
        "All laws are torques τ in I φ̈ = -k x - d v + Σ τ, with x = roll - rest angle and v its rate. In the pictures orange is the board with the",
        "effect, blue the model without it.",
        "",
        "| effect | what it is | what it does to a decay |",
        "|---|---|---|",
        *(_row(effect) for role in ROLES for effect in catalogue().values() if effect.role == role),
        "",
        "A new effect is one file in `sysid/effects/` and one test; command line, fit, diagnosis and this page then know it",
        "([how](../CONTRIBUTING.md#add-an-effect)). Written by `docs/make_effect_pictures.py`; do not edit.",
        "",
    ]
    for role, heading in ROLES.items():
        lines += [f"## {heading}", ""]
        lines += [section(effect) for effect in catalogue().values() if effect.role == role]
    return "\n".join(lines).rstrip() + "\n"


def _row(effect: Effect) -> str:
    return f"| [`{effect.name}`](#{_anchor(f'`{effect.name}`: {effect.title}')}) | {effect.title} | {effect.does} |"


def _anchor(heading: str) -> str:
    """Return the name by which a heading can be linked to: its letters, digits and hyphens."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def main() -> None:
    """Write all pictures and the page."""
    folder = DOCS / "effects"
    folder.mkdir(exist_ok=True)
    for effect in catalogue().values():
        effect_figure(effect).savefig(folder / f"{effect.name}.png", dpi=90, metadata={"Software": None})
    (DOCS / "effects.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
