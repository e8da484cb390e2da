"""Draw what each effect does to a decay, and write docs/effects.md from the catalogue.

python docs/make_effect_pictures.py
"""

from pathlib import Path

from reports.figures.effect import effect_figure
from sysid.effects import catalogue
from sysid.effects._base import Effect

DOCS = Path(__file__).parent
ROLES = {
    "torque": "Torques of the joint",
    "learned": "Learned torques, without a formula",
    "support": "The support of the joint",
    "shift": "The rest angle",
    "record": "The record's numbers, and the simulator",
    "measurement": "The sensor",
}


def page() -> str:
    """Return docs/effects.md."""
    lines = [
        "# The effect catalogue",
        "",
        "Effects of a joint beyond a linear spring and damper. `diagnose` finds them in a log, `fit --effect NAME` fits one.",
        "",
        "Laws are torques τ in I φ̈ = -k x - d v + Σ τ; x is the angle from rest, v its rate. Each name links to a picture: orange is the",
        "joint with the effect, blue the model without it.",
        "",
        "`husky-sysid effects NAME` prints parameters, source, look-alikes, the experiment that separates them, and the form in MuJoCo.",
        "",
        "[Add an effect](../CONTRIBUTING.md#add-an-effect) of your own as one file. Written by `docs/make_effect_pictures.py`; do not edit.",
        "",
    ]
    for role, heading in ROLES.items():
        lines += [f"## {heading}", "", "| effect | law | in a decay |", "|---|---|---|"]
        lines += [_row(effect) for effect in catalogue().values() if effect.role == role] + [""]
    return "\n".join(lines).rstrip() + "\n"


def _row(effect: Effect) -> str:
    law = effect.law.replace("|", "\\|")
    return f"| [`{effect.name}`](effects/{effect.name}.png): {effect.title} | {law} | {effect.does} |"


def main() -> None:
    """Write all pictures and the page."""
    folder = DOCS / "effects"
    folder.mkdir(exist_ok=True)
    for effect in catalogue().values():
        effect_figure(effect).savefig(folder / f"{effect.name}.png", dpi=90, metadata={"Software": None})
    (DOCS / "effects.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
