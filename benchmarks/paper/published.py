"""What the paper (arXiv 2602.03205) has in its tables, and by which options its rows are trained here."""

from dataclasses import dataclass, field

from sysid.quantity import Quantity

METRICS = ("E_succ", "E_vel", "E_yaw", "E_smth", "E_contact")
_UNITS = ("1", "m/s", "rad", "rad", "1")


@dataclass(frozen=True, slots=True)
class Row:
    """One row of a table."""

    key: str
    """As the manifest of runs names it."""
    title: str
    options: str
    """Of `husky-sysid train`, by which the row differs from the first."""
    figures: dict[str, Quantity] = field(default_factory=dict[str, Quantity])
    """The paper's, mean and standard deviation over its seeds; empty where its tables have no such row."""


def _row(key: str, title: str, options: str, *figures: tuple[float, float]) -> Row:
    named = {
        name: Quantity(mean, std, unit, "arXiv 2602.03205, table II")
        for name, unit, (mean, std) in zip(METRICS, _UNITS, figures, strict=False)
    }
    return Row(key, title, options, named)


MAIN = (
    _row("husky", "HUSKY", "", (1.0, 0.0), (0.056, 0.013), (0.208, 0.014), (0.033, 0.005), (0.001, 0.001)),
    _row(
        *("tracking", "pushing by tracking", "--set pushing=tracking"),
        *((0.1112, 0.0386), (0.435, 0.101), (0.568, 0.092), (0.044, 0.025), (0.015, 0.010)),
    ),
    _row(
        *("gait", "pushing by a gait clock", "--set pushing=gait"),
        *((0.8238, 0.0725), (0.102, 0.035), (0.302, 0.041), (0.043, 0.011), (0.130, 0.072)),
    ),
    _row(
        *("no-tilt-guidance", "without tilt guidance", "--set tilt_guidance=false"),
        *((0.9672, 0.0210), (0.071, 0.010), (0.233, 0.027), (0.035, 0.017), (0.002, 0.002)),
    ),
    _row(
        *("amp-transition", "transitions by style", "--set transition=style"),
        *((0.8512, 0.0411), (0.053, 0.025), (0.265, 0.050), (0.040, 0.007), (0.394, 0.015)),
    ),
    _row(
        *("translation-only", "transitions by translation only", "--set transition=translation"),
        *((0.8955, 0.0230), (0.064, 0.020), (0.294, 0.075), (0.039, 0.012), (0.038, 0.012)),
    ),
    _row("standing-start", "all episodes from rest, as the paper's first", "--start standing"),
    _row("no-transition-guidance", "no guidance of transitions", "--set transition=none"),
    _row("no-coupling", "trucks held straight", "--set steered=false"),
)
"""The main table; the last three are in the paper's figures only."""

SENSITIVITY = (
    _row("pose-offset", "poses off by 0.05 rad in every joint", "--set pose_offset=0.05"),
    _row("mount-24", "mounting 20 % shorter", "--set mount_steps=24"),
    _row("mount-36", "mounting 20 % longer", "--set mount_steps=36"),
    _row("bezier-1", "path of order 1", "--set bezier_order=1"),
    _row("bezier-3", "path of order 3", "--set bezier_order=3"),
)
"""What the transition's guidance bears."""

TERRAIN = {
    "slopes": Quantity(0.95, float("nan"), "1", "arXiv 2602.03205"),
    "steps": Quantity(0.89, float("nan"), "1", "arXiv 2602.03205"),
}
"""The paper's E_succ on its terrains, which are not ours."""
