# pyright: reportMissingImports=false, reportUnknownParameterType=false
"""Contact sensors of the skating scene in mjlab.

They are few and broad, because each costs time in every physics step. Contacts of other parts are all contacts
less those of the feet.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mjlab.sensor import ContactSensorCfg

FORCE_THRESHOLD = 5.0
"""Force above which a foot counts as loaded [N]."""
WHEEL_FORCE_THRESHOLD = 1.0
"""Force above which a wheel counts as touching the ground [N]."""

FEET_GROUND, FEET_DECK = "feet_ground", "feet_deck"
ROBOT_GROUND, ROBOT_BOARD, SELF = "robot_ground", "robot_board", "self_contact"
WHEELS_GROUND = "wheels_ground"


def contact_sensors() -> "tuple[ContactSensorCfg, ...]":
    """Return the sensors; feet are ordered left, right, wheels front left, front right, rear left, rear right."""
    from mjlab.sensor import ContactMatch, ContactSensorCfg

    from sim.board.scene import WHEELS

    feet = ContactMatch(
        mode="subtree", pattern=("left_ankle_roll_link", "right_ankle_roll_link"), entity="robot"
    )
    robot = ContactMatch(mode="subtree", pattern="pelvis", entity="robot")
    ground = ContactMatch(mode="body", pattern="terrain")
    deck = ContactMatch(mode="body", pattern="deck", entity="board")
    board = ContactMatch(mode="subtree", pattern="board", entity="board")
    wheels = ContactMatch(mode="body", pattern=tuple(f"{w}_wheel" for w in WHEELS), entity="board")

    def sensor(name: str, primary: ContactMatch, secondary: ContactMatch, *fields: Any) -> ContactSensorCfg:
        return ContactSensorCfg(
            name=name, primary=primary, secondary=secondary, fields=fields, reduce="netforce"
        )

    return (
        sensor(FEET_GROUND, feet, ground, "found", "force"),
        sensor(FEET_DECK, feet, deck, "found", "force"),
        sensor(ROBOT_GROUND, robot, ground, "found"),
        sensor(ROBOT_BOARD, robot, board, "found"),
        sensor(SELF, robot, robot, "found"),
        sensor(WHEELS_GROUND, wheels, ground, "force"),
    )
