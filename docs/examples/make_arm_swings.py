"""Make the logs of arm.xml's knee: bare, and with 0.15 and 0.3 kg at its tip.

The truth is not the model's: its rotor has 0.002 kg*m², friction is 0.02 N*m and damping 0.035 N*m*s/rad.

python docs/examples/make_arm_swings.py
"""

from pathlib import Path

from sysid.board import Board
from sysid.quantity import Quantity
from sysid.synth import SynthOptions, synthesise
from sysid.synth.sensors import Sensor

HERE = Path(__file__).parent
INERTIA, MOMENT = 0.0238876, 0.981784
"""Of the model: from its mass matrix [kg*m^2], and m g l [N*m]; written down here so that the truth does not ask the tool."""
ARMATURE, FRICTION, DAMPING = 0.002, 0.02, 0.035
REACH = 0.2
"""From the axis to the tip [m]."""


def main() -> None:
    """Write the three logs."""
    for name, load in (("arm", 0.0), ("arm_150g", 0.15), ("arm_300g", 0.3)):
        inertia = INERTIA + ARMATURE + load * REACH**2
        board = Board(
            name=name, description="", source="", geometry={}, mass={}, inertia=Quantity(inertia, 0.0, "kg*m^2"),
            tilt={
                "stiffness": Quantity(0.0, 0.0, "N*m/rad"), "damping": Quantity(DAMPING, 0.0, "N*m*s/rad"),
                "rest_angle": Quantity(0.0, 0.0, "rad"), "range": Quantity(3.0, 0.0, "rad"),
            },
        )  # fmt: skip
        options = SynthOptions(
            angles=(0.8, -0.6), rate=100.0, duration=4.0, seed=int(100 * load), sensor=Sensor(noise=1e-3)
        )
        log = synthesise(board, {"gravity": (MOMENT + load * 9.81 * REACH,), "coulomb": (FRICTION,)}, options)
        log.save(HERE / f"{name}_swing.csv")


if __name__ == "__main__":
    main()
