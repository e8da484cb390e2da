"""Public benchmarks of driven joints. Data are the reader's own: nothing is fetched.

python benchmarks/driven_public.py silverbox SNLS80mV.csv
python benchmarks/driven_public.py emps DATA_EMPS.mat
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from suite import command_line

from sysid.driven.fit import fit, free_of
from sysid.driven.joint import Structure
from sysid.driven.log import DrivenLog, Load
from sysid.driven.problem import Problem
from sysid.effects import asymmetric_stiffness, coulomb, cubic_stiffness, torque_constant

SILVERBOX_RATE = 1e7 / 2**14
"""Sampling of Silverbox [Hz]."""


def silverbox(path: Path) -> None:
    """Fit 8,192 samples of the multisine; simulate the arrow."""
    table = np.genfromtxt(path, delimiter=",", skip_header=1)[:, :2]

    def part(first: int, last: int) -> DrivenLog:
        time = np.arange(last - first) / SILVERBOX_RATE
        return DrivenLog(name="silverbox", time=time, angle=table[first:last, 1], std=2e-4, input=table[first:last, 0], kind="torque",
                         load=Load.constant(1.0, last - first), held=False)  # fmt: skip

    effects = (cubic_stiffness.EFFECT.name, asymmetric_stiffness.EFFECT.name)
    structure, natural = Structure("torque", effects), (2 * np.pi * 70) ** 2
    gain = f"{torque_constant.EFFECT.name}.gain"
    free = (
        "stiffness",
        *(
            name
            for name in free_of(structure, (*effects, torque_constant.EFFECT.name), {})
            if name != "armature"
        ),
    )
    train = part(40_650, 40_650 + 8192)
    known = {"stiffness": natural, "damping": 20.0, gain: natural}
    found = fit(Problem(log=train, structure=structure, values=known, free=free))
    arrow = part(100, 40_575)
    problem = replace(found.problem, log=arrow, values=found.values)
    error = 1e3 * problem.residuals(problem.begin(), slopes=False)[0][0] * arrow.std
    inside = int(np.argmax(np.abs(arrow.angle) > np.abs(train.angle).max()))
    print(
        f"whole arrow {np.sqrt(np.mean(error**2)):.3f} mV, within the training amplitude {np.sqrt(np.mean(error[:inside] ** 2)):.3f} mV"
    )


def emps(path: Path) -> None:
    """Fit mass, viscous and dry friction and offset of the positioning system."""
    from scipy.io import loadmat

    data = loadmat(path)
    time, angle = data["t"].ravel(), data["qm"].ravel()
    force = data["vir"].ravel() * float(data["gtau"].ravel()[0])
    log = DrivenLog(
        name="emps",
        time=time,
        angle=angle,
        std=2e-6,
        input=force,
        kind="force",
        load=Load.constant(0.0, len(time)),
    )
    structure = Structure("force", (coulomb.EFFECT.name,))
    free = free_of(structure, structure.effects, {})
    found = fit(Problem(log=log, structure=structure, values={}, free=free))
    for (name, quantity), author in zip(
        found.quantities.items(), (95.1089, 203.5034, 3.1648, 20.3935), strict=True
    ):
        print(f"{name:16} {quantity}; the authors' {author} ({100 * (quantity.value / author - 1):+.1f} %)")
    print(f"error of the whole simulation {100 * found.rmse / angle.std():.2f} % of the motion")


def main() -> None:
    """Run one benchmark."""
    parser = command_line(__doc__)
    parser.add_argument("which", choices=("silverbox", "emps"))
    parser.add_argument("file", type=Path)
    options = parser.parse_args()
    (silverbox if options.which == "silverbox" else emps)(options.file)


if __name__ == "__main__":
    main()
